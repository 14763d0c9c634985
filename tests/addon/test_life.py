"""Head and eye motion of a take on objects and bones: what turns, how far, what Remove restores."""

from math import degrees

import bpy
import numpy as np
import pytest
from mathutils import Matrix, Quaternion, Vector

import test_heads as heads
from figures import Stage, curves, everything, grid, stand_in, tone
from test_heads import voice  # noqa: F401 - a fixture
from test_pieces import with_parts

START = 5
NOD, TURN, TILT = 0.05, 0.03, 0.02


class LivelyStage:
    """Adds head and eye motion to a stage: the same angles in all frames."""

    def __init__(self, stage, take_module):
        self.stage, self.take_module = stage, take_module

    def __getattr__(self, name):
        return getattr(self.stage, name)

    def animate(self, *arguments):
        animation = self.stage.animate(*arguments)
        request, sound = arguments[5], arguments[4]
        frames = int(np.ceil(sound.duration_s * request.fps))
        head = np.tile([NOD, TURN, TILT], (frames, 1)) * request.controls["head_motion"]
        gaze = np.zeros((frames, 2, 2))
        gaze[:, 0], gaze[:, 1] = [0.1, 0.05], [0.06, 0.05]
        gaze *= request.controls["gaze"]
        # The grid faces -Y with +Z up.
        way = np.array([[1, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0]], dtype=np.float32)
        animation.life = self.take_module.Life(head, gaze, way)
        return animation


@pytest.fixture
def stage(addon):
    """A stage with head and eye motion that replaces the engine."""
    module = addon("core.take")
    return stand_in(addon, LivelyStage(Stage(module), module))


def ready(tmp_path, name="Head"):
    bpy.context.scene.render.fps = 24
    ob = grid(name)
    ob.anyface.source, ob.anyface.start_frame = "FILE", START
    ob.anyface.sound_file = tone(tmp_path / "tone.wav")
    return ob


def empty(name, turned=(0.0, 0.0, 0.0), parent=None):
    ob = bpy.data.objects.new(name, None)
    ob.rotation_euler, ob.parent = turned, parent
    bpy.context.scene.collection.objects.link(ob)
    bpy.context.view_layer.update()
    return ob


def world(ob, frame):
    bpy.context.scene.frame_set(frame)
    return ob.evaluated_get(bpy.context.evaluated_depsgraph_get()).matrix_world.copy()


def turned(ob, frame, rest):
    """The rotation of the world matrix relative to `rest`, as a rotation vector."""
    turn = (world(ob, frame).to_quaternion() @ rest.to_quaternion().inverted()).normalized()
    axis, angle = turn.to_axis_angle()
    return np.array(axis) * angle


def head_in_world():
    """The stage's head rotation in the world: left is +X, up is +Z, out of the face is -Y."""
    return np.array([NOD, -TILT, TURN])


def generate(ob):
    bpy.context.view_layer.objects.active = ob
    assert bpy.ops.anyface.generate() == {"FINISHED"}


@pytest.mark.parametrize("mode", ["XYZ", "ZXY", "QUATERNION"])
def test_an_empty_turns_as_the_head_however_it_stands(stage, tmp_path, mode):
    ob = ready(tmp_path)
    parent = empty("Body", (0.3, -0.2, 1.0))
    control = empty("Control", (0.4, 0.1, -0.7), parent)
    control.rotation_mode = mode
    bpy.context.view_layer.update()
    bpy.context.scene.frame_set(1)
    stored = ob.anyface_life_settings
    stored.head, stored.head_object = "OBJECT", control
    before, rest = everything(), world(control, 1)
    generate(ob)
    assert "Control turn" in ob.anyface.report
    assert np.abs(turned(control, START + 10, rest) - head_in_world()).max() < 1e-4
    assert np.abs(turned(control, START - 30, rest)).max() < 1e-5
    bpy.context.scene.frame_set(1)
    assert bpy.ops.anyface.remove() == {"FINISHED"}
    assert everything() == before
    assert np.abs(turned(control, START + 10, rest)).max() < 1e-5


