"""The buttons of the installed zip lose none of the artist's work, in any state of a face."""

import gc
import importlib
import os
import threading
import time
import weakref
from pathlib import Path

import bpy
import numpy as np
import pytest

import test_keys
from conftest import PACKAGE
from figures import everything, grid, link_from_library, own_keys, shape, stand_in, tone
from test_keys import artist_action, artist_driver, artist_keys, artist_nla


@pytest.fixture
def stage(addon):
    """A stage that stands in for the engine."""
    return stand_in(addon)


def artist_armature(ob):
    """A head with keys that an armature with a posed bone deforms."""
    rig = bpy.data.objects.new("Rig", bpy.data.armatures.new("Rig"))
    bpy.context.scene.collection.objects.link(rig)
    bpy.context.view_layer.objects.active = rig
    bpy.ops.object.mode_set(mode="EDIT")
    bone = rig.data.edit_bones.new("Head")
    bone.tail = (0.0, 0.0, 0.2)
    bpy.ops.object.mode_set(mode="OBJECT")
    group = ob.vertex_groups.new(name="Head")
    group.add(list(range(len(ob.data.vertices))), 1.0, "REPLACE")
    ob.modifiers.new("Armature", "ARMATURE").object = rig
    rig.pose.bones["Head"].location.x = 0.1
    bpy.context.view_layer.objects.active = ob
    artist_keys(ob)


def artist_constraint(ob):
    """Keys on an object with a rotated parent and an uneven, partly negative scale."""
    parent = bpy.data.objects.new("Parent", None)
    bpy.context.scene.collection.objects.link(parent)
    ob.parent, ob.scale = parent, (-1.0, 2.0, 0.5)
    parent.rotation_euler.z = 1.2
    artist_keys(ob)


def artist_pinned(ob):
    """Solo is on, one key is muted, and one key has a range of its own."""
    artist_keys(ob)
    ob.show_only_shape_key = True
    blocks = ob.data.shape_keys.key_blocks
    blocks["Frown"].mute, blocks["Smile"].slider_max = True, 3.0


def artist_sculpt(ob):
    """Sculpt mode."""
    artist_keys(ob)
    bpy.ops.object.mode_set(mode="SCULPT")


def artist_object_animation(ob):
    """A curve and a driver on the object itself, and a curve on a slider of the panel."""
    ob.keyframe_insert("location", frame=1)
    ob.anyface.intensity = 0.4
    ob.keyframe_insert("anyface.intensity", frame=1)
    ob.driver_add("scale", 0).driver.expression = "1.0"


ARTISTS = [
    *test_keys.ARTISTS,
    artist_armature,
    artist_constraint,
    artist_pinned,
    artist_sculpt,
    artist_object_animation,
]


def speaking(ob, tmp_path):
    """Gives `ob` two seconds of sound from frame 1 on, and makes it the scene's character."""
    bpy.context.scene.render.fps = 24
    ob.anyface.source, ob.anyface.sound_file = "FILE", tone(tmp_path / "a.wav")
    bpy.context.scene.anyface.character = ob
    return ob


@pytest.mark.parametrize("artist", ARTISTS)
def test_generate_twice_and_remove_leaves_everything_as_it_was(stage, tmp_path, artist):
    ob = speaking(grid(), tmp_path)
    artist(ob)
    bpy.context.scene.frame_set(5)
    before, modifiers = everything(), [modifier.name for modifier in ob.modifiers]
    for _ in range(2):
        assert bpy.ops.anyface.generate() == {"FINISHED"}
        assert not ob.anyface.report_is_error
        assert [modifier.name for modifier in ob.modifiers] == modifiers
    bpy.context.scene.frame_set(5)
    assert everything() != before
    assert bpy.ops.anyface.remove() == {"FINISHED"}
    bpy.context.scene.frame_set(5)
    assert everything() == before


def artist_subdivision(ob):
    """A subdivision modifier."""
    artist_keys(ob)
    ob.modifiers.new("Subdivision", "SUBSURF").levels = 2


@pytest.mark.parametrize("artist", [artist_subdivision, artist_armature, artist_driver, artist_nla])
def test_the_face_moves_under_what_the_artist_has_put_on_it(stage, tmp_path, artist):
    ob = speaking(grid(), tmp_path)
    artist(ob)
    bpy.ops.anyface.generate()
    moved = shape(ob, 12) - shape(ob, -30)
    assert np.linalg.norm(moved, axis=1).max() > 0.3 * stage.size


def test_absolute_keys_of_the_artist_are_refused_and_stay(stage, tmp_path):
    ob = speaking(grid(), tmp_path)
    own_keys(ob, "One", "Two").use_relative = False
    before = everything()
    with pytest.raises(RuntimeError, match=r"absolute.*turn Relative on"):
        bpy.ops.anyface.generate()
    assert everything() == before


