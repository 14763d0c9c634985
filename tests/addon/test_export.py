"""Exports with shape keys: the reimported mesh moves like the exported one."""

import json
import struct

import addon_utils
import bpy
import numpy as np
import pytest

from figures import curves, everything, grid, own_keys, shape, stand_in, tone

START = 5
FRAMES = (1, START, START + 7, START + 20, START + 47)


@pytest.fixture
def stage(addon):
    """A `Stage` that replaces the engine."""
    return stand_in(addon)


def gltf_out(path):
    bpy.ops.export_scene.gltf(
        filepath=path,
        export_format="GLB",
        export_animations=True,
        export_morph_animation=True,
        export_force_sampling=True,
        export_optimize_animation_size=False,
    )


def gltf_in(path):
    bpy.ops.import_scene.gltf(filepath=path)


def fbx_out(path):
    bpy.ops.export_scene.fbx(
        filepath=path,
        bake_anim_use_nla_strips=False,
        bake_anim_use_all_actions=False,
        bake_anim_simplify_factor=0.0,
    )


def fbx_in(path):
    bpy.ops.import_scene.fbx(filepath=path, anim_offset=0.0)


EXPORTS = {
    "gltf": ("io_scene_gltf2", "glb", gltf_out, gltf_in),
    "fbx": ("io_scene_fbx", "fbx", fbx_out, fbx_in),
}


def ready(tmp_path, mode):
    scene = bpy.context.scene
    scene.render.fps, scene.frame_start, scene.frame_end = 24, 1, 60
    ob = grid()
    own_keys(ob, "Smile")
    ob.anyface.source, ob.anyface.start_frame, ob.anyface.mode = "FILE", START, mode
    ob.anyface.sound_file = tone(tmp_path / "tone.wav")
    return ob


def world(ob, frame):
    """Positions `[V, 3]` in the world at a frame."""
    points = shape(ob, frame)
    matrix = np.array(ob.matrix_world)
    return points @ matrix[:3, :3].T + matrix[:3, 3]


def mask(addon, ob):
    """Masks every other key of the take with a vertex group."""
    group = ob.vertex_groups.new(name=addon("scene.face.emotion_mask").NAME)
    for vertex in range(len(ob.data.vertices)):
        group.add([vertex], (0.0, 0.5, 1.0)[vertex % 3], "REPLACE")
    for name in addon("scene.shape_keys.record").read(ob.data.shape_keys).keys[::2]:
        ob.data.shape_keys.key_blocks[name].vertex_group = group.name


@pytest.mark.parametrize(
    ("kind", "mode"),
    [("gltf", "basis"), ("gltf", "arkit"), ("gltf", "masked"), ("fbx", "basis"), ("fbx", "arkit")],
)
def test_the_same_motion_comes_back(addon, stage, tmp_path, kind, mode):
    module, ending, write, read = EXPORTS[kind]
    addon_utils.enable(module, default_set=False)
    ob = ready(tmp_path, "basis" if mode == "masked" else mode)
    assert bpy.ops.anyface.generate() == {"FINISHED"}
    if mode == "masked":
        mask(addon, ob)
    rest = world(ob, -50)
    before = {frame: world(ob, frame) for frame in FRAMES}
    bpy.context.scene.frame_set(1)
    path, untouched = str(tmp_path / f"head.{ending}"), everything()
    write(path)
    assert everything() == untouched
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    addon_utils.enable(module, default_set=False)
    bpy.context.scene.render.fps = 24
    read(path)
    other = next(ob for ob in bpy.data.objects if ob.type == "MESH")
    back = world(other, -50)
    # Importers may split and renumber vertices, so match each to the nearest one at rest.
    nearest = np.argmin(np.linalg.norm(back[:, None] - rest[None], axis=2), axis=1)
    assert np.abs(back - rest[nearest]).max() < 1e-5
    for frame in FRAMES:
        moved = world(other, frame)
        assert np.abs(moved - before[frame][nearest]).max() < 0.01 * stage.size, frame
    assert np.abs(before[START + 20] - rest).max() > 0.2 * stage.size


def weights_of(path):
    """Every weight of every morph animation in a GLB file."""
    data = path.read_bytes()
    length = struct.unpack("<I", data[12:16])[0]
    document, binary = json.loads(data[20 : 20 + length]), data[28 + length :]
    weights = []
    for animation in document["animations"]:
        for channel in animation["channels"]:
            if channel["target"]["path"] == "weights":
                sampler = animation["samplers"][channel["sampler"]]
                accessor = document["accessors"][sampler["output"]]
                view = document["bufferViews"][accessor["bufferView"]]
                at = view.get("byteOffset", 0) + accessor.get("byteOffset", 0)
                weights.append(np.frombuffer(binary, "<f4", accessor["count"], at))
    return weights


def test_a_gltf_file_has_weights_that_no_engine_clamps(stage, tmp_path):
    addon_utils.enable("io_scene_gltf2", default_set=False)
    ob = ready(tmp_path, "basis")
    assert bpy.ops.anyface.generate() == {"FINISHED"}
    action = ob.data.shape_keys.animation_data.action
    assert min(point.co[1] for curve in curves(action) for point in curve.keyframe_points) < -0.5
    gltf_out(str(tmp_path / "head.glb"))
    weights = weights_of(tmp_path / "head.glb")
    assert weights and all(w.min() >= 0.0 and w.max() <= 1.0 for w in weights)
    assert any(np.ptp(w) > 0.9 for w in weights)


def test_takes_beside_the_one_that_plays_are_exported_and_stay(stage, tmp_path, addon):
    ob = ready(tmp_path, "basis")
    for _ in range(2):
        ob.anyface_output.new_take = True
        assert bpy.ops.anyface.generate() == {"FINISHED"}
    row = addon("scene.takes.take_list").rows(ob)[0]
    assert bpy.ops.anyface.take_push_down(take=row.id) == {"FINISHED"}
    before = {frame: world(ob, frame) for frame in FRAMES}
    gltf, untouched = addon("scene.gltf"), everything()
    gltf.before_export({})
    names = [block.name for block in ob.data.shape_keys.key_blocks]
    assert sum(name.startswith("Anyface.standing") for name in names) == 2
    assert all(block.slider_min >= 0.0 for block in ob.data.shape_keys.key_blocks)
    for frame in FRAMES:
        assert np.abs(world(ob, frame) - before[frame]).max() < 1e-3 * stage.size, frame
    gltf.after_export({})
    assert everything() == untouched


def test_what_an_export_that_failed_has_left_is_put_back_by_the_next(stage, tmp_path, addon):
    addon_utils.enable("io_scene_gltf2", default_set=False)
    ready(tmp_path, "basis")
    assert bpy.ops.anyface.generate() == {"FINISHED"}
    untouched = everything()
    addon("scene.gltf").before_export({})
    assert everything() != untouched
    gltf_out(str(tmp_path / "head.glb"))
    assert everything() == untouched


def test_a_face_of_the_same_name_in_another_file_is_left_alone(stage, tmp_path, addon):
    ready(tmp_path, "basis")
    assert bpy.ops.anyface.generate() == {"FINISHED"}
    addon("scene.gltf").before_export({})
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    own_keys(grid(), "Frown")
    other = everything()
    addon("scene.gltf").after_export({})
    assert everything() == other
