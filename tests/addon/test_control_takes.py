"""A take on a rig that the artist animates: his work stays as it is, and Remove leaves no trace."""

import re

import bpy
import numpy as np
import pytest

from figures import (
    SETTINGS,
    Stage,
    animation_rows,
    curves,
    duplicate,
    everything,
    grid,
    shape,
    stand_in,
    tone,
)
from test_panels import draw_all

START = 5


class Waves(Stage):
    """Moves the mesh in long waves, which a few bones can follow."""

    def animate(self, positions, *rest):
        """Displacements that are smooth in space and time."""
        animation = super().animate(positions, *rest)
        moved = animation.displacements
        if moved is None:
            return animation
        time = np.linspace(0.0, 6.0, len(moved))[:, None]
        across, up = 9.0 * positions[:, 0], 9.0 * positions[:, 2]
        waves = np.sin(time + across) * np.cos(0.7 * time + up) + np.sin(2.0 * time) * across
        moved[:] = 0.2 * self.size * waves[:, :, None] * (0.3, 0.2, 1.0)
        return animation


@pytest.fixture
def stage(addon):
    """A `Waves` stage that replaces the engine."""
    return stand_in(addon, Waves(addon("core.take")))


@pytest.fixture
def face(stage, tmp_path):
    """A face on a rig."""
    return rigged(tmp_path)


