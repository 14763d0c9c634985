"""When the library of a linked character changes, its stale cache is reported everywhere."""

import json
from pathlib import Path

import bpy
import pytest

from figures import grid, stand_in, tone
from test_outputs import ready
from test_panels import Paper


@pytest.fixture
def stage(addon):
    """A stage that stands in for the engine."""
    return stand_in(addon)


def change(path, how):
    """Opens the library, lets `how` change the mesh, and saves it."""
    bpy.ops.wm.open_mainfile(filepath=str(path))
    how(bpy.data.objects["Head"])
    bpy.ops.wm.save_mainfile()


@pytest.fixture
def shot(stage, tmp_path):
    """A saved shot in which a linked character plays its cache; the library is beside it."""
    grid()
    library, shot = str(tmp_path / "library.blend"), str(tmp_path / "shot.blend")
    bpy.ops.wm.save_as_mainfile(filepath=library)
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    bpy.ops.wm.save_as_mainfile(filepath=shot)
    with bpy.data.libraries.load(library, link=True) as (_, target):
        target.objects = ["Head"]
    ob = bpy.data.objects["Head"].override_create(remap_local_usages=True)
    bpy.context.scene.collection.objects.link(ob)
    bpy.context.view_layer.objects.active = ob
    ready(tmp_path, "cache", ob, save=False)
    assert bpy.ops.anyface.generate() == {"FINISHED"}
    bpy.ops.wm.save_mainfile()
    return Path(shot)


def head():
    ob = next(ob for ob in bpy.data.objects if ob.override_library is not None)
    bpy.context.view_layer.objects.active = ob
    return ob


def scale(by):
    def how(ob):
        for vertex in ob.data.vertices:
            vertex.co *= by

    return how


def push(ob):
    ob.data.vertices[40].co.y += 0.01


def grow(ob):
    ob.data.vertices.add(3)


def drawn(addon, ob):
    words = []
    addon("ui.panel")._draw_report(Paper(words), ob, 4000)
    return " ".join(text for text, _ in words if text)


def test_a_cache_of_the_mesh_as_it_is_says_nothing(addon, shot, capfd):
    bpy.ops.wm.open_mainfile(filepath=str(shot))
    assert addon("scene.stale").of(head()) == "" and "since its cache" not in capfd.readouterr().err


@pytest.mark.parametrize(
    ("how", "said"),
    [
        (scale(1.25), "1.25 times as large"),
        (push, "another shape, by up to"),
        (grow, "expected a cache of 147 vertices, got 144"),
    ],
)
def test_a_library_that_has_changed_is_told_at_load_and_in_the_panel(addon, shot, capfd, how, said):
    change(shot.with_name("library.blend"), how)
    capfd.readouterr()
    bpy.ops.wm.open_mainfile(filepath=str(shot))
    assert said in capfd.readouterr().err
    ob = head()
    assert said in addon("scene.stale").of(ob) and said in drawn(addon, ob)
    assert bpy.ops.anyface.generate() == {"FINISHED"}
    assert addon("scene.stale").of(ob) == "" and said not in drawn(addon, ob)


def test_a_cache_whose_file_is_gone_says_so(addon, shot):
    bpy.ops.wm.open_mainfile(filepath=str(shot))
    for path in shot.parent.rglob("*.pc2"):
        path.unlink()
    assert "no cache at" in addon("scene.stale").of(head())


def test_baking_another_face_of_the_shot_tells_of_it(addon, stage, shot, tmp_path):
    change(shot.with_name("library.blend"), push)
    bpy.ops.wm.open_mainfile(filepath=str(shot))
    grid("Other")
    bpy.ops.wm.save_mainfile()
    report, sound = tmp_path / "report.json", tone(tmp_path / "other.wav")
    words = ["bake", "--file", shot, "--object", "Other", "--audio", sound, "--report", report]
    words += ["--save", tmp_path / "out.blend"]
    assert addon("command").main([str(word) for word in words]) == 0
    outcome = json.loads(report.read_text())
    assert outcome["ok"] and "another shape" in outcome["message"]
    (stale,) = outcome["stale_caches"]
    assert stale.startswith("Head") and "generate again" in stale


def test_a_shot_of_the_farm_tells_of_it_in_its_report(addon, stage, shot, tmp_path, monkeypatch):
    change(shot.with_name("library.blend"), push)
    bpy.ops.wm.open_mainfile(filepath=str(shot))
    grid("Other")
    bpy.ops.wm.save_mainfile()
    step = ["bake", "--object=Other", f"--audio={tone(tmp_path / 'other.wav')}"]
    row = {"file": str(shot), "save": str(tmp_path / "out.blend"), "steps": [step]}
    done = addon("command.shot")._do(row)
    assert "another shape" in done["message"] and len(done["faces"][0]["stale_caches"]) == 1
