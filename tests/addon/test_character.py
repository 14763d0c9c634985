"""Character: finding, storing and dragging landmarks; objects beside the face."""

import json

import bpy
import numpy as np
import pytest

from figures import everything, grid, own_keys, shape, stand_in, tone


@pytest.fixture
def stage(addon):
    """A `Stage` that replaces the engine."""
    return stand_in(addon)


def points_of(ob):
    return np.array([vertex.co for vertex in ob.data.vertices])


def speaking(ob, tmp_path):
    bpy.context.scene.render.fps = 24
    ob.anyface.source, ob.anyface.sound_file = "FILE", tone(tmp_path / "a.wav")
    return ob


def test_find_face_stores_the_landmarks_and_says_so(stage, addon):
    ob = grid()
    ob.location.x = 2.0
    bpy.context.view_layer.update()
    assert bpy.ops.anyface.find_face() == {"FINISHED"}
    stored = addon("scene.face.landmarks").load(ob)
    assert np.abs(stored.positions - points_of(ob)[:68]).max() < 1e-6
    text, icon = addon("ui.character").status(ob)
    assert (text, icon) == ("face found, 97 % sure; the lips part", "CHECKMARK")


def test_doubtful_regions_are_named_and_drawn(stage, addon):
    ob = grid()
    bpy.ops.anyface.find_face()
    document = json.loads(ob["anyface_landmarks"])
    for row in document["landmarks"]:
        row["confidence"] = 0.2 if row["index"] < 27 else 0.9
    document["landmarks"][3]["fixed"] = True
    ob["anyface_landmarks"] = json.dumps(document)
    text, icon = addon("ui.character").status(ob)
    assert text.endswith("not sure of brows and jaw: drag the orange points") and icon == "ERROR"
    stored = addon("scene.face.landmarks").load(ob)
    sure, doubtful, by_hand = addon("ui.landmarks").kinds(stored)
    assert (by_hand, sure) == ([3], list(range(27, 68)))
    assert doubtful == [n for n in range(27) if n != 3]


def test_eyes_that_cannot_blink_are_named(stage, addon):
    ob = grid()
    bpy.ops.anyface.find_face()
    document = json.loads(ob["anyface_landmarks"])
    document["lids"] = ["joined", "shut"]
    ob["anyface_landmarks"] = json.dumps(document)
    text, _ = addon("ui.character").status(ob)
    assert "left eye: sculpted shut" in text and "right eye: no slit between the lids" in text


def test_a_region_put_by_hand_is_not_doubtful(stage, addon):
    ob = grid()
    bpy.ops.anyface.find_face()
    document = json.loads(ob["anyface_landmarks"])
    for row in document["landmarks"]:
        row["confidence"], row["fixed"] = (0.2, True) if row["index"] < 17 else (0.9, False)
    ob["anyface_landmarks"] = json.dumps(document)
    text, icon = addon("ui.character").status(ob)
    assert text.endswith("17 put by hand") and icon == "CHECKMARK"


def test_stored_landmarks_reach_the_library(stage, tmp_path):
    ob = speaking(grid(), tmp_path)
    bpy.ops.anyface.find_face()
    bpy.ops.anyface.generate()
    assert np.abs(stage.calls[0][2] - points_of(ob)[:68]).max() < 1e-6


def test_finding_again_starts_from_nothing(stage):
    grid()
    bpy.ops.anyface.find_face()
    bpy.ops.anyface.find_face()
    assert stage.searches[1][1] is None and stage.searches[1][2] is None


def test_reset_forgets_the_landmarks(stage):
    ob = grid()
    assert not bpy.ops.anyface.reset_landmarks.poll()
    bpy.ops.anyface.find_face()
    assert bpy.ops.anyface.reset_landmarks() == {"FINISHED"}
    assert "anyface_landmarks" not in ob


def test_a_ray_drags_a_landmark_over_the_surface_and_the_others_follow(stage, addon):
    ob = grid()
    bpy.ops.anyface.find_face()
    landmarks = addon("scene.face.landmarks")
    drag = landmarks.Drag(ob)
    drag.hold(30)
    before = drag.stored.positions.copy()
    assert drag.move((0.03, -1.0, 0.04), (0.0, 1.0, 0.0))
    assert drag.stored.positions[30] == pytest.approx((0.03, 0.0, 0.04), abs=1e-6)
    assert not drag.move((5.0, -1.0, 0.0), (0.0, 1.0, 0.0))
    face = addon("scene.face.mesh").read_face(ob)
    face_points = drag.search(face, stage).work(addon("core.job").Progress())
    addon("ui.landmarks").keep(ob, face_points, drag.stored.fixed)
    stored = landmarks.load(ob)
    assert stored.positions[30] == pytest.approx((0.03, 0.0, 0.04), abs=1e-6)
    half = (np.array((0.03, 0.0, 0.04)) - before[30]) / 2
    assert stored.positions[31] == pytest.approx(before[31] + half, abs=1e-6)
    assert stored.positions[40] == pytest.approx(before[40], abs=1e-6)
    assert stored.fixed == {30} and "1 put by hand" in landmarks.describe(stored)