def test_a_key_that_is_shown_alone_is_pointed_out(stage, tmp_path):
    ob = speaking(grid(), tmp_path)
    artist_pinned(ob)
    bpy.ops.anyface.generate()
    assert "turn Solo off" in ob.anyface.report


def library(tmp_path):
    """A head that is linked from a library file into an empty file."""
    grid("Head")
    return link_from_library("Head", tmp_path)


def test_linked_faces_are_refused_with_the_remedy(stage, tmp_path):
    ob = library(tmp_path)
    bpy.context.scene.anyface.character = ob
    for operator in (bpy.ops.anyface.generate, bpy.ops.anyface.find_face):
        with pytest.raises(RuntimeError, match=r"linked.*local"):
            operator()
    assert ob.data.shape_keys is None


def test_overridden_faces_are_refused_with_the_remedy(stage, tmp_path):
    ob = library(tmp_path).override_create(remap_local_usages=True)
    speaking(ob, tmp_path)
    before = everything()
    with pytest.raises(RuntimeError, match=r"linked from.*make object and mesh local"):
        bpy.ops.anyface.generate()
    assert everything() == before and "local" in ob.anyface.report


def test_a_local_mesh_of_an_overridden_object_is_animated(stage, tmp_path):
    ob = library(tmp_path).override_create(remap_local_usages=True)
    ob.data = ob.data.copy()
    speaking(ob, tmp_path)
    assert bpy.ops.anyface.generate() == {"FINISHED"}
    assert np.abs(shape(ob, 12) - shape(ob, -30)).max() > 1e-3


def test_half_a_face_before_a_mirror_modifier_is_refused(stage, tmp_path):
    ob = speaking(grid(), tmp_path)
    for vertex in ob.data.vertices:
        vertex.co.x += 0.1
    ob.modifiers.new("Mirror", "MIRROR")
    with pytest.raises(RuntimeError, match=r"half a face, .* Mirror modifier .* apply"):
        bpy.ops.anyface.generate()
    assert ob.data.shape_keys is None
    for vertex in ob.data.vertices:
        vertex.co.x += 0.1
    assert bpy.ops.anyface.generate() == {"FINISHED"}


def test_a_mirror_modifier_is_named_where_no_face_is_found(stage, addon, tmp_path, monkeypatch):
    ob = speaking(grid(), tmp_path)
    ob.modifiers.new("Mirror", "MIRROR")
    error = addon("core.errors").AnyfaceError("face", "no face")
    monkeypatch.setattr(stage, "animate", lambda *_: (_ for _ in ()).throw(error))
    with pytest.raises(RuntimeError, match="Mirror modifier: apply it"):
        bpy.ops.anyface.generate()


def test_the_wrong_selection_is_explained(stage):
    bpy.ops.object.camera_add()
    assert not bpy.ops.anyface.generate.poll()
    for operator in (bpy.ops.anyface.find_face, bpy.ops.anyface.find_parts):
        with pytest.raises(RuntimeError, match="Pick a face mesh"):
            operator()
    bpy.context.view_layer.objects.active = None
    assert not bpy.ops.anyface.generate.poll() and not bpy.ops.anyface.remove.poll()


def test_a_sound_that_is_gone_and_an_object_that_is_gone_are_named(stage, tmp_path):
    ob = speaking(grid(), tmp_path)
    (tmp_path / "a.wav").unlink()
    with pytest.raises(RuntimeError, match=r"no sound file at .*a\.wav"):
        bpy.ops.anyface.generate()
    bpy.data.objects.remove(ob)
    with pytest.raises(RuntimeError, match="Pick a face mesh"):
        bpy.ops.anyface.generate()


def test_it_works_without_internet_and_opens_no_connection(addon, tmp_path, monkeypatch):
    import socket

    from test_heads import import_head

    def refuse(*_):
        raise AssertionError("a connection was opened")

    monkeypatch.setattr(socket.socket, "connect", refuse)
    bpy.context.preferences.system.use_online_access = False
    assert not bpy.app.online_access
    import_head()
    assert bpy.ops.anyface.find_face() == {"FINISHED"}


def test_a_batch_opens_a_connection_only_where_blender_allows_it(addon, tmp_path, capsys):
    jobs = tmp_path / "jobs.json"
    jobs.write_text('{"shots": []}')
    system, words = bpy.context.preferences.system, "Allow Online Access is off"
    batch = ["batch", str(jobs), "--scheduler", "tcp://127.0.0.1:9"]
    before = system.use_online_access
    try:
        system.use_online_access = False
        assert addon("command").main(batch) == addon("core.errors").EXIT_CODES["input"]
        assert words in capsys.readouterr().err
        assert addon("command").main(batch[:2]) == 0
        system.use_online_access = True
        addon("command").main(batch)
        assert words not in capsys.readouterr().err
    finally:
        system.use_online_access = before


