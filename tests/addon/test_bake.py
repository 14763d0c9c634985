"""From settings to keys: operators, snapshot, messages. The library is replaced by a stage."""

import json

import bpy
import numpy as np
import pytest

from figures import everything, grid, own_keys, shape, stand_in, tone


@pytest.fixture
def stage(addon):
    """A stage in the engine's place."""
    return stand_in(addon)


def ready(tmp_path, **settings):
    """A head with a sound file, ready to generate."""
    bpy.context.scene.render.fps = 24
    ob = grid()
    ob.anyface.source = "FILE"
    ob.anyface.sound_file = tone(tmp_path / "tone.wav")
    ob.anyface.start_frame = 5
    for name, value in settings.items():
        setattr(ob.anyface, name, value)
    return ob


def test_generate_and_remove(stage, tmp_path):
    ob = ready(tmp_path)
    before = everything()
    assert bpy.ops.anyface.generate() == {"FINISHED"}
    assert "48 frames" in ob.anyface.report and "shape keys" in ob.anyface.report
    assert np.abs(shape(ob, 10) - shape(ob, 0)).max() > 1e-3
    bpy.context.scene.frame_set(1)
    assert bpy.ops.anyface.remove() == {"FINISHED"}
    assert everything() == before


def test_one_undo_step_each(stage, tmp_path):
    ready(tmp_path)
    bpy.ops.ed.undo_push(message="before")
    bpy.ops.anyface.generate()
    bpy.ops.ed.undo_push(message="Generate")
    assert bpy.data.shape_keys
    bpy.ops.ed.undo()
    assert not bpy.data.shape_keys and not bpy.data.actions
    bpy.ops.ed.redo()
    assert bpy.data.shape_keys
    assert bpy.ops.anyface.remove() == {"FINISHED"}
    assert not bpy.data.shape_keys


def test_the_library_sees_the_head_in_the_world(stage, tmp_path):
    ob = ready(tmp_path, axes="WORLD", seed=7, steps=4, intensity=0.5, emotion="happy")
    ob.rotation_euler.x, ob.scale = 1.5707963, (2.0, 2.0, 0.5)
    ob.scale.x = -2.0
    bpy.context.view_layer.update()
    bpy.ops.anyface.generate()
    positions, triangles, points, numbers, _, request = stage.calls[0]
    local = np.array([vertex.co for vertex in ob.data.vertices])
    expected = [ob.matrix_world @ vertex.co for vertex in ob.data.vertices]
    assert np.abs(positions - np.array(expected)).max() < 1e-5
    assert len(local) == len(positions) and len(triangles) == 2 * 11 * 11
    assert points is None and numbers is None
    assert (request.fields["seed"], request.controls["steps"], request.fps) == (7, 4, 24.0)
    assert request.fields["emotion"] == [(0.0, [0, 0.5] + [0] * 13)]
    # A mirrored object gets its winding reversed: the first triangle's normal still points outside.
    first = ob.data.polygons[0]
    assert list(triangles[0]) != list(first.vertices)[:3]
    moved = shape(ob, 10) - shape(ob, 0)
    world = moved @ np.array(ob.matrix_world)[:3, :3].T
    assert np.linalg.norm(world, axis=1).max() <= stage.size * 1.03


def test_landmarks_of_the_artist_reach_the_library(stage, tmp_path):
    ob = ready(tmp_path, axes="WORLD")
    ob.location.x = 3.0
    bpy.context.view_layer.update()
    points = np.random.default_rng(0).uniform(-0.1, 0.1, (68, 3))
    ob["anyface_landmarks"] = json.dumps(points.tolist())
    bpy.ops.anyface.generate()
    assert np.abs(stage.calls[0][2] - points - (3.0, 0.0, 0.0)).max() < 1e-5
    path = tmp_path / "landmarks.json"
    path.write_text(json.dumps({"vertices": list(range(68))}))
    ob["anyface_landmarks"] = str(path)
    bpy.ops.anyface.generate()
    assert stage.calls[1][2] is None and list(stage.calls[1][3]) == list(range(68))


def test_landmark_files_fit_turned_meshes_by_vertex_number(stage, tmp_path):
    ob = ready(tmp_path, axes="WORLD")
    rest = np.array([vertex.co for vertex in ob.data.vertices])
    rows = [
        {"index": n, "position": (rest[n] + 0.001).tolist(), "vertex": n, "confidence": 1.0}
        for n in range(68)
    ]
    ob["anyface_landmarks"] = json.dumps({"version": 1, "landmarks": rows[::-1]})
    bpy.ops.anyface.generate()
    assert np.abs(stage.calls[0][2] - rest[:68] - 0.001).max() < 1e-5
    for row in rows:
        row["position"] = [100.0 * row["position"][2], 0.0, 100.0 * row["position"][0]]
    ob["anyface_landmarks"] = json.dumps({"version": 1, "landmarks": rows})
    bpy.ops.anyface.generate()
    assert stage.calls[1][2] is None and list(stage.calls[1][3]) == list(range(68))
    path = tmp_path / "other.json"
    path.write_text(json.dumps(list(range(68, 136))))
    ob.anyface.landmark_file = str(path)
    bpy.ops.anyface.generate()
    assert list(stage.calls[2][3]) == list(range(68, 136))