def test_head_and_eyes_turn_no_earlier_than_the_scene_begins(stage, tmp_path):
    ob, control = ready(tmp_path), empty("Control")
    ob.anyface.start_frame = 1
    stored = ob.anyface_life_settings
    stored.head, stored.head_object = "OBJECT", control
    rest = world(control, 1)
    generate(ob)
    assert {curve.range()[0] for curve in curves(control.animation_data.action)} == {1.0}
    for frame in (-5, 1, 11):
        assert np.abs(turned(control, frame, rest) - head_in_world()).max() < 1e-4, frame


def test_the_artists_own_keys_stay_and_add_up(stage, tmp_path):
    ob = ready(tmp_path)
    control = empty("Control")
    for frame, angle in ((1, 0.0), (60, 0.5)):
        control.rotation_euler.z = angle
        control.keyframe_insert("rotation_euler", frame=frame)
    action = control.animation_data.action
    bpy.context.scene.frame_set(1)
    stored = ob.anyface_life_settings
    stored.head, stored.head_object = "OBJECT", control
    before, own_place = everything(), world(control, 20)
    bpy.context.scene.frame_set(1)
    generate(ob)
    assert control.animation_data.action == action
    assert np.abs(turned(control, 20, own_place) - head_in_world()).max() < 1e-4
    bpy.context.scene.frame_set(1)
    bpy.ops.anyface.remove()
    assert everything() == before
    assert len(curves(action)) == 3


def armature():
    """A head bone with two eye bones, rolled and turned."""
    data = bpy.data.armatures.new("Rig")
    rig = bpy.data.objects.new("Rig", data)
    rig.rotation_euler = (0.0, 0.0, 0.6)
    bpy.context.scene.collection.objects.link(rig)
    bpy.context.view_layer.objects.active = rig
    bpy.ops.object.mode_set(mode="EDIT")
    head = data.edit_bones.new("Head")
    head.head, head.tail, head.roll = (0, 0, 0), (0, 0.05, 0.2), 0.4
    for name, x in (("Eye.R", -0.03), ("Eye.L", 0.03)):
        eye = data.edit_bones.new(name)
        eye.head, eye.tail, eye.parent = (x, -0.07, 0.05), (x, -0.1, 0.05), head
    bpy.ops.object.mode_set(mode="OBJECT")
    bpy.context.view_layer.update()
    return rig


def bone_world(rig, name, frame):
    bpy.context.scene.frame_set(frame)
    evaluated = rig.evaluated_get(bpy.context.evaluated_depsgraph_get())
    return evaluated.matrix_world @ evaluated.pose.bones[name].matrix


@pytest.mark.parametrize("mode", ["QUATERNION", "XYZ"])
def test_bones_turn_as_head_and_eyes(stage, tmp_path, mode):
    ob = ready(tmp_path)
    rig = armature()
    for bone in rig.pose.bones:
        bone.rotation_mode = mode
    bpy.context.scene.frame_set(1)
    stored = ob.anyface_life_settings
    stored.head, stored.head_armature, stored.head_bone = "BONE", rig, "Head"
    stored.gaze, stored.eye_armature = "BONES", rig
    stored.eye_bone_right, stored.eye_bone_left = "Eye.R", "Eye.L"
    before, rest = everything(), {n: bone_world(rig, n, 1) for n in ("Head", "Eye.R", "Eye.L")}
    generate(ob)
    at = START + 10

    def against(name):
        turn = bone_world(rig, name, at).to_quaternion() @ rest[name].to_quaternion().inverted()
        axis, angle = turn.normalized().to_axis_angle()
        return np.array(axis) * angle, turn

    nod, head = against("Head")
    assert np.abs(nod - head_in_world()).max() < 1e-4
    for name, yaw in (("Eye.R", 0.1), ("Eye.L", 0.06)):
        _, eye = against(name)
        looks = (head.inverted() @ eye) @ Vector((0.0, -1.0, 0.0))
        assert abs(np.arctan2(looks.x, -looks.y) - yaw) < 1e-3
        assert abs(np.arcsin(looks.z) - 0.05) < 1e-3
    bpy.context.scene.frame_set(1)
    bpy.ops.anyface.remove()
    assert everything() == before


