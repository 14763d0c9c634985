"""Mouth charts in the scene: held keyframes on drawings. The artist's work stays."""

import bpy
import numpy as np
import pytest

from figures import Stage, everything, grid, own_keys, stand_in, tone

LETTERS = "ABCDEFGHX"
# Start and end in seconds, mouth. The sound starts at frame 5, with 24 frames a second.
CHART = [(0.0, 0.25, "X"), (0.25, 0.5, "A"), (0.5, 0.75, "D"), (0.75, 1.0, "A")]
FRAMES = [4, 11, 17, 23, 29]
SHOWN = ["X", "A", "D", "A", "X"]


class ChartStage(Stage):
    """A stage that always draws the same chart and records its calls."""

    drawn, refuses = CHART, False

    def __init__(self, take_module, error):
        super().__init__(take_module)
        self.error = error

    def chart(
        self, positions, triangles, points, numbers, sound, request, progress, *holds, **more
    ):
        """The chart. If it `refuses`, it finds no face on meshes of fewer than 1000 vertices."""
        if self.refuses and len(positions) < 1000:
            raise self.error("face", "no face was found")
        self.calls.append((len(positions), request, holds, more))
        return self.drawn

    def closes_lips(self, label):
        """True for p, b and m."""
        return label in ("p", "b", "m", "MBP")


@pytest.fixture
def stage(addon):
    """A `ChartStage` that replaces the engine, in a scene of 24 frames a second."""
    bpy.context.scene.render.fps = 24
    return stand_in(addon, ChartStage(addon("core.take"), addon("core.errors").AnyfaceError))


def speaks(ob, tmp_path):
    """Gives an object a sound that begins at frame 5, and makes the object active."""
    ob.anyface.source, ob.anyface.sound_file = "FILE", tone(tmp_path / "a.wav", seconds=1.0)
    ob.anyface.start_frame = 5
    bpy.context.view_layer.objects.active = ob
    return ob.anyface_mouth_chart


def letters(tmp_path):
    """A mesh with a shape key for each of Rhubarb's mouths."""
    ob = grid("Mouth")
    own_keys(ob, *(f"Mouth_{letter}" for letter in LETTERS))
    return ob, speaks(ob, tmp_path)


def value_at(ob, frame, key):
    bpy.context.scene.frame_set(frame)
    return ob.data.shape_keys.key_blocks[key].value


def test_one_key_is_held_at_a_time(stage, tmp_path):
    ob, _ = letters(tmp_path)
    assert bpy.ops.anyface.mouth_chart() == {"FINISHED"}
    for frame, mouth in [
        (1, "X"),
        (10, "X"),
        (11, "A"),
        (16, "A"),
        (17, "D"),
        (23, "A"),
        (40, "X"),
    ]:
        values = {letter: value_at(ob, frame, f"Mouth_{letter}") for letter in LETTERS}
        assert values == {letter: float(letter == mouth) for letter in LETTERS}, frame


def test_what_is_chosen_reaches_the_library(stage, tmp_path):
    _, stored = letters(tmp_path)
    stored.on, stored.hold, stored.hold_closures, stored.hold_vowels = 2, 3, 4, 5
    bpy.ops.anyface.mouth_chart()
    _, request, kind_and_holds, more = stage.calls[-1]
    assert kind_and_holds == ("rhubarb", 2, 3) and request.fps == 24.0
    assert (more["closure_hold"], more["vowel_hold"]) == (4, 5)


def test_closures_that_the_artist_mended_count(stage, addon, tmp_path, monkeypatch):
    letters(tmp_path)
    shown = [(0.1, 0.2, "MBP"), (0.4, 0.5, "f")]
    monkeypatch.setattr(addon("scene.sound.sounds"), "read", lambda *_: shown)
    bpy.ops.anyface.mouth_chart()
    np.testing.assert_allclose(stage.calls[-1][1].fields["closures"], [[0.1, 0.2]])