def test_files_are_written_in_its_own_user_folder_only(addon):
    from test_heads import import_head

    users = Path(os.environ["XDG_CACHE_HOME"])
    addon("ui.running")._engines.clear()
    ob, before = import_head(), sorted(users.rglob("*"))
    # No other test has given this mesh to the library, so no result for it is in the cache.
    ob.data.vertices[0].co.x += 1e-4
    bpy.ops.anyface.find_face()
    cache = Path(bpy.utils.extension_path_user(PACKAGE, path="cache"))
    assert any(cache.rglob("*"))
    assert sorted(users.rglob("*")) == before


def test_the_folder_of_the_installed_code_stays_as_it_is(stage, installed, tmp_path):
    def listing():
        return sorted(p for p in installed.rglob("*") if "__pycache__" not in p.parts)

    before = listing()
    speaking(grid(), tmp_path)
    bpy.ops.anyface.generate()
    bpy.ops.anyface.preset_save(name="Mine")
    bpy.ops.anyface.preset_delete(name="Mine")
    assert listing() == before


def test_it_can_be_disabled_and_enabled_again_with_a_job_running(addon, tmp_path):
    running, job = addon("ui.running"), addon("core.job")
    steps = []

    def endless(progress):
        while True:
            progress.check("deform", 0.5)
            steps.append(1)
            time.sleep(0.005)

    started = running.start(job.Job(endless), "Head")
    assert running.is_running()
    bpy.ops.preferences.addon_disable(module=PACKAGE)
    assert started.done and started.progress.cancelled
    count = len(steps)
    time.sleep(0.05)
    assert len(steps) == count
    bpy.ops.preferences.addon_enable(module=PACKAGE)
    fresh = importlib.import_module(f"{PACKAGE}.ui.running")
    assert not fresh.is_running()
    stand_in(addon)
    ob = speaking(grid(), tmp_path)
    assert bpy.ops.anyface.generate() == {"FINISHED"} and ob.data.shape_keys is not None


def test_without_its_library_it_can_be_enabled_and_says_why_nothing_moves(
    addon, tmp_path, monkeypatch
):
    def enable_again():
        bpy.ops.preferences.addon_disable(module=PACKAGE)
        addon("core.systems").known.cache_clear()
        bpy.ops.preferences.addon_enable(module=PACKAGE)

    monkeypatch.setenv("ANYFACE_LIBRARY", "/nowhere/libanyface.so")
    enable_again()
    try:
        ob = speaking(grid(), tmp_path)
        assert not hasattr(ob.anyface, "articulation") and not hasattr(ob.anyface, "system")
        assert bpy.ops.anyface.preset_save(name="Mine") == {"FINISHED"}
        bpy.ops.anyface.preset_delete(name="Mine")
        with pytest.raises(RuntimeError, match="the native library cannot be used"):
            bpy.ops.anyface.generate()
        assert "nowhere" in ob.anyface.report
    finally:
        monkeypatch.undo()
        enable_again()
    assert ob.anyface.articulation == 1.0


def test_a_cancelled_job_ends_before_its_engine_is_freed(addon):
    running, job = addon("ui.running"), addon("core.job")
    order, free = [], threading.Event()

    class Engine:
        def close(self):
            order.append("freed")

    def deaf(progress):
        free.wait(5.0)
        order.append("ended")

    running._engines["", None, 0, None] = Engine()
    started = running.start(job.Job(deaf), "Head")
    started.cancel()
    running.finish()
    threading.Timer(0.2, free.set).start()
    running.stop()
    assert started.done and order == ["ended", "freed"]
    # Nothing keeps a reference to the job.
    there = weakref.ref(started)
    del started
    gc.collect()
    assert there() is None


def test_opening_another_file_ends_the_job(addon):
    running, job = addon("ui.running"), addon("core.job")
    started = running.start(job.Job(lambda progress: _wait(progress)), "Head")
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    assert started.progress.cancelled and not running.is_running()


def _wait(progress):
    while True:
        progress.check("deform")
        time.sleep(0.005)


CYCLES = int(os.environ.get("ANYFACE_CYCLES", "12"))


def blocks():
    """How many data-blocks of each kind there are."""
    kinds = ("objects", "meshes", "shape_keys", "actions", "sounds", "images", "texts", "curves")
    return {kind: len(getattr(bpy.data, kind)) for kind in kinds}


def test_cycles_of_generate_and_remove_leave_no_data_blocks(stage, tmp_path):
    ob = speaking(grid(side=40), tmp_path)
    teeth = grid("Teeth_lower", side=6, scale=0.05)
    bpy.ops.anyface.find_parts()
    assert [part.object for part in ob.anyface_face.parts] == [teeth]
    artist_action(ob)
    bpy.context.scene.frame_set(5)
    before, counts = everything(), blocks()
    for number in range(CYCLES):
        assert bpy.ops.anyface.generate() == {"FINISHED"}
        assert bpy.ops.anyface.remove() == {"FINISHED"}
        stage.calls.clear()
        assert blocks() == counts, number
    bpy.context.scene.frame_set(5)
    assert everything() == before
