"""Exports and sound: the reimported mesh moves in the same frames at every frame rate."""

import addon_utils
import bpy
import numpy as np
import pytest

from figures import curves, everything, grid, motion, own_keys, select, shape, stand_in, tone
from test_export import fbx_in, fbx_out, gltf_in, mask
from test_key_names import carrying

# Frames a second as Blender stores them: `fps` and `fps_base`.
RATES = {"24": (24, 1.0), "25": (25, 1.0), "29.97": (30, 1.001), "30": (30, 1.0), "60": (60, 1.0)}
SECONDS = 1.5
MAX_MM = 0.1
FRAMES = (1, 8, 16, 30)
NAMES = ("browDownLeft", "browDownRight", "browInnerUp", "browOuterUpLeft")


def gltf_out(path):
    """As the menu does it, but for the size of curves."""
    bpy.ops.export_scene.gltf(filepath=path, export_format="GLB")


FORMATS = {
    "gltf": ("io_scene_gltf2", "glb", gltf_out, gltf_in),
    "fbx": ("io_scene_fbx", "fbx", fbx_out, fbx_in),
    "usd": (
        "",
        "usdc",
        lambda path: bpy.ops.wm.usd_export(filepath=path, export_animation=True),
        lambda path: bpy.ops.wm.usd_import(filepath=path),
    ),
    "abc": (
        "",
        "abc",
        lambda path: bpy.ops.wm.alembic_export(filepath=path),
        lambda path: bpy.ops.wm.alembic_import(filepath=path, as_background_job=False),
    ),
}


@pytest.fixture
def stage(addon):
    """A `Stage` that replaces the engine."""
    return stand_in(addon)


def speaking(stage, tmp_path, rate, start=1, mode="basis"):
    """A face that speaks from scene frame `start` on, and a frame just before its sound ends."""
    scene = bpy.context.scene
    scene.render.fps, scene.render.fps_base = RATES[rate]
    ob = grid()
    if mode == "keys":
        own_keys(ob, *NAMES)
        carrying(stage, ob)
    ob.anyface.source, ob.anyface.start_frame, ob.anyface.mode = "FILE", start, mode
    ob.anyface.sound_file = tone(tmp_path / "tone.wav", SECONDS)
    fps = scene.render.fps / scene.render.fps_base
    scene.frame_end = start + int(np.ceil(SECONDS * fps)) + 20
    assert bpy.ops.anyface.generate() == {"FINISHED"}
    return ob, start + int(SECONDS * fps) - 2


def world(ob, frames):
    """Positions `[N, V, 3]` in the world."""
    places = []
    for frame in frames:
        points = shape(ob, frame)
        matrix = np.array(ob.matrix_world)
        places.append(points @ matrix[:3, :3].T + matrix[:3, 3])
    return np.array(places)


def needs_usd(addon, kind="usd"):
    """Skips a test of USD if Python cannot reach it, as in some Blenders and Python modules."""
    if kind == "usd" and not addon("scene.usd")._registered:
        pytest.skip("no USD here")


def button(path):
    """Exports as *Export Talking Head…* does."""
    assert bpy.ops.anyface.export(filepath=path) == {"FINISHED"}


@pytest.mark.parametrize("by", ["menu", "button"])
@pytest.mark.parametrize("rate", RATES)
@pytest.mark.parametrize("kind", FORMATS)
def test_what_comes_back_moves_with_the_sound(stage, addon, tmp_path, kind, rate, by):
    needs_usd(addon, kind)
    module, ending, write, read = FORMATS[kind]
    write = write if by == "menu" else button
    if module:
        addon_utils.enable(module, default_set=False)
    ob, last = speaking(stage, tmp_path, rate)
    before = world(ob, range(1, last + 1))
    assert np.abs(before - before[:1]).max() > 0.2 * stage.size
    path = str(tmp_path / f"head.{ending}")
    bpy.context.scene.frame_set(1)
    write(path)
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    if module:
        addon_utils.enable(module, default_set=False)
    bpy.context.scene.render.fps, bpy.context.scene.render.fps_base = RATES[rate]
    read(path)
    other = next(one for one in bpy.data.objects if one.type == "MESH")
    back = world(other, range(1 - 4, last + 1 + 4))
    # Importers may split and renumber vertices, so match the nearest ones in one frame.
    frame = len(before) // 3
    way = np.linalg.norm(back[4 + frame][:, None] - before[frame][None], axis=2)
    nearest = np.argmin(way, axis=1)
    expected = before[:, nearest]
    errors = {
        lag: np.linalg.norm(back[4 + lag :][: len(before)] - expected, axis=2).max()
        for lag in range(-4, 5)
    }
    assert min(errors, key=errors.get) == 0, errors
    assert 1000.0 * errors[0] <= MAX_MM, errors


