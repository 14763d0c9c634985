"""Several emotions at once: rows, keyframes, named mixtures, presets and takes of them."""

import json
from types import SimpleNamespace

import bpy
import numpy as np
import pytest

from figures import FPS, duplicate, grid, link_from_library, select, stand_in, strip, tone

START = 11


@pytest.fixture
def stage(addon):
    """A `Stage` that replaces the engine."""
    return stand_in(addon)


@pytest.fixture
def face(tmp_path):
    """A head with a strip that begins at frame 11, 24 frames a second."""
    ob = grid()
    strip(tone(tmp_path / "tone.wav"), "Voice", START)
    ob.anyface.strip = "Voice"
    return ob


def feel(ob, **weights):
    """Sets the first emotion, then rows for the others."""
    (first, intensity), *others = weights.items()
    ob.anyface.emotion, ob.anyface.intensity = first, intensity
    ob.anyface.mixture.clear()
    for name, weight in others:
        assert bpy.ops.anyface.emotion_add() == {"FINISHED"}
        row = ob.anyface.mixture[-1]
        row.emotion, row.weight = name, weight


def rows(ob):
    """The mixture of a face."""
    stored = ob.anyface
    others = [(row.emotion, round(row.weight, 4)) for row in stored.mixture]
    return [(stored.emotion, round(stored.intensity, 4)), *others]


def requested_emotion(stage):
    """The emotion that the stage was asked for: times `[N]` and strengths `[N, 15]`."""
    keys = stage.calls[-1][-1].fields["emotion"]
    return np.array([time for time, _ in keys]), np.array([row for _, row in keys])


def strengths(addon, **weights):
    """Strengths `[15]` of all emotions. Those without a weight get 0."""
    return [weights.get(name, 0.0) for name in addon("core.emotion").EMOTIONS]


def generate(ob):
    select(ob)
    assert bpy.ops.anyface.generate() == {"FINISHED"}, ob.anyface.report


def test_rows_are_felt_together(stage, face, addon):
    feel(face, happy=0.6, sad=0.4, angry=0.2)
    generate(face)
    assert requested_emotion(stage)[1][0] == pytest.approx(
        strengths(addon, happy=0.6, sad=0.4, angry=0.2)
    )


def test_one_emotion_is_asked_for_as_before(stage, face, addon):
    """A face whose file has no mixture asks for one emotion."""
    face.anyface.emotion, face.anyface.intensity = "sad", 0.8
    path = bpy.path.abspath(bpy.app.tempdir) + "old.blend"
    bpy.ops.wm.save_as_mainfile(filepath=path)
    bpy.ops.wm.open_mainfile(filepath=path)
    ob = bpy.data.objects["Head"]
    assert rows(ob) == [("sad", 0.8)] and len(ob.anyface.mixture) == 0
    generate(ob)
    assert requested_emotion(stage)[1] == pytest.approx(np.array([strengths(addon, sad=0.8)]))
    feel(ob, neutral=1.0)
    generate(ob)
    assert requested_emotion(stage)[1][0] == pytest.approx(strengths(addon, neutral=1.0))


def test_neutral_beside_others_says_nothing_and_the_sum_is_what_a_face_can_show(stage, face, addon):
    feel(face, neutral=1.0, sad=0.7)
    generate(face)
    assert requested_emotion(stage)[1][0] == pytest.approx(strengths(addon, sad=0.7))
    feel(face, happy=1.5, sad=1.5)
    generate(face)
    assert requested_emotion(stage)[1][0] == pytest.approx(strengths(addon, happy=0.75, sad=0.75))


def test_keyframes_on_any_weight_become_curves(stage, face, addon):
    feel(face, happy=0.5, sad=0.0, angry=0.3)
    weight = "anyface.mixture[0].weight"
    for frame, value in ((START, 0.0), (START + FPS, 1.0)):
        face.anyface.mixture[0].weight = value
        face.keyframe_insert(weight, frame=frame)
    generate(face)
    times, strengths_over_time = requested_emotion(stage)
    names = addon("core.emotion").EMOTIONS
    at = [0.0, 0.5, 1.0, 1.5]
    sad = np.interp(at, times, strengths_over_time[:, names.index("sad")])
    # 0.5 + 0.3 + 1.0 is more than a face can show.
    assert sad == pytest.approx([0.0, 0.5, 1.0 / 1.2, 1.0 / 1.2], abs=0.03)
    assert strengths_over_time[0, names.index("happy")] == pytest.approx(0.5)
    face.animation_data.action = None
    face.anyface.mixture[0].driver_add("weight").driver.expression = "0.25"
    generate(face)
    strengths_over_time = requested_emotion(stage)[1]
    assert strengths_over_time[:, names.index("sad")] == pytest.approx(
        np.full(len(strengths_over_time), 0.25)
    )
    assert strengths_over_time[:, names.index("angry")] == pytest.approx(
        np.full(len(strengths_over_time), 0.3)
    )