def test_landmarks_that_were_put_stay_when_others_are_dragged(stage, addon):
    ob = grid()
    bpy.ops.anyface.find_face()
    assert bpy.ops.anyface.move_landmark(number=8, place=(0.01, 0.5, 0.02)) == {"FINISHED"}
    assert bpy.ops.anyface.move_landmark(number=9, place=(0.05, 0.0, 0.02)) == {"FINISHED"}
    stored = addon("scene.face.landmarks").load(ob)
    assert stored.positions[8] == pytest.approx((0.01, 0.0, 0.02), abs=1e-6)
    assert stored.positions[9] == pytest.approx((0.05, 0.0, 0.02), abs=1e-6)
    assert stored.fixed == {8, 9} and set(stage.searches[-1][3]) == {8, 9}


def test_the_pointer_takes_the_nearest_landmark_within_reach(stage, addon):
    ob = grid()
    bpy.ops.anyface.find_face()
    drag = addon("scene.face.landmarks").Drag(ob)
    pixels = np.column_stack([np.arange(68) * 20.0, np.zeros(68)])
    pixels[3] = np.nan
    assert drag.hold_near(np.array((101.0, 5.0)), pixels, 14.0) and drag.number == 5
    assert not drag.hold_near(np.array((60.0, 0.0)), pixels, 14.0) and drag.number is None


def test_dragging_needs_a_face(stage, addon):
    ob = grid()
    with pytest.raises(addon("core.errors").AnyfaceError, match="find the face first"):
        addon("scene.face.landmarks").Drag(ob)
    with pytest.raises(RuntimeError, match="3D view"):
        bpy.ops.anyface.edit_landmarks()


PLACES = (
    (-0.03, 0.0, 0.02),
    (0.03, 0.0, 0.02),
    (0.0, 0.0, 0.0),
    (-0.02, 0.0, -0.03),
    (0.02, 0.0, -0.03),
)


def test_five_points_say_where_a_face_is(stage, addon):
    ob = grid()
    assert bpy.ops.anyface.place_points(places=np.ravel(PLACES).tolist()) == {"FINISHED"}
    numbers = [number for number, _ in addon("scene.face.landmarks").CLICKS]
    fixed = stage.searches[-1][3]
    assert list(fixed) == numbers == [36, 45, 30, 48, 54]
    assert np.array(list(fixed.values())) == pytest.approx(np.array(PLACES), abs=1e-6)
    assert addon("scene.face.landmarks").load(ob).fixed == set(numbers)


def test_without_places_it_says_what_it_wants(stage, addon):
    grid()
    with pytest.raises(RuntimeError, match="expected five points of the face"):
        bpy.ops.anyface.place_points()


def test_a_message_that_no_face_was_found_offers_places(stage, addon):
    text, label, _ = addon("ui.mending")._OPERATORS["place_points"]
    assert (text, label) == ("anyface.place_points", "Place Points")
    texts = [addon("scene.face.landmarks").ask_for_click(number) for number in range(5)]
    assert texts[2].startswith("Click 3 of 5: the tip of the nose") and len(set(texts)) == 5


def with_teeth(ob, scale=0.1):
    """Lower teeth as a separate object near the face, turned and scaled."""
    teeth = grid("Teeth_low", side=5, scale=scale)
    teeth.location, teeth.rotation_euler.z, teeth.scale = (0.0, 0.02, -0.03), 0.5, (2.0, 2.0, 2.0)
    bpy.context.view_layer.objects.active = ob
    bpy.context.view_layer.update()
    return teeth


def test_parts_beside_the_face_are_found_with_the_role_of_their_name(stage):
    ob = grid()
    with_teeth(ob)
    far = grid("Lamp")
    far.location.x = 5.0
    bpy.context.view_layer.objects.active = ob
    bpy.context.view_layer.update()
    assert bpy.ops.anyface.find_parts() == {"FINISHED"}
    assert [(part.object.name, part.role) for part in ob.anyface_face.parts] == [
        ("Teeth_low", "jaw")
    ]
    bpy.ops.anyface.find_parts()
    assert len(ob.anyface_face.parts) == 1
    assert bpy.ops.anyface.drop_part() == {"FINISHED"}
    assert len(ob.anyface_face.parts) == 0