def test_curves_are_constant_and_a_second_chart_replaces_them(stage, tmp_path):
    ob, _ = letters(tmp_path)
    bpy.ops.anyface.mouth_chart()
    first = everything()
    bpy.ops.anyface.mouth_chart()
    assert everything() == first
    action = ob.data.shape_keys.animation_data.action
    bag = action if hasattr(action, "fcurves") else action.layers[0].strips[0].channelbags[0]
    for curve in bag.fcurves:
        assert [key.co.x for key in curve.keyframe_points] == FRAMES
        assert {key.interpolation for key in curve.keyframe_points} == {"CONSTANT"}


def test_remove_leaves_everything_as_it_was(stage, tmp_path):
    ob, _ = letters(tmp_path)
    bpy.ops.anyface.mouth_chart_find()
    ob["anyface_identity"] = ob.get("anyface_identity", "")
    before = [row for row in everything() if "anyface_identity" not in row]
    values = [block.value for block in ob.data.shape_keys.key_blocks]
    bpy.ops.anyface.mouth_chart()
    assert [row for row in everything() if "anyface_identity" not in row] != before
    assert bpy.ops.anyface.mouth_chart_remove() == {"FINISHED"}
    assert [row for row in everything() if "anyface_identity" not in row] == before
    assert [block.value for block in ob.data.shape_keys.key_blocks] == values
    with pytest.raises(RuntimeError, match="has no mouth chart"):
        bpy.ops.anyface.mouth_chart_remove()


def test_keyframes_of_the_artist_stay(stage, tmp_path):
    ob, stored = letters(tmp_path)
    ob.shape_key_add(name="Smile", from_mix=False)
    smile = ob.data.shape_keys.key_blocks["Smile"]
    smile.value = 0.5
    smile.keyframe_insert("value", frame=3)
    bpy.ops.anyface.mouth_chart()
    bpy.ops.anyface.mouth_chart_remove()
    assert value_at(ob, 9, "Smile") == 0.5
    # The chart does not overwrite the artist's keyframes on a key that it needs. It tells him.
    smile.keyframe_insert("value", frame=8)
    stored.drawings["D"].drawing = "Smile"
    with pytest.raises(RuntimeError, match="Smile has keyframes of its own"):
        bpy.ops.anyface.mouth_chart()
    assert value_at(ob, 9, "Smile") == 0.5


def test_a_driven_key_is_refused(stage, tmp_path):
    ob, _ = letters(tmp_path)
    ob.data.shape_keys.key_blocks["Mouth_C"].driver_add("value").driver.expression = "0.25"
    with pytest.raises(RuntimeError, match="Mouth_C has a driver of its own"):
        bpy.ops.anyface.mouth_chart()
    assert ob.data.shape_keys.animation_data.action is None


def test_a_missing_mouth_is_named(stage, tmp_path):
    ob = grid("Mouth")
    own_keys(ob, "A", "B", "D", "E", "F")
    speaks(ob, tmp_path)
    with pytest.raises(RuntimeError, match="no drawing of C in the shape keys of Mouth"):
        bpy.ops.anyface.mouth_chart()


def test_g_h_and_x_may_be_missing(stage, tmp_path):
    ob = grid("Mouth")
    own_keys(ob, *"ABCDEF")
    stored = speaks(ob, tmp_path)
    stage.drawn = [(0.0, 0.5, "G"), (0.5, 1.0, "H")]
    bpy.ops.anyface.mouth_chart_find()
    stored.drawings["X"].drawing = ""
    bpy.ops.anyface.mouth_chart()
    assert value_at(ob, 8, "B") == 1.0 and value_at(ob, 20, "C") == 1.0
    assert value_at(ob, 40, "A") == 1.0


def test_a_name_that_is_not_there_is_an_error(stage, tmp_path):
    _, stored = letters(tmp_path)
    bpy.ops.anyface.mouth_chart_find()
    stored.drawings["C"].drawing = "Nose"
    with pytest.raises(RuntimeError, match="C: expected one of the shape keys of Mouth"):
        bpy.ops.anyface.mouth_chart()


def drawn_objects(tmp_path, names):
    """A collection of objects, and a face that speaks."""
    face = grid("Head")
    collection = bpy.data.collections.new("Mouths")
    bpy.context.scene.collection.children.link(collection)
    for name in names:
        collection.objects.link(bpy.data.objects.new(name, None))
    stored = speaks(face, tmp_path)
    stored.output, stored.collection = "OBJECTS", collection
    return face, collection, stored