def test_curves_go_with_the_row_that_goes_and_stay_with_the_others(stage, face, addon):
    feel(face, happy=0.2, sad=0.1, angry=0.3)
    for number, value in ((0, 0.9), (1, 0.4)):
        face.anyface.mixture[number].weight = value
        face.keyframe_insert(f"anyface.mixture[{number}].weight", frame=START)
    assert bpy.ops.anyface.emotion_remove(number=0) == {"FINISHED"}
    assert [name for name, _ in rows(face)] == ["happy", "angry"]
    generate(face)
    assert requested_emotion(stage)[1][0] == pytest.approx(strengths(addon, happy=0.2, angry=0.4))
    assert bpy.ops.anyface.emotion_remove(number=0) == {"FINISHED"}
    curves = addon("scene.animation.curves").channels(face.animation_data).fcurves
    assert len(curves) == 0
    with pytest.raises(RuntimeError, match="below 0, got 3"):
        bpy.ops.anyface.emotion_remove(number=3)


def test_a_named_mixture_fills_the_rows(stage, face, addon):
    feel(face, angry=1.0, ill=0.3, drunk=0.3)
    assert bpy.ops.anyface.emotion_mixture(name="Bittersweet") == {"FINISHED"}
    assert rows(face) == [("happy", 0.6), ("sad", 0.6)]
    generate(face)
    assert requested_emotion(stage)[1][0] == pytest.approx(strengths(addon, happy=0.6, sad=0.6))
    with pytest.raises(RuntimeError, match=r"expected one of Bittersweet, Smug.*'Grumpy'"):
        bpy.ops.anyface.emotion_mixture(name="Grumpy")
    assert rows(face) == [("happy", 0.6), ("sad", 0.6)]


def test_keyframes_that_go_on_are_told_where_a_mixture_is_chosen(face, capfd):
    feel(face, happy=0.6, sad=0.4)
    assert bpy.ops.anyface.emotion_mixture(name="Smug") == {"FINISHED"}
    assert "keyframes" not in capfd.readouterr().out
    face.keyframe_insert("anyface.mixture[0].weight", frame=START)
    assert bpy.ops.anyface.emotion_mixture(name="Nervous") == {"FINISHED"}
    assert "Nervous: keyframes and drivers" in capfd.readouterr().out


def test_named_mixtures_are_what_a_face_can_show(addon):
    emotion = addon("core.emotion")
    assert len(emotion.MIXTURES) >= 10
    for name, text in emotion.MIXTURES.items():
        assert emotion.mix(emotion.read_shares(text)) == pytest.approx(emotion.parse(text)), name
        assert len(emotion.read_shares(text)) > 1
        assert emotion.write_shares(emotion.read_shares(text)) == text


def test_undo_brings_rows_back(face):
    bpy.ops.ed.undo_push(message="before")
    feel(face, happy=0.6, sad=0.4)
    bpy.ops.ed.undo_push(message="two")
    bpy.ops.anyface.emotion_add()
    bpy.ops.ed.undo_push(message="three")
    bpy.ops.anyface.emotion_mixture(name="Smug")
    bpy.ops.ed.undo_push(message="smug")
    assert bpy.ops.ed.undo() == {"FINISHED"}
    assert [name for name, _ in rows(bpy.data.objects["Head"])] == ["happy", "sad", "pleased"]
    bpy.ops.ed.undo()
    assert rows(bpy.data.objects["Head"]) == [("happy", 0.6), ("sad", 0.4)]
    bpy.ops.ed.redo()
    assert [name for name, _ in rows(bpy.data.objects["Head"])] == ["happy", "sad", "pleased"]


def test_a_duplicate_has_rows_of_its_own(stage, face):
    feel(face, happy=0.6, sad=0.4)
    (copy,) = duplicate(face)
    assert rows(copy) == [("happy", 0.6), ("sad", 0.4)]
    select(copy)
    bpy.ops.anyface.emotion_mixture(name="Smug")
    assert rows(face) == [("happy", 0.6), ("sad", 0.4)]
    assert rows(copy) == [("contempt", 0.8), ("happy", 0.4)]


def test_a_linked_face_says_so_and_speaks_with_its_mixture(stage, face, addon, tmp_path):
    feel(face, happy=0.6, sad=0.4)
    ob = link_from_library("Head", tmp_path)
    select(ob)
    assert rows(ob) == [("happy", 0.6), ("sad", 0.4)]
    for name in ("emotion_add", "emotion_remove", "emotion_mixture"):
        assert not getattr(bpy.ops.anyface, name).poll()
    settings = addon("ui.settings").from_object(ob)
    assert [(row.emotion, round(row.weight, 4)) for row in settings.mixture] == [("sad", 0.4)]


