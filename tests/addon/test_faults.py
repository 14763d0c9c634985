"""After a fault of ours the artist finds all that is known about it in a text."""

import bpy
import pytest

from faults import press, without_blender
from figures import everything, grid, stand_in, tone
from test_job_ends import _Through


@pytest.fixture
def ready(addon, tmp_path):
    """A face that is ready to speak, and an engine that fails in the worker thread."""
    stage = stand_in(addon)
    ob = grid()
    bpy.context.scene.render.fps = 24
    ob.anyface.source, ob.anyface.sound_file = "FILE", tone(tmp_path / "tone.wav")

    def breaks(*_, **__):
        raise ZeroDivisionError("a number of ours is 0")

    stage.animate = breaks
    return ob


def details():
    return bpy.data.texts["Anyface Fault"].as_string()


def test_a_fault_without_a_window_is_kept_as_a_text(ready):
    before = everything()
    with pytest.raises(RuntimeError, match=r"ZeroDivisionError.*the text Anyface Fault"):
        bpy.ops.anyface.generate()
    assert everything() == before and "the text Anyface Fault" in ready.anyface.report
    assert "Traceback" in details() and bpy.app.version_string in details()
    assert "in breaks" in details()


def test_a_fault_in_the_thread_ends_the_job_and_is_kept_as_a_text(ready, addon, monkeypatch):
    module = addon("ui.generate")
    monkeypatch.setattr(addon("ui.operators"), "bpy", _Through())
    operator = without_blender(module.ANYFACE_OT_generate)
    word, manager = press(operator, ready)
    assert word == "CANCELLED" and manager.timers == 0
    assert not addon("ui.running").is_running()
    ((kind, message),) = operator.messages
    assert kind == "ERROR" and "the text Anyface Fault" in message and "Traceback" not in message
    assert "in breaks" in details()


def test_an_error_in_words_leaves_no_text(ready):
    ready.anyface.sound_file = "/gone.wav"
    with pytest.raises(RuntimeError, match="no sound file at"):
        bpy.ops.anyface.generate()
    assert "Anyface Fault" not in bpy.data.texts


def test_the_text_holds_the_last_fault_alone(ready):
    for _ in range(2):
        with pytest.raises(RuntimeError):
            bpy.ops.anyface.generate()
    assert details().count("Traceback") == 1
    assert len([text for text in bpy.data.texts if text.name.startswith("Anyface Fault")]) == 1