def test_objects_of_a_collection_show_and_hide(stage, tmp_path):
    _, collection, _ = drawn_objects(tmp_path, [f"mouth {letter}" for letter in LETTERS] + ["Nose"])
    collection.objects["mouth D"].hide_render = True
    bpy.ops.anyface.mouth_chart()
    for frame, mouth in [(1, "X"), (11, "A"), (18, "D"), (40, "X")]:
        bpy.context.scene.frame_set(frame)
        for which in ("hide_render", "hide_viewport"):
            visible = [ob.name for ob in collection.objects if not getattr(ob, which)]
            assert sorted(visible) == ["Nose", f"mouth {mouth}"], (frame, which)
    bpy.ops.anyface.mouth_chart_remove()
    assert [ob.name for ob in collection.objects if ob.hide_render] == ["mouth D"]
    assert not any(ob.hide_viewport or ob.animation_data for ob in collection.objects)


def test_another_output_takes_the_first_one_away(stage, tmp_path):
    face, collection, stored = drawn_objects(tmp_path, LETTERS)
    bpy.ops.anyface.mouth_chart()
    stored.output = "NUMBER"
    bpy.ops.anyface.mouth_chart()
    assert not any(ob.animation_data or ob.hide_render for ob in collection.objects)
    bpy.context.scene.frame_set(18)
    assert face["mouth"] == 4


def test_objects_without_a_collection_are_asked_for(stage, tmp_path):
    stored = speaks(grid("Head"), tmp_path)
    stored.output = "OBJECTS"
    with pytest.raises(RuntimeError, match="choose the collection"):
        bpy.ops.anyface.mouth_chart()


def test_a_number_is_made_and_goes_again(stage, tmp_path):
    ob = grid("Head")
    stored = speaks(ob, tmp_path)
    stored.output, stored.property = "NUMBER", "lips"
    bpy.ops.anyface.mouth_chart()
    mouths = []
    for frame in FRAMES:
        bpy.context.scene.frame_set(frame)
        mouths.append(LETTERS[ob["lips"] - 1])
    assert mouths == SHOWN
    bpy.ops.anyface.mouth_chart_remove()
    assert "lips" not in ob and ob.animation_data is None


def test_a_number_may_be_a_data_path(stage, tmp_path):
    ob = grid("Head")
    stored = speaks(ob, tmp_path)
    array = ob.modifiers.new("Array", "ARRAY")
    array.count = 7
    stored.output, stored.property = "NUMBER", 'modifiers["Array"].count'
    bpy.ops.anyface.mouth_chart()
    bpy.context.scene.frame_set(18)
    assert array.count == 4
    bpy.ops.anyface.mouth_chart_remove()
    assert array.count == 7
    for path, got in [("modifiers.nothing", "nothing of that name"), ("location[0]", "float")]:
        stored.property = path
        with pytest.raises(RuntimeError, match=f"expected a number at .*got {got}"):
            bpy.ops.anyface.mouth_chart()


def pencil():
    """A Grease Pencil object with nine frames on one layer, of the kind that this Blender has."""
    if hasattr(bpy.data, "grease_pencils_v3") or bpy.app.version >= (4, 3):
        every = getattr(bpy.data, "grease_pencils_v3", None) or bpy.data.grease_pencils
    else:
        every = bpy.data.grease_pencils
    data = every.new("Mouths")
    layer = data.layers.new("Lines")
    for frame in range(1, 10):
        layer.frames.new(frame)
    ob = bpy.data.objects.new("Mouths", data)
    bpy.context.scene.collection.objects.link(ob)
    return ob


def test_grease_pencil_shows_a_frame_for_each_mouth(stage, tmp_path):
    ob = pencil()
    stored = speaks(ob, tmp_path)
    stored.output = "GREASE_PENCIL"
    assert bpy.ops.anyface.mouth_chart() == {"FINISHED"}
    # There is no other face, so the default head spoke.
    assert stage.calls[-1][0] > 1000
    modifiers = ob.grease_pencil_modifiers if ob.type == "GPENCIL" else ob.modifiers
    (modifier,) = modifiers
    assert modifier.type in ("GP_TIME", "GREASE_PENCIL_TIME") and modifier.mode == "FIX"
    mouths = []
    for frame in FRAMES:
        bpy.context.scene.frame_set(frame)
        mouths.append(LETTERS[modifier.offset - 1])
    assert mouths == SHOWN
    bpy.ops.anyface.mouth_chart()
    assert len(modifiers) == 1
    bpy.ops.anyface.mouth_chart_remove()
    assert len(modifiers) == 0 and ob.animation_data is None