def test_parts_move_with_the_face_in_one_run(stage, addon, tmp_path):
    ob = speaking(grid(), tmp_path)
    teeth = with_teeth(ob)
    bpy.ops.anyface.find_parts()
    assert bpy.ops.anyface.generate() == {"FINISHED"}
    assert len(stage.calls) == 1
    positions, _, _, _, _, request = stage.calls[0]
    world = [teeth.matrix_world @ vertex.co for vertex in teeth.data.vertices]
    assert np.abs(positions[144:] - np.array(world)).max() < 1e-6
    assert request.roles.object_roles == [-1, 1]
    assert list(request.roles.object_of_vertex) == [0] * 144 + [1] * 25
    from figures import motion

    moved = motion(48, 169, size=stage.size)
    rest = np.array([vertex.co for vertex in teeth.data.vertices])
    turned = (shape(teeth, 11) - rest) @ np.array(teeth.matrix_world)[:3, :3].T
    assert np.abs(turned - moved[10, 144:]).max() < 3e-5
    rest = np.array([vertex.co for vertex in ob.data.vertices])
    assert np.abs(shape(ob, 11) - rest - moved[10, :144]).max() < 3e-5


def test_every_part_is_removed_exactly_also_a_renamed_one(stage, tmp_path):
    ob = speaking(grid(), tmp_path)
    teeth = with_teeth(ob)
    own_keys(teeth, "Broken")
    bpy.ops.anyface.find_parts()
    before = everything()
    bpy.ops.anyface.generate()
    assert "Anyface.001" in teeth.data.shape_keys.key_blocks
    teeth.name = "Renamed"
    bpy.context.scene.frame_set(1)
    assert bpy.ops.anyface.remove() == {"FINISHED"}
    teeth.name = "Teeth_low"
    assert everything() == before


def test_a_part_that_cannot_be_keyed_stops_everything_before_writing(stage, tmp_path):
    ob = speaking(grid(), tmp_path)
    teeth = with_teeth(ob)
    own_keys(teeth, "Broken")
    bpy.ops.anyface.find_parts()
    ob.anyface.mode = "frames"
    before = everything()
    with pytest.raises(RuntimeError, match="Teeth_low has 2 shape keys"):
        bpy.ops.anyface.generate()
    assert everything() == before


def test_parts_that_rest_get_no_keys(stage, addon):
    take, pieces = addon("core.take"), addon("scene.face.pieces")
    vectors = np.zeros((1, 6, 3), dtype=np.float32)
    vectors[0, :4, 2] = 0.01
    whole_take = take.Take(24.0, 5.0, "basis", take.Basis(vectors, np.ones((3, 1)), 0.0))
    parts = [take.Piece("Head", 0, 4, np.eye(4)), take.Piece("Eye", 4, 2, np.eye(4))]
    face, eye = pieces.split(whole_take, parts)
    assert face[1].largest_mm == pytest.approx(5.0) and eye[1] is None


@pytest.mark.parametrize("by_hand", [True, False])
def test_deleted_parts_are_left_out(stage, tmp_path, by_hand):
    ob = speaking(grid(), tmp_path)
    teeth = with_teeth(ob)
    bpy.ops.anyface.find_parts()
    if by_hand:
        with bpy.context.temp_override(selected_objects=[teeth]):
            bpy.ops.object.delete()
        assert ob.anyface_face.parts[0].object is not None
    else:
        bpy.data.objects.remove(teeth)
    assert bpy.ops.anyface.generate() == {"FINISHED"}
    assert len(stage.calls[0][0]) == 144


def test_a_picked_face_that_was_deleted_is_forgotten(stage, addon):
    ob, other = grid(), grid("Other")
    bpy.context.scene.anyface.character = ob
    with bpy.context.temp_override(selected_objects=[ob]):
        bpy.ops.object.delete()
    assert addon("ui.target").target(bpy.context) == other


def test_loose_parts_are_listed_and_their_role_can_be_overridden(stage, addon, tmp_path):
    ob = speaking(grid(), tmp_path)
    bpy.ops.anyface.find_face()
    rows = ob.anyface_face.loose
    assert [(row.number, row.vertices, row.found) for row in rows] == [(0, 144, "skin")]
    rows[0].role = "still"
    bpy.ops.anyface.find_face()
    assert ob.anyface_face.loose[0].role == "still"
    bpy.ops.anyface.generate()
    roles = stage.calls[0][5].roles
    assert (roles.numbers, roles.number_roles) == ([0], [6])


@pytest.mark.parametrize(
    ("name", "role"),
    [
        ("Teeth_Lower", "jaw"),
        ("teeth_upper", "skull"),
        ("Tongue", "jaw"),
        ("Eyelashes.L", "nearest"),
        ("Eye.R", "gaze"),
        ("Teeth", ""),
    ],
)
def test_names_tell_roles(addon, name, role):
    assert addon("scene.face.pieces").role_of_name(name) == role


