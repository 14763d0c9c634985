"""What panel, command and batches draw from the library's description of a performance."""

from dataclasses import replace

import bpy
import pytest

from figures import grid


@pytest.fixture
def invented(addon, monkeypatch):
    """A library whose systems also take a recording, a text and a number that no one wrote down."""
    systems = addon("core.systems")
    new = (
        systems.Field("echo_of", "Echo Of", "A recording.", "sound"),
        systems.Field("accent", "Accent", "A place, 100 %.", "text"),
        systems.Field("haste", "Haste", "How fast.", "number", 0.5, 2.0, 1.0),
    )
    known = [replace(system, fields=system.fields + new) for system in systems.known()]
    monkeypatch.setattr(systems, "known", lambda: known)
    addon("farm.jobs")._parser.cache_clear()
    yield new
    addon("farm.jobs")._parser.cache_clear()


def test_plain_fields_are_stored_with_the_face(addon):
    ob, systems = grid(), addon("core.systems")
    names = {field.name for field in systems.plain_fields()}
    assert {"seed", "style", "neutral_voice"} <= names and not {"fps", "text"} & names
    ob.anyface.seed, ob.anyface.style = 7, "grid_s1"
    ob.anyface_audio.neutral_voice, ob.anyface.performer = "/calm.wav", "/kim.performer"
    settings = addon("ui.settings").from_object(ob, bpy.context.scene)
    assert set(settings.fields) == names
    assert settings.fields["neutral_voice"] == "/calm.wav"
    request = addon("scene.bake").words_and_numbers(settings)
    performer = {"performer": "/kim.performer", "performer_strength": 1.0}
    assert request == {"seed": 7, "style": "grid_s1", "text": "", **performer}


def test_a_new_field_needs_no_line_in_panel_command_or_batch(addon, invented, tmp_path):
    shown = addon("ui.properties")._of_library()
    assert {"accent", "haste"} <= set(shown) and "echo_of" in addon("ui.properties")._recordings()
    parser = addon("core.options").step_parser("bake")
    words = ["--object=Head", "--echo-of=a.wav", "--accent=Leeds", "--haste=1.5"]
    options = parser.parse_args(words)
    assert (options.echo_of, options.accent, options.haste) == ("a.wav", "Leeds", 1.5)
    assert "100 %" in parser.format_help()
    jobs = tmp_path / "jobs.json"
    start = '{"shots": [{"file": "f.blend", "save": "s.blend", "object": "Head", '
    for name in ("echo_of", "echo-of", "emotion_of"):
        jobs.write_text(f'{start}"{name}": "a.wav"}}]}}')
        (shot,) = addon("farm.jobs").read(jobs, tmp_path).shots
        assert f"--{name.replace('_', '-')}={tmp_path / 'a.wav'}" in shot.steps[0]
    (tmp_path / "a.wav").write_bytes(b"1")
    (again,) = addon("farm.jobs").read(jobs, tmp_path).shots
    assert again.digest != shot.digest