def test_a_bone_with_keyframes_of_its_own_is_refused_before_anything_is_made(stage, tmp_path):
    ob = ready(tmp_path)
    rig = armature()
    rig.pose.bones["Head"].keyframe_insert("rotation_quaternion", frame=1)
    stored = ob.anyface_life_settings
    stored.head, stored.head_armature, stored.head_bone = "BONE", rig, "Head"
    before = everything()
    bpy.context.view_layer.objects.active = ob
    with pytest.raises(RuntimeError, match="keyframes or drivers"):
        bpy.ops.anyface.generate()
    assert everything() == before


def eyeball(name, x):
    """A ball whose object origin is the world's origin, as exporters often leave it."""
    bpy.ops.mesh.primitive_uv_sphere_add(radius=0.012, location=(0.0, 0.0, 0.0))
    ball = bpy.context.object
    ball.name = name
    ball.data.transform(Matrix.Translation((x, -0.07, 0.05)))
    return ball


def test_eyeballs_turn_about_their_middle_and_look_where_the_gaze_says(stage, tmp_path):
    ob = ready(tmp_path)
    eyes = [eyeball("Eye.R", -0.03), eyeball("Eye.L", 0.03)]
    bpy.context.view_layer.objects.active = ob
    for eye in eyes:
        row = ob.anyface_face.parts.add()
        row.object, row.role = eye, "gaze"
    bpy.context.scene.frame_set(1)
    before = everything()
    generate(ob)
    for eye, yaw, x in zip(eyes, (0.1, 0.06), (-0.03, 0.03), strict=True):
        moved = world(eye, START + 10)
        assert (moved @ Vector((x, -0.07, 0.05)) - Vector((x, -0.07, 0.05))).length < 1e-5
        looks = moved.to_quaternion() @ Vector((0.0, -1.0, 0.0))
        assert abs(np.arctan2(looks.x, -looks.y) - yaw) < 1e-3
        assert abs(np.arcsin(looks.z) - 0.05) < 1e-3
    bpy.context.scene.frame_set(1)
    bpy.ops.anyface.remove()
    assert everything() == before


def test_the_eyes_follow_an_object_that_moves(stage, tmp_path):
    ob = ready(tmp_path)
    eye = eyeball("Eye.R", -0.032)
    ob.anyface_life_settings.eye_right = eye
    ob.anyface.gaze = 0.0
    ball = empty("Ball")
    for frame, x in ((START, -1.0), (START + 40, 1.0)):
        ball.location = (x, -2.0, 0.046)
        ball.keyframe_insert("location", frame=frame)
    ob.anyface_life_settings.look_at = ball
    generate(ob)
    sides = [(world(eye, START + t).to_quaternion() @ Vector((0, -1, 0))).x for t in (2, 20, 38)]
    assert sides[0] < -0.3 and abs(sides[1]) < 0.1 and sides[2] > 0.3


def test_life_is_off_in_one_click_and_released_alone(stage, addon, tmp_path):
    ob = ready(tmp_path)
    control = empty("Control")
    stored = ob.anyface_life_settings
    stored.head, stored.head_object = "OBJECT", control
    stored.use = False
    generate(ob)
    assert control.animation_data is None and "anyface_turned" not in control
    request = stage.calls[-1][5]
    assert {request.controls[name] for name in addon("scene.life.settings").CONTROLS} == {0.0}
    stored.use = True
    generate(ob)
    assert curves(control.animation_data.action)
    assert bpy.ops.anyface.life_release() == {"FINISHED"}
    assert control.animation_data is None and ob.data.shape_keys is not None
    stored.head = "NONE"
    generate(ob)
    assert stage.calls[-1][5].controls["head_motion"] == 0


def test_an_action_of_its_own_turns_whoever_gets_it(stage, tmp_path):
    ob = ready(tmp_path)
    bpy.context.scene.frame_set(1)
    before = everything()
    ob.anyface_life_settings.head = "OWN"
    generate(ob)
    action = bpy.data.actions["Head Head"]
    anyone = empty("Anyone")
    anyone.animation_data_create().action = action
    if hasattr(anyone.animation_data, "action_slot") and anyone.animation_data.action_slot is None:
        anyone.animation_data.action_slot = action.slots[0]
    assert np.abs(turned(anyone, START + 10, Matrix()) - head_in_world()).max() < 1e-4
    bpy.data.objects.remove(anyone)
    bpy.context.scene.frame_set(1)
    bpy.ops.anyface.remove()
    assert everything() == before