def test_an_override_has_rows_of_its_own(stage, face, tmp_path):
    feel(face, happy=0.6, sad=0.4)
    linked = link_from_library("Head", tmp_path)
    ob = linked.override_create(remap_local_usages=True)
    select(ob)
    assert rows(ob) == [("happy", 0.6), ("sad", 0.4)]
    ob.anyface.mixture[0].weight = 0.7
    assert bpy.ops.anyface.emotion_add() == {"FINISHED"}
    ob.anyface.mixture[1].weight = 0.1
    expected = rows(ob)
    assert len(expected) == 3
    shot = str(tmp_path / "shot.blend")
    bpy.ops.wm.save_as_mainfile(filepath=shot)
    bpy.ops.wm.open_mainfile(filepath=shot)
    ob = next(ob for ob in bpy.data.objects if ob.override_library is not None)
    assert rows(ob) == expected


def test_presets_hold_mixtures_and_those_of_one_emotion_have_one(face, addon, tmp_path):
    feel(face, happy=0.6, sad=0.4, angry=0.1)
    path = tmp_path / "mixed.json"
    assert bpy.ops.anyface.preset_export(filepath=str(path)) == {"FINISHED"}
    assert json.loads(path.read_text())["values"]["mixed"] == "sad:0.4,angry:0.1"
    feel(face, ill=1.0, drunk=0.2)
    presets = addon("ui.presets")
    presets.apply(addon("core.presets").read(path), face.anyface)
    assert rows(face) == [("happy", 0.6), ("sad", 0.4), ("angry", 0.1)]
    old = tmp_path / "old.json"
    old.write_text('{"anyface_preset": 1, "values": {"emotion": "ill", "intensity": 0.5}}')
    presets.apply(addon("core.presets").read(old), face.anyface)
    assert rows(face) == [("ill", 0.5)]
    # A preset that names no emotion leaves the mixture as it is.
    feel(face, happy=0.6, sad=0.4)
    old.write_text('{"anyface_preset": 1, "values": {"articulation": 0.5}}')
    presets.apply(addon("core.presets").read(old), face.anyface)
    assert rows(face) == [("happy", 0.6), ("sad", 0.4)]
    # Earlier versions can read a preset of one emotion, which has no mixture.
    feel(face, sad=0.5)
    bpy.ops.anyface.preset_export(filepath=str(path))
    assert "mixed" not in json.loads(path.read_text())["values"]


@pytest.mark.parametrize("text", ['"cheerful:1"', '"sad:2"', '"sad:x"', "3", '["sad"]'])
def test_presets_of_what_is_no_mixture_are_refused(addon, tmp_path, text):
    path = tmp_path / "bad.json"
    path.write_text(f'{{"anyface_preset": 1, "values": {{"mixed": {text}}}}}')
    with pytest.raises(addon("core.errors").AnyfaceError, match=r"bad\.json.*mixed"):
        addon("core.presets").read(path)


def test_a_take_brings_its_mixture_back(stage, face, addon):
    feel(face, happy=0.6, sad=0.4)
    generate(face)
    feel(face, ill=1.0)
    bring_back = addon("scene.takes.panel_settings").bring_back
    bring_back(face)
    assert rows(face) == [("happy", 0.6), ("sad", 0.4)]
    # A take of an earlier version has only one emotion.
    record = addon("scene.shape_keys.record")
    take_record = record.read(face.data.shape_keys)
    del take_record.asked["anyface"]["mixed"]
    record.write(face.data.shape_keys, take_record)
    bring_back(face)
    assert rows(face) == [("happy", 0.6)]


def test_the_command_and_the_scene_list_feel_the_mixture(stage, face, addon):
    feel(face, happy=0.6, sad=0.4)
    bake = addon("command.bake")
    options = addon("core.options").step_parser("bake").parse_args(["--object", "Head"])
    bake.run(options)
    assert requested_emotion(stage)[1][0] == pytest.approx(strengths(addon, happy=0.6, sad=0.4))
    words = ["--object", "Head", "--emotion", "angry:0.3,ill:0.2"]
    bake.run(addon("core.options").step_parser("bake").parse_args(words))
    assert requested_emotion(stage)[1] == pytest.approx(
        np.array([strengths(addon, angry=0.3, ill=0.2)])
    )
    bpy.context.scene.anyface_list.add().character = face
    assert bpy.ops.anyface.generate_scene() == {"FINISHED"}
    assert requested_emotion(stage)[1][0] == pytest.approx(strengths(addon, happy=0.6, sad=0.4))


def test_a_face_that_follows_its_sound_feels_the_mixture(face, addon):
    feel(face, happy=0.6, sad=0.4)
    feelings = []
    live, identity = addon("scene.live"), addon("scene.identity")
    still = np.zeros((len(face.data.vertices), 3), dtype=np.float32)
    follower = live.Follower(
        identity.number(face),
        face.name,
        [],
        SimpleNamespace(feel=feelings.append, at=lambda _seconds: still, close=lambda: None),
        SimpleNamespace(to_object=lambda moved: moved),
        START,
    )
    live._followers.append(follower)
    live.show(bpy.context.scene)
    live.end_all()
    assert feelings[0] == pytest.approx(strengths(addon, happy=0.6, sad=0.4))