def rigged(tmp_path):
    """A grid on a rig (four bones under a root, one of them locked), with a tone to speak."""
    ob = grid()
    points = np.array([vertex.co for vertex in ob.data.vertices])
    low, high = points.min(axis=0), points.max(axis=0)
    data = bpy.data.armatures.new("Rig")
    rig = bpy.data.objects.new("Rig", data)
    bpy.context.scene.collection.objects.link(rig)
    bpy.context.view_layer.objects.active = rig
    bpy.ops.object.mode_set(mode="EDIT")
    for number in range(5):
        bone = data.edit_bones.new(f"b{number}" if number else "root")
        share = np.array([number % 2, 0.0, number // 3]) if number else np.full(3, 0.5)
        bone.head = low + share * (high - low)
        bone.tail = bone.head[0], bone.head[1] - 0.02, bone.head[2]
        if number:
            bone.parent = data.edit_bones["root"]
    bpy.ops.object.mode_set(mode="OBJECT")
    bpy.context.view_layer.objects.active = ob
    for name in [f"b{n}" for n in range(1, 5)]:
        group = ob.vertex_groups.new(name=name)
        away = np.linalg.norm(points - np.array(data.bones[name].head_local), axis=1)
        for vertex, weight in enumerate(np.exp(-0.5 * (away / 0.4 / np.ptp(points)) ** 2)):
            group.add([vertex], float(weight), "REPLACE")
    ob.vertex_groups.new(name="root").add(range(len(points)), 0.2, "REPLACE")
    ob.modifiers.new("Armature", "ARMATURE").object = rig
    rig.pose.bones["b2"].lock_location = rig.pose.bones["b2"].lock_rotation = (True,) * 3
    bpy.context.scene.render.fps = 24
    ob.anyface.source, ob.anyface.start_frame = "FILE", START
    ob.anyface.sound_file, ob.anyface.mode = tone(tmp_path / "tone.wav"), "controls"
    bpy.context.scene.frame_set(START)
    return ob


def rig_of(ob):
    """The armature's object."""
    return ob.modifiers["Armature"].object


def state(ob):
    """All data in the file, the rig's animation, pose and properties, and the modifiers shown."""
    rig = rig_of(ob)
    poses = [tuple(map(tuple, bone.matrix_basis)) for bone in rig.pose.bones]
    shown = [(m.name, m.show_viewport) for m in ob.modifiers]
    properties = {name: value for name, value in rig.items() if name not in SETTINGS}
    return everything(), animation_rows(rig.animation_data), poses, shown, properties


def generate():
    """Presses Generate."""
    assert bpy.ops.anyface.generate() == {"FINISHED"}


def remove():
    """Presses Remove, then sets the frame again so that the scene updates."""
    assert bpy.ops.anyface.remove() == {"FINISHED"}
    bpy.context.scene.frame_set(START)


def test_no_control_moves_before_the_scene_begins(face):
    face.anyface.start_frame = 1
    generate()
    fcurves = curves(rig_of(face).animation_data.action)
    assert fcurves and {curve.range()[0] for curve in fcurves} == {1.0}
    at_first = shape(face, 1)
    assert np.abs(at_first - shape(face, -3)).max() < 1e-6
    assert np.abs(at_first - shape(face, 2)).max() < 2e-3


def shown(ob):
    """The share of the motion that the rig shows, read from the report."""
    return int(re.search(r"show (-?\d+)%", ob.anyface.report)[1]) / 100


def key(rig, name, frames=(1, 40)):
    """Animates a bone as the artist would."""
    bone = rig.pose.bones[name]
    for frame in frames:
        bone.location.x = 0.01 * frame
        bone.keyframe_insert("location", frame=frame)


def test_curves_lie_on_whole_frames_in_an_action_of_its_own(face):
    face.anyface.fps = 30.0
    before = state(face)
    generate()
    action = rig_of(face).animation_data.action
    paths = {curve.data_path for curve in curves(action)}
    assert paths and not any("root" in path or '"b2"' in path for path in paths)
    frames = {point.co[0] for curve in curves(action) for point in curve.keyframe_points}
    assert all(frame == int(frame) for frame in frames)
    assert np.abs(shape(face, START + 20) - shape(face, START - 20)).max() > 1e-4
    assert shown(face) > 0.3 and "mouth" in face.anyface.report_details
    remove()
    assert state(face) == before


def test_a_pose_and_modifiers_are_as_before(face):
    rig = rig_of(face)
    rig.pose.bones["root"].rotation_quaternion = (0.8, 0.6, 0.0, 0.0)
    rig.pose.bones["b1"].location = (0.01, 0.02, 0.03)
    face.modifiers.new("Subdivision", "SUBSURF")
    before = state(face)
    generate()
    assert before[3] == [(m.name, m.show_viewport) for m in face.modifiers]
    assert tuple(rig.pose.bones["root"].rotation_quaternion) == pytest.approx((0.8, 0.6, 0, 0))
    remove()
    assert state(face) == before


def test_the_artists_action_plays_on_beside_the_take(face):
    rig = rig_of(face)
    key(rig, "root")
    bpy.context.scene.frame_set(START)
    mine, before = rig.animation_data.action, state(face)
    bpy.context.scene.frame_set(START + 20)
    where = rig.pose.bones["root"].location.x
    for _ in range(2):
        generate()
    assert rig.animation_data.action == mine and len(rig.animation_data.nla_tracks) == 1
    assert len(bpy.data.actions) == 2
    bpy.context.scene.frame_set(START + 20)
    assert rig.pose.bones["root"].location.x == pytest.approx(where)
    assert any(bone.matrix_basis.translation.length > 1e-6 or abs(bone.rotation_quaternion.x) > 1e-6
               for bone in rig.pose.bones if bone.name != "root")  # fmt: skip
    assert shown(face) > 0.3
    remove()
    assert state(face) == before


def test_what_the_artist_has_on_a_face_control_stands_aside(face):
    rig = rig_of(face)
    key(rig, "b1")
    key(rig, "root")
    bpy.context.scene.frame_set(START)
    before = state(face)
    generate()
    playing = {curve.data_path for curve in curves(rig.animation_data.action)}
    assert not any('"b1"' in path for path in playing) and any("root" in path for path in playing)
    remove()
    assert state(face) == before


def test_as_new_take_keeps_the_earlier_action(face):
    generate()
    first = rig_of(face).animation_data.action
    face.anyface_output.new_take, face.anyface.seed = True, 3
    generate()
    assert first.use_fake_user and rig_of(face).animation_data.action != first
    assert len(curves(first)) > 0
    remove()
    assert list(bpy.data.actions) == [first]


def test_what_the_artist_adds_to_our_action_stays(face):
    generate()
    rig = rig_of(face)
    key(rig, "root")
    remove()
    paths = {curve.data_path for curve in curves(rig.animation_data.action)}
    assert paths == {'pose.bones["root"].location'}


def test_a_copy_of_the_character_keeps_its_take_when_the_first_loses_it(face, addon):
    rig = rig_of(face)
    generate()
    copy, copied_rig = duplicate(face, rig)
    addon("scene.copies").settle()
    bpy.context.view_layer.objects.active = copy
    moved = shape(copy, START + 20)
    bpy.context.view_layer.objects.active = face
    bpy.ops.anyface.remove()
    assert rig.animation_data is None and copied_rig.animation_data.action is not None
    assert np.allclose(shape(copy, START + 20), moved)
    bpy.context.view_layer.objects.active = copy
    bpy.ops.anyface.remove()
    assert copied_rig.animation_data is None or copied_rig.animation_data.action is None


def test_another_output_takes_the_place_of_the_take(face):
    before = state(face)
    generate()
    face.anyface.mode = "basis"
    generate()
    assert rig_of(face).animation_data is None
    remove()
    assert state(face) == before


def test_found_controls_are_listed_and_may_be_left_out(face):
    assert bpy.ops.anyface.controls_find() == {"FINISHED"}
    rows = face.anyface_controls.rows
    assert [row.name for row in rows] == ["b1", "b3", "b4"]
    rows[0].use = False
    generate()
    paths = {curve.data_path for curve in curves(rig_of(face).animation_data.action)}
    assert paths and not any('"b1"' in path for path in paths)
    assert bpy.ops.anyface.controls_clear() == {"FINISHED"} and not len(rows)


def test_the_panel_draws_the_rig_and_its_list(face, addon):
    bpy.context.window_manager.anyface_more = True
    for words in (["Controls are found when you generate"], ["Find Controls"]):
        drawn = [text for texts in draw_all(addon).values() for text, _ in texts]
        assert set(words) <= set(drawn)
        bpy.ops.anyface.controls_find()


def test_names_of_a_tool_fill_the_list(face):
    rig = rig_of(face)
    for number, name in enumerate(("jaw", "oris01", "levator02.L", "special03"), 1):
        rig.data.bones[f"b{number}"].name = name
    assert bpy.ops.anyface.controls_preset(preset="MPFB") == {"FINISHED"}
    names = [row.name for row in face.anyface_controls.rows]
    assert names == ["jaw", "oris01", "levator02.L", "special03"]


def test_a_hidden_face_and_one_without_a_rig_are_told_what_helps(face):
    face.hide_viewport = True
    with pytest.raises(RuntimeError, match="is hidden: show it"):
        bpy.ops.anyface.generate()
    face.hide_viewport = False
    face.modifiers.clear()
    with pytest.raises(RuntimeError, match="has no rig: pick the armature"):
        bpy.ops.anyface.generate()


def test_a_fit_that_is_stopped_has_changed_nothing(face, addon):
    bake, settings = addon("scene.bake"), addon("ui.settings").from_object(face)
    before = state(face)
    engine = addon("ui.running").engine(settings.system)
    snapshot = bake.read(face, bpy.context.scene, settings, engine)
    take = snapshot.work(addon("core.job").Progress())
    steps = bake.landing(face, snapshot, take)
    for _ in range(6):
        next(steps)
        assert state(face) == before
    steps.close()
    assert state(face) == before


def test_a_list_is_saved_and_loaded_for_a_rig_of_another_name(face, tmp_path):
    assert bpy.ops.anyface.controls_find() == {"FINISHED"}
    rows = face.anyface_controls.rows
    rows[0].use = False
    names = [(row.name, row.use) for row in rows]
    path = tmp_path / "list.json"
    assert bpy.ops.anyface.controls_save(filepath=str(path)) == {"FINISHED"}
    bpy.ops.anyface.controls_clear()
    rig_of(face).name = "Other"
    assert bpy.ops.anyface.controls_load(filepath=str(path)) == {"FINISHED"}
    assert [(row.name, row.use) for row in face.anyface_controls.rows] == names
    assert {row.block for row in face.anyface_controls.rows} == {"Other"}
    generate()
    left = f'"{names[0][0]}"'
    assert not any(left in c.data_path for c in curves(rig_of(face).animation_data.action))


def test_a_file_that_is_no_list_of_controls_says_so_and_changes_nothing(face, tmp_path):
    bpy.ops.anyface.controls_find()
    count = len(face.anyface_controls.rows)
    path = tmp_path / "list.json"
    for content, expected in (("[]", "not a list"), ('{"controls": [{"kind": "BONE"}]}', "not a"),
                              ('{"controls": [{"kind": "BONE", "id_type": "OBJECT", "block": "", '
                               '"path": "b1"}]}', "row 1"),
                              ('{"controls": [{"kind": "BONE", "id_type": "OBJECT", "block": "R", '
                               '"path": "none"}]}', "has none")):  # fmt: skip
        path.write_text(content)
        with pytest.raises(RuntimeError, match=expected):
            bpy.ops.anyface.controls_load(filepath=str(path))
        assert len(face.anyface_controls.rows) == count
    bpy.ops.anyface.controls_clear()
    with pytest.raises(RuntimeError, match="list is empty"):
        bpy.ops.anyface.controls_save(filepath=str(tmp_path / "empty.json"))


def test_curves_of_a_rig_are_made_in_steps_that_can_be_stopped(face, addon):
    settings = addon("ui.settings").from_object(face)
    engine = addon("ui.running").engine(settings.system)
    bake = addon("scene.bake")
    snapshot = bake.read(face, bpy.context.scene, settings, engine)
    take = snapshot.work(addon("core.job").Progress())
    before = state(face)
    landing, actions = bake.landing(face, snapshot, take), len(bpy.data.actions)
    for step in landing:
        assert step is None, "it has not begun"
        if len(bpy.data.actions) > actions:
            break
    landing.close()
    assert state(face) == before and len(bpy.data.actions) == actions
    generate()
    assert len(bpy.data.actions) == actions + 1
