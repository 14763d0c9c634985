"""The artist's own models: a folder set in the preferences, in the scene or for the command."""

import argparse
import json
import os
import shutil

import bpy
import pytest

from conftest import PACKAGE, ROOT
from figures import tone
from test_heads import import_head

MODELS = ROOT / "weights"


@pytest.fixture
def folder(tmp_path):
    """A folder with one model: the built-in denoiser under a title of its own."""
    shutil.copytree(MODELS / "freetalk/ats_compact", tmp_path / "models" / "ats_compact")
    card = tmp_path / "models" / "ats_compact" / "README.md"
    card.write_text("# My own voice\n\nTrained on a day of captures.\n")
    return tmp_path / "models"


@pytest.fixture
def preferences():
    """The preferences of the extension. The model folder is empty again after the test."""
    stored = bpy.context.preferences.addons[PACKAGE].preferences
    yield stored
    stored.model_folder = ""


def test_cards_tell_the_models_of_a_folder(addon, folder):
    card = addon("core.model_card")
    (folder / "stream").mkdir()
    (folder / "stream" / "model.safetensors").write_bytes(b"")
    (folder / "notes").mkdir()
    mine, plain = card.cards(folder)
    assert (mine.name, mine.title) == ("ats_compact", "My own voice")
    assert mine.path == folder / "ats_compact" / "README.md"
    assert (plain.name, plain.title, plain.path) == ("stream", "stream", None)
    assert card.cards(folder / "nowhere") == []


def test_a_scene_comes_before_the_preferences(addon, folder, preferences):
    of, scene = addon("ui.preferences").model_folder, bpy.context.scene
    assert of(scene) is None
    preferences.model_folder = str(folder)
    assert of(scene) == folder
    scene.anyface.model_folder = str(folder / "other")
    assert of(scene) == folder / "other"


def test_each_folder_has_an_engine_that_is_new_when_its_models_are(addon, folder, preferences):
    running = addon("ui.running")
    built_in = running.engine("")
    preferences.model_folder = str(folder)
    mine = running.engine("")
    assert mine is not built_in and mine is running.engine("")
    assert running.engine("", str(folder)) is mine
    assert mine.emotions()[0] == "neutral"
    file = folder / "ats_compact" / "model.planes.gz"
    os.utime(file, ns=(0, file.stat().st_mtime_ns + 1_000_000_000))
    assert running.engine("") is not mine


def test_models_that_do_not_fit_are_told_and_the_built_in_ones_do_not_step_in(addon, folder):
    running, error = addon("ui.running"), addon("core.errors").AnyfaceError
    bpy.context.scene.anyface.model_folder = str(folder / "nowhere")
    with pytest.raises(error, match=r"nowhere: expected a folder") as caught:
        running.engine("").emotions()
    assert caught.value.kind == "weights"
    (folder / "ats_compact" / "model.planes.gz").write_bytes(b"cut")
    with pytest.raises(error) as caught:
        running.engine("", str(folder)).emotions()
    assert caught.value.kind == "weights"


@pytest.mark.parametrize("task", ["bake", "rig", "landmarks"])
def test_every_task_of_the_command_takes_weights(addon, folder, task):
    step = addon("core.options").step_parser(task)
    assert step.parse_args(["--object", "Head", "--weights", "mine"]).weights == "mine"
    assert step.parse_args(["--object", "Head"]).weights is None


def test_a_baked_face_speaks_with_the_models_that_are_named(addon, folder, tmp_path):
    import_head()
    bpy.context.scene.render.fps = 25
    out, report = tmp_path / "o.blend", tmp_path / "r.json"
    words = ["bake", "--object", "Head", "--audio", tone(tmp_path / "a.wav")]
    words += ["--save", str(out), "--report", str(report), "--weights"]
    command = addon("command").main
    (folder / "ats_compact" / "config.json").write_text("{}")
    assert command([*words, str(folder)]) == addon("core.errors").EXIT_CODES["weights"]
    assert not out.exists() and json.loads(report.read_text())["kind"] == "weights"


def test_a_shot_is_done_again_when_its_models_change(addon, folder, tmp_path):
    (tmp_path / "a.blend").write_bytes(b"")
    row = {"name": "a", "file": "a.blend", "save": "b.blend", "object": "Head", "weights": "models"}
    path = tmp_path / "jobs.json"
    path.write_text(json.dumps({"shots": [row]}))
    read = addon("farm.jobs").read
    first = read(path, tmp_path).shots[0]
    assert f"--weights={folder}" in first.steps[0]
    assert read(path, tmp_path).shots[0].digest == first.digest
    file = folder / "ats_compact" / "model.planes.gz"
    os.utime(file, ns=(0, file.stat().st_mtime_ns + 1_000_000_000))
    assert read(path, tmp_path).shots[0].digest != first.digest


def test_the_panel_shows_the_cards(addon, folder):
    bpy.context.scene.anyface.model_folder = str(folder)
    drawn = []
    panel = addon("ui.models").ANYFACE_PT_models
    layout = _Layout(drawn)
    context = argparse.Namespace(scene=bpy.context.scene, region=argparse.Namespace(width=300))
    panel.draw(argparse.Namespace(layout=layout), context)
    assert "My own voice" in drawn and "model_folder" in drawn
    assert str(folder / "ats_compact" / "README.md") in [shown.filepath for shown in layout.shown]
    bpy.context.scene.anyface.model_folder = str(folder / "nowhere")
    drawn.clear()
    panel.draw(argparse.Namespace(layout=layout), context)
    assert any("No models in" in text for text in drawn)


class _Layout:
    """A layout that records what is drawn."""

    def __init__(self, drawn, shown=None):
        self.drawn, self.shown = drawn, [] if shown is None else shown

    def row(self, **_):
        return _Layout(self.drawn, self.shown)

    column = row

    def label(self, text="", **_):
        self.drawn.append(text)

    def prop(self, _owner, name, **_):
        self.drawn.append(name)

    def operator(self, _name, **_):
        self.shown.append(argparse.Namespace(filepath=""))
        return self.shown[-1]