def test_teeth_that_were_not_taken_along_are_named(stage, tmp_path):
    ob = speaking(grid(), tmp_path)
    for name in ("Teeth_lower", "Eye.R", "Lamp"):
        grid(name, scale=0.02)
    bpy.context.view_layer.objects.active = ob
    ob.anyface_face.looked = True
    assert bpy.ops.anyface.generate() == {"FINISHED"}
    assert "did not" in ob.anyface.report and (
        "(Teeth_lower did not move along: Find Parts adds them)" in ob.anyface.report
    )
    bpy.ops.anyface.find_parts()
    assert bpy.ops.anyface.generate() == {"FINISHED"}
    assert "move along" not in ob.anyface.report


def rigged(tmp_path, hang):
    """A skinned head on a rig, and teeth that `hang(teeth, rig)` attaches. The rig is far away."""
    ob = speaking(grid(), tmp_path)
    teeth = grid("Teeth_lower", scale=0.02)
    teeth.location = (0.0, 0.03, -0.02)
    rig = bpy.data.objects.new("Rig", bpy.data.armatures.new("Rig"))
    bpy.context.scene.collection.objects.link(rig)
    rig.location.x = 3.0
    bpy.context.view_layer.objects.active = rig
    bpy.ops.object.mode_set(mode="EDIT")
    bone = rig.data.edit_bones.new("head")
    bone.head, bone.tail = (-3.0, 0.0, -0.1), (-3.0, 0.1, 0.1)
    bpy.ops.object.mode_set(mode="OBJECT")
    ob.modifiers.new("Armature", "ARMATURE").object = rig
    ob.vertex_groups.new(name="head").add(range(len(ob.data.vertices)), 1.0, "REPLACE")
    bpy.context.view_layer.update()
    hang(teeth, rig)
    bpy.context.view_layer.objects.active = ob
    return ob, teeth, rig


def by_bone(teeth, rig):
    before = teeth.matrix_world.copy()
    teeth.parent, teeth.parent_type, teeth.parent_bone = rig, "BONE", "head"
    bpy.context.view_layer.update()
    teeth.matrix_world = before


def by_constraint(teeth, rig):
    constraint = teeth.constraints.new("CHILD_OF")
    constraint.target, constraint.subtarget = rig, "head"
    constraint.inverse_matrix = (rig.matrix_world @ rig.pose.bones["head"].matrix).inverted()


def by_parents(teeth, rig):
    jaw = bpy.data.objects.new("Jaw", None)
    bpy.context.scene.collection.objects.link(jaw)
    by_bone(jaw, rig)
    bpy.context.view_layer.update()
    teeth.parent, teeth.matrix_parent_inverse = jaw, jaw.matrix_world.inverted()


@pytest.mark.parametrize("hang", [by_bone, by_constraint, by_parents])
def test_teeth_on_a_posed_bone_are_read_as_in_the_rest_pose(stage, addon, tmp_path, hang):
    ob, teeth, rig = rigged(tmp_path, hang)
    bpy.context.view_layer.update()
    place, add = teeth.matrix_world.copy(), addon("ui.character").suggestions
    pose = rig.pose.bones["head"]
    pose.rotation_mode, pose.rotation_euler, pose.location = (
        "XYZ",
        (0.3, 0.6, -0.2),
        (0.0, 5.0, 2.0),
    )
    bpy.context.view_layer.update()
    assert (teeth.matrix_world.translation - place.translation).length > 3.0
    assert np.abs(addon("scene.face.rest").world(teeth) - np.array(place)).max() < 1e-5
    assert [part.name for part in add(ob)] == ["Teeth_lower"]
    bpy.ops.anyface.find_parts()
    assert bpy.ops.anyface.generate() == {"FINISHED"}
    read = stage.calls[0][0][-len(teeth.data.vertices) :]
    expected = points_of(teeth) @ np.array(place)[:3, :3].T + np.array(place)[:3, 3]
    assert np.abs(read - expected).max() < 1e-5


def test_constraints_in_a_circle_or_without_a_target_hold_nothing(addon):
    ob, other = grid(), grid("Other")
    ob.constraints.new("ARMATURE")
    ob.location.x = 2.0
    bpy.context.view_layer.update()
    world = addon("scene.face.rest").world
    assert np.allclose(world(ob), np.array(ob.matrix_world))
    ob.constraints.new("CHILD_OF").target = other
    other.constraints.new("CHILD_OF").target = ob
    assert world(ob).shape == (4, 4)