def failure(ob):
    with pytest.raises(RuntimeError) as caught:
        bpy.ops.anyface.generate()
    assert ob.anyface.report_is_error
    assert ob.anyface.report in str(caught.value)
    return ob.anyface.report


def test_wrong_landmarks_are_described(stage, tmp_path):
    ob = ready(tmp_path)
    ob["anyface_landmarks"] = json.dumps([[0, 0, 0]] * 67)
    assert "shape [67, 3]" in failure(ob)
    ob["anyface_landmarks"] = "[1, 2"
    assert "not JSON" in failure(ob)
    ob["anyface_landmarks"] = str(tmp_path / "nowhere.json")
    assert "nowhere.json" in failure(ob)


def test_nothing_moved_is_an_error_with_its_reason(stage, tmp_path):
    ob = ready(tmp_path)
    before = everything()
    stage.size = 1e-6
    assert "nothing moved" in failure(ob) and "tone.wav" in ob.anyface.report
    ob.anyface.sound_file = tone(tmp_path / "silence.wav", silent_until=9.0)
    assert "silence.wav is silent" in failure(ob)
    assert everything() == before


def test_missing_sound_and_bad_meshes_are_named(stage, tmp_path):
    ob = ready(tmp_path, sound_file="")
    with pytest.raises(RuntimeError, match="no sound"):
        bpy.ops.anyface.generate()
    ob = ready(tmp_path)
    ob.data.clear_geometry()
    assert "no vertices" in failure(ob)
    ob.data.vertices.add(3)
    assert "no faces" in failure(ob)


def test_keyframed_emotion_becomes_a_curve(stage, tmp_path):
    ob = ready(tmp_path, emotion="sad")
    for frame, value in ((5, 0.0), (53, 1.0)):
        ob.anyface.intensity = value
        ob.keyframe_insert("anyface.intensity", frame=frame)
    bpy.ops.anyface.generate()
    keys = stage.calls[0][5].fields["emotion"]
    assert keys[0] == (0.0, [0.0] * 15)
    times, values = zip(*[(time, row[5]) for time, row in keys], strict=True)
    assert list(values) == sorted(values) and values[-1] == pytest.approx(1.0, abs=1e-3)
    assert times[-1] == pytest.approx(2.0, abs=0.11)


def test_edits_of_edit_mode_count(stage, tmp_path):
    ob = ready(tmp_path, axes="WORLD")
    bpy.ops.object.mode_set(mode="EDIT")
    bpy.ops.mesh.select_all(action="SELECT")
    bpy.ops.transform.translate(value=(0.0, 0.0, 1.0))
    bpy.ops.anyface.generate()
    assert ob.mode == "EDIT"
    assert stage.calls[0][0][:, 2].min() > 0.8
    bpy.ops.object.mode_set(mode="OBJECT")
    assert np.abs(shape(ob, 10) - shape(ob, 0)).max() > 1e-3


def test_the_basis_is_read_not_the_posed_face(stage, tmp_path):
    ob = ready(tmp_path, axes="WORLD")
    own_keys(ob, "Smile").key_blocks["Smile"].value = 1.0
    rest = np.array([vertex.co for vertex in ob.data.vertices])
    bpy.ops.anyface.generate()
    assert np.abs(stage.calls[0][0] - rest).max() < 1e-6


def test_the_picked_character_wins_over_the_active_object(stage, tmp_path):
    ob = ready(tmp_path)
    other = grid("Other")
    bpy.context.scene.anyface.character = ob
    bpy.ops.anyface.generate()
    assert ob.data.shape_keys is not None and other.data.shape_keys is None


def test_disable_and_enable(installed, addon):
    name = "bl_ext.user_default.anyface"
    bpy.ops.preferences.addon_disable(module=name)
    assert not hasattr(bpy.types.Object, "anyface")
    assert not hasattr(bpy.types, "ANYFACE_PT_main")
    bpy.ops.preferences.addon_enable(module=name)
    assert hasattr(bpy.types.Object, "anyface")


def test_a_cube_is_no_face_and_nobody_waits_for_it(addon, stage, tmp_path):
    sound = ready(tmp_path).anyface.sound_file
    bpy.ops.mesh.primitive_cube_add()
    bpy.context.object.anyface.source = "FILE"
    bpy.context.object.anyface.sound_file = sound
    for press in (bpy.ops.anyface.generate, bpy.ops.anyface.find_face):
        with pytest.raises(RuntimeError, match="Cube has 8 vertices, too few for a face: pick"):
            press()
    assert not stage.calls and not stage.searches


def test_the_mesh_around_a_tongue_is_named_where_no_face_is_found(addon):
    grid("Room", scale=9.0).rotation_euler.x = 0.1
    bpy.ops.mesh.primitive_uv_sphere_add(radius=1.0)
    bpy.context.object.name = "Skin"
    tongue = grid("Tongue")
    bpy.context.view_layer.update()
    hints = addon("scene.face.mesh").read_face(tongue).hints
    assert hints == ["Skin lies around it: pick that mesh if it is the face"]
