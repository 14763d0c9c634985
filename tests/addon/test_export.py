"""Exports that carry shape keys: what comes back moves as what went out."""

import addon_utils
import bpy
import numpy as np
import pytest

from figures import Stage, grid, own_keys, shape, tone

START = 5
FRAMES = (1, START, START + 7, START + 20, START + 47)


@pytest.fixture
def stage(addon):
    """A stage in the engine's place."""
    stage = Stage(addon("core.take"))
    addon("ui.running")._engine = stage
    return stage


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
    """Positions `[V, 3]` in the world at a frame, in an order that no importer changes."""
    points = shape(ob, frame)
    matrix = np.array(ob.matrix_world)
    return points @ matrix[:3, :3].T + matrix[:3, 3]


@pytest.mark.parametrize("kind", EXPORTS)
@pytest.mark.parametrize("mode", ["basis", "arkit"])
def test_the_same_motion_comes_back(stage, tmp_path, kind, mode):
    module, ending, write, read = EXPORTS[kind]
    addon_utils.enable(module, default_set=False)
    ob = ready(tmp_path, mode)
    assert bpy.ops.anyface.generate() == {"FINISHED"}
    rest = world(ob, -50)
    before = {frame: world(ob, frame) for frame in FRAMES}
    bpy.context.scene.frame_set(1)
    path = str(tmp_path / f"head.{ending}")
    write(path)
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    addon_utils.enable(module, default_set=False)
    bpy.context.scene.render.fps = 24
    read(path)
    other = next(ob for ob in bpy.data.objects if ob.type == "MESH")
    back = world(other, -50)
    # Importers may split and renumber vertices: each finds the nearest one at rest.
    nearest = np.argmin(np.linalg.norm(back[:, None] - rest[None], axis=2), axis=1)
    assert np.abs(back - rest[nearest]).max() < 1e-5
    for frame in FRAMES:
        moved = world(other, frame)
        assert np.abs(moved - before[frame][nearest]).max() < 0.01 * stage.size, frame
    assert np.abs(before[START + 20] - rest).max() > 0.2 * stage.size