def test_a_usd_file_has_weights_that_nobody_clamps(stage, addon, tmp_path):
    needs_usd(addon)
    ob, _ = speaking(stage, tmp_path, "24")
    mask(addon, ob)
    before, path = world(ob, FRAMES), str(tmp_path / "head.usdc")
    bpy.context.scene.frame_set(1)
    untouched = everything()
    bpy.ops.wm.usd_export(filepath=path, export_animation=True)
    assert everything() == untouched
    bpy.utils.expose_bundled_modules()
    from pxr import Usd

    file = Usd.Stage.Open(path)
    prims = list(file.Traverse())
    (animation,) = [prim for prim in prims if prim.GetTypeName() == "SkelAnimation"]
    weights = animation.GetAttribute("blendShapeWeights")
    samples = np.array([weights.Get(time) for time in weights.GetTimeSamples()])
    assert samples.min() >= 0.0 and samples.max() <= 1.0 and np.ptp(samples, axis=0).max() > 0.9
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    bpy.context.scene.render.fps = 24
    bpy.ops.wm.usd_import(filepath=path)
    other = next(one for one in bpy.data.objects if one.type == "MESH")
    assert 1000.0 * np.linalg.norm(world(other, FRAMES) - before, axis=2).max() <= MAX_MM


def first_keys(blocks):
    """The first frame of each curve of data-blocks."""
    fcurves = [curves(one.animation_data.action) for one in blocks if one.animation_data]
    return [curve.range()[0] for every in fcurves for curve in every]


@pytest.mark.parametrize("mode", ["basis", "arkit", "keys", "frames"])
@pytest.mark.parametrize("start", [1, 2, 40])
def test_no_keyframe_lies_before_the_scene(stage, tmp_path, mode, start):
    ob, _ = speaking(stage, tmp_path, "24", start, mode)
    firsts = first_keys([ob.data.shape_keys])
    # If there is room before the sound, the face starts from rest. If not, it starts in its first
    # pose.
    assert set(firsts) == {36.0 if start == 40 else float(start)}
    if start == 40:
        assert np.allclose(shape(ob, 1), shape(ob, 36), atol=1e-6)
        return
    earlier, first, then = shape(ob, start - 1), shape(ob, start), shape(ob, start + 1)
    assert np.allclose(earlier, first, atol=1e-6)
    if mode in ("basis", "frames"):
        moved = motion(int(np.ceil(SECONDS * 24)), len(first), stage.rank, stage.size)[0]
        rest = np.array([vertex.co for vertex in ob.data.vertices])
        assert np.allclose(first - rest, moved, atol=1e-5)
    assert np.abs(then - first).max() < 0.5 * stage.size


def test_the_button_exports_the_face_with_its_parts_or_all(stage, addon, tmp_path):
    needs_usd(addon)
    teeth = grid("Teeth_lower", 5, 0.02)
    ob, _ = speaking(stage, tmp_path, "24")
    lamp = bpy.data.objects.new("Lamp", None)
    bpy.context.scene.collection.objects.link(lamp)
    assert [part.object for part in ob.anyface_face.parts] == [teeth]
    select(lamp)
    bpy.context.view_layer.objects.active = ob
    before = everything()
    for whole, names in ((False, {"Head", "Teeth_lower"}), (True, {"Head", "Lamp", "Teeth_lower"})):
        path = tmp_path / f"{whole}.usdc"
        assert bpy.ops.anyface.export(filepath=str(path), whole_scene=whole) == {"FINISHED"}
        bpy.utils.expose_bundled_modules()
        from pxr import Usd

        file = Usd.Stage.Open(str(path))
        prims = {prim.GetName() for prim in file.Traverse() if prim.GetParent().GetName() == "root"}
        assert {name for name in prims if name in ("Head", "Lamp", "Teeth_lower")} == names
    assert everything() == before and lamp.select_get() and not ob.select_get()


def test_what_a_format_cannot_hold_is_said(stage, tmp_path):
    addon_utils.enable("io_scene_gltf2", default_set=False)
    speaking(stage, tmp_path, "24", 1, "frames")
    with pytest.raises(RuntimeError, match="one key per frame, which glTF cannot play"):
        bpy.ops.anyface.export(filepath=str(tmp_path / "head.glb"))
    assert bpy.ops.anyface.export(filepath=str(tmp_path / "head"), kind="ABC") == {"FINISHED"}
    assert (tmp_path / "head.abc").is_file()
    addon_utils.disable("io_scene_fbx", default_set=False)
    with pytest.raises(RuntimeError, match="turn the add-on io_scene_fbx on"):
        bpy.ops.anyface.export(filepath=str(tmp_path / "head.fbx"))
    bpy.ops.anyface.remove()
    assert not bpy.ops.anyface.export.poll()