def test_a_face_may_speak_for_grease_pencil(stage, tmp_path):
    lines, face = pencil(), grid("Head")
    stored = speaks(face, tmp_path)
    stored.output, stored.object = "GREASE_PENCIL", lines
    bpy.ops.anyface.mouth_chart()
    assert stage.calls[-1][0] == len(face.data.vertices)
    modifiers = lines.grease_pencil_modifiers if lines.type == "GPENCIL" else lines.modifiers
    assert len(modifiers) == 1
    stored.object = face
    with pytest.raises(RuntimeError, match="expected a Grease Pencil object"):
        bpy.ops.anyface.mouth_chart()


def test_a_mesh_without_a_face_is_spoken_for_by_the_default_head(stage, tmp_path):
    letters(tmp_path)
    stage.refuses = True
    assert bpy.ops.anyface.mouth_chart() == {"FINISHED"}
    assert stage.calls[-1][0] > 1000


def test_undo_takes_a_chart_back(stage, tmp_path):
    letters(tmp_path)
    bpy.ops.anyface.mouth_chart_find()
    bpy.ops.ed.undo_push(message="before")
    bpy.ops.anyface.mouth_chart()
    bpy.ops.ed.undo_push(message="chart")
    bpy.ops.ed.undo()
    keys = bpy.data.objects["Mouth"].data.shape_keys
    assert keys.animation_data is None or keys.animation_data.action is None


def test_a_copy_of_the_drawings_keeps_its_own(stage, tmp_path):
    ob, _ = letters(tmp_path)
    bpy.ops.anyface.mouth_chart()
    copy = ob.copy()
    copy.data = ob.data.copy()
    bpy.context.scene.collection.objects.link(copy)
    bpy.context.view_layer.objects.active = copy
    bpy.ops.anyface.mouth_chart_remove()
    assert copy.data.shape_keys.animation_data is None
    assert value_at(ob, 18, "Mouth_D") == 1.0


@pytest.mark.parametrize(
    ("kind", "names", "expected"),
    [
        ("rhubarb", list(LETTERS), dict(zip(LETTERS, LETTERS, strict=True))),
        ("rhubarb", ["lisa-A", "mouth.B"], {}),
        (
            "rhubarb",
            ["MBP", "etc", "E", "AI", "O", "U", "WQ", "FV", "L", "rest"],
            dict(zip(LETTERS, ["MBP", "etc", "E", "AI", "O", "U", "FV", "L", "rest"], strict=True)),
        ),
        (
            "preston-blair",
            ["Basis", "Mouth_AI", "mouth_E", "O", "U.001", "FV", "L", "M_B_P", "etc", "WQ"],
            {"rest": "Basis", "AI": "Mouth_AI", "E": "mouth_E", "O": "O", "U": "U.001",
             "FV": "FV", "L": "L", "MBP": "M_B_P", "etc": "etc", "WQ": "WQ"},
        ),
    ],
)  # fmt: skip
def test_drawings_are_told_by_their_names(addon, kind, names, expected):
    assert addon("core.mouth_chart").guess(kind, names) == expected


def test_changes_lie_on_whole_frames_and_no_earlier_than_the_scene(addon):
    changes = addon("core.mouth_chart").changes
    assert changes("rhubarb", CHART, 5.0, 24.0, 1) == list(zip(FRAMES, SHOWN, strict=True))
    late = [(0.0, 0.5, "B"), (0.5, 0.51, "C"), (0.51, 1.0, "B")]
    assert changes("rhubarb", late, 1.0, 24.0, 1) == [(1, "B"), (25, "X")]
    assert changes("preston-blair", [(0.0, 1.0, "E")], 5.0, 24.0, 1) == [
        (4, "rest"), (5, "E"), (29, "rest")]  # fmt: skip