def test_takes_bring_their_heads_along(stage, addon, tmp_path):
    ob = ready(tmp_path)
    control = empty("Control")
    bpy.context.scene.frame_set(1)
    stored = ob.anyface_life_settings
    stored.head, stored.head_object = "OBJECT", control
    before, rest = everything(), world(control, 1)
    ob.anyface_output.new_take = True
    generate(ob)
    bpy.context.scene.frame_set(1)
    ob.anyface.head_motion = 2.0
    generate(ob)
    rows = {row.name: row.id for row in addon("scene.takes.take_list").rows(ob)}
    for name, factor in (("Take 1", 1.0), ("Take 2", 2.0), ("Take 1", 1.0)):
        bpy.context.scene.frame_set(1)
        bpy.ops.anyface.take_switch(take=rows[name])
        assert np.abs(turned(control, START + 10, rest) - factor * head_in_world()).max() < 1e-4
    bpy.context.scene.frame_set(1)
    for name in ("Take 2", "Take 1"):
        bpy.ops.anyface.take_delete(take=rows[name])
    assert everything() == before


def test_two_characters_on_one_armature_let_go_of_their_own(stage, tmp_path):
    rig = armature()
    bpy.context.scene.frame_set(1)
    faces = [ready(tmp_path, name) for name in ("One", "Two")]
    for ob, bone in zip(faces, ("Head", "Eye.L"), strict=True):
        stored = ob.anyface_life_settings
        stored.head, stored.head_armature, stored.head_bone = "BONE", rig, bone
        generate(ob)
    paths = {curve.data_path for curve in curves(rig.animation_data.action)}
    assert len(paths) == 2
    for ob, left in zip(faces, (1, 0), strict=True):
        bpy.context.scene.frame_set(1)
        bpy.context.view_layer.objects.active = ob
        bpy.ops.anyface.remove()
        action = rig.animation_data.action if rig.animation_data is not None else None
        assert len({curve.data_path for curve in curves(action)}) == left
    assert rig.animation_data is None and "anyface_turned" not in rig


def test_rotations_are_those_of_mathutils(addon):
    turn = addon("core.turn")
    vectors = np.random.default_rng(0).normal(size=(20, 3))
    for vector, quaternion in zip(vectors, turn.of_vectors(vectors), strict=True):
        angle = np.linalg.norm(vector)
        expected = Quaternion(Vector(vector / angle), angle)
        assert np.abs(quaternion - np.array(expected)).max() < 1e-6
        assert (
            np.abs(turn.matrices(quaternion[None])[0] - np.array(expected.to_matrix())).max() < 1e-6
        )
    back = turn.to_vectors(turn.of_vectors(vectors * 0.5))
    assert np.abs(back - vectors * 0.5).max() < 1e-9
    assert degrees(turn.of_gaze(np.array([[0.0, 0.1]]))[0, 0]) < 0.0


def test_a_real_head_nods_and_its_eyeball_looks_about(voice):  # noqa: F811
    ob = heads.ready(heads.import_head(), voice[0])
    _, eye = with_parts(ob)
    control = empty("Control", (0.2, 0.0, 0.5))
    bpy.ops.anyface.find_parts()
    stored = ob.anyface_life_settings
    stored.head, stored.head_object = "OBJECT", control
    bpy.context.scene.frame_set(1)
    before = everything()
    rests = {other: world(other, 1) for other in (control, eye)}
    generate(ob)
    frames = range(1, 1 + int(24 * len(voice[1]) / voice[2]))
    head = np.degrees([turned(control, frame, rests[control]) for frame in frames])
    looks = np.degrees([turned(eye, frame, rests[eye]) for frame in frames])
    # In the world +X is a nod, +Z a turn to the left, and -Y a tilt to the right shoulder.
    assert 0.1 < head[:, 0].std() < 2.0 and 0.02 < head[:, 2].std() < 2.0
    assert np.abs(head).max() < 4.0
    assert np.ptp(looks[:, 2]) > 0.5 and np.abs(looks).max() < 20.0
    bpy.context.scene.frame_set(1)
    bpy.ops.anyface.remove()
    assert everything() == before
