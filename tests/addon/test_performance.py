"""Sliders that change over time, and presets."""

import json

import bpy
import numpy as np
import pytest

from figures import grid, stand_in, tone


@pytest.fixture
def stage(addon):
    """A `Stage` that replaces the engine."""
    return stand_in(addon)


@pytest.fixture
def face(tmp_path):
    """A face with two seconds of sound from frame 1 on, 24 frames a second."""
    bpy.context.scene.render.fps = 24
    ob = grid()
    ob.anyface.source, ob.anyface.sound_file = "FILE", tone(tmp_path / "a.wav")
    return ob


def drive(ob, name, expression):
    """Puts a driver on a slider."""
    driver = ob.driver_add(f"anyface.{name}").driver
    driver.expression = expression


def last_request(stage):
    """The last request that the library received."""
    return stage.calls[-1][5]


@pytest.mark.parametrize("name", ["articulation", "jaw", "rounding", "upper_face", "asymmetry"])
def test_keyframes_on_sliders_become_curves(stage, face, name):
    for frame, value in ((1, 0.0), (49, 1.0)):
        setattr(face.anyface, name, value)
        face.keyframe_insert(f"anyface.{name}", frame=frame)
    bpy.ops.anyface.generate()
    times, values = last_request(stage).control_keys[name]
    assert np.interp([0.0, 2.0], times, values) == pytest.approx([0.0, 1.0], abs=1e-3)
    assert np.interp(1.0, times, values) == pytest.approx(0.5, abs=0.01)


def test_drivers_on_sliders_become_curves(stage, face):
    drive(face, "articulation", "frame / 49")
    drive(face, "intensity", "0.5 + frame / 98")
    bpy.context.scene.frame_set(7)
    bpy.ops.anyface.generate()
    assert bpy.context.scene.frame_current == 7
    times, values = last_request(stage).control_keys["articulation"]
    assert np.interp([0.0, 1.9], times, values) == pytest.approx([1 / 49, 46.6 / 49], abs=0.01)
    emotion = last_request(stage).fields["emotion"]
    # Two seconds of sound, ten rows a second.
    assert 20 <= len(emotion) <= 23 and emotion[0][1][0] == pytest.approx(0.51, abs=0.01)


def test_nla_strips_on_sliders_become_curves(stage, face):
    for frame, value in ((1, 0.0), (49, 1.0)):
        face.anyface.brow_accents = value
        face.keyframe_insert("anyface.brow_accents", frame=frame)
    animation = face.animation_data
    animation.nla_tracks.new().strips.new("Curve", 1, animation.action)
    animation.action = None
    bpy.ops.anyface.generate()
    times, values = last_request(stage).control_keys["brow_accents"]
    assert np.interp([0.0, 1.0], times, values) == pytest.approx([0.0, 0.5], abs=0.02)


def test_sliders_that_stand_still_are_no_curves(stage, face):
    face.anyface.articulation = 0.7
    bpy.ops.anyface.generate()
    assert last_request(stage).control_keys == {}
    assert last_request(stage).controls["articulation"] == pytest.approx(0.7)


def test_sliders_of_a_whole_take_cannot_be_keyed(face):
    for name in ("smoothing_s", "blinks_per_minute", "seed", "mode"):
        with pytest.raises(TypeError, match="not animatable"):
            face.keyframe_insert(f"anyface.{name}", frame=1)


# Name: least, largest and default value, and whether it may have keys. Old .blend files, drivers
# and presets depend on these.
STORED = {
    "articulation": (0.0, 2.0, 1.0, True),
    "jaw": (0.0, 2.0, 1.0, True),
    "rounding": (0.0, 2.0, 1.0, True),
    "width": (0.0, 2.0, 1.0, True),
    "smoothing_s": (0.0, 0.1, 0.0, False),
    "upper_face": (0.0, 2.0, 1.0, True),
    "blinks_per_minute": (0.0, 60.0, 15.0, False),
    "brow_accents": (0.0, 2.0, 1.0, True),
    "asymmetry": (-1.0, 1.0, 0.0, True),
    "head_motion": (0.0, 2.0, 1.0, True),
    "gaze": (0.0, 2.0, 1.0, True),
    "tongue": (0.0, 2.0, 1.0, True),
    "breath": (0.0, 2.0, 1.0, True),
    "onset": (0.0, 2.0, 1.0, False),
    "variety": (0.0, 2.0, 1.0, True),
    "effort": (0.0, 2.0, 1.0, True),
    "steps": (0, 1000, 0, False),
    "learned": (0.0, 1.0, 1.0, False),
}


def test_controls_are_stored_as_they_always_were(face):
    for name, (low, high, default, animatable) in STORED.items():
        prop = face.anyface.bl_rna.properties[name]
        assert prop.type == ("INT" if name == "steps" else "FLOAT"), name
        limits = prop.hard_min, prop.hard_max, prop.default
        assert limits == pytest.approx((low, high, default)), name
        assert prop.is_animatable == animatable and prop.name and prop.description, name
    assert face.anyface.decoder == "static"


def test_presets_hold_what_they_always_held(addon):
    preset_names = set(addon("core.presets").names())
    levels = {"intensity", "event_strength", "emotion_level", "vividness", "speech_guidance"}
    levels |= {"noise", "coarse_guidance"}
    field = {"field", "field_reach", "template"}
    assert preset_names == {"emotion", "emotion_source", "mixed", *levels, *field, *STORED} - {
        "steps"
    }


def values_of(ob, addon):
    names = addon("core.presets").names()
    return {name: getattr(ob.anyface, name) for name in names}


def test_a_saved_preset_comes_back(stage, face, addon, installed):
    face.anyface.articulation, face.anyface.emotion = 1.3, "sad"
    before = values_of(face, addon)
    assert bpy.ops.anyface.preset_save(name="Weinerlich / Test") == {"FINISHED"}
    folder = addon("ui.presets").own_folder()
    path = folder / "weinerlich_test.json"
    assert path.is_file() and installed not in path.parents
    face.anyface.articulation, face.anyface.emotion = 0.1, "happy"
    assert bpy.ops.anyface.preset_apply(path=str(path)) == {"FINISHED"}
    assert values_of(face, addon) == pytest.approx(before)
    assert "Weinerlich / Test" in [preset.name for preset in addon("ui.presets").everyone()]
    assert bpy.ops.anyface.preset_delete(name="Weinerlich / Test") == {"FINISHED"}
    assert not path.exists()


def test_presets_from_before_jaw_had_a_control_are_read(addon, tmp_path):
    path = tmp_path / "old.json"
    path.write_text('{"anyface_preset": 1, "values": {"articulation": 0.5, "jaw_lips": -0.4}}')
    values = addon("core.presets").read(path).values
    assert values == pytest.approx({"articulation": 0.6, "jaw": 0.8 / 1.2})
    path.write_text('{"anyface_preset": 1, "values": {"jaw_lips": "much"}}')
    with pytest.raises(addon("core.errors").AnyfaceError, match="jaw_lips"):
        addon("core.presets").read(path)


def test_presets_are_handed_on_as_files(stage, face, addon, tmp_path):
    face.anyface.upper_face = 1.75
    assert bpy.ops.anyface.preset_export(filepath=str(tmp_path / "mine")) == {"FINISHED"}
    face.anyface.upper_face = 0.0
    assert bpy.ops.anyface.preset_import(filepath=str(tmp_path / "mine.json")) == {"FINISHED"}
    assert face.anyface.upper_face == 1.75
    (addon("ui.presets").own_folder() / "mine.json").unlink()


def test_an_import_replaces_no_preset_of_the_same_name(stage, face, addon, tmp_path):
    own_folder = addon("ui.presets").own_folder(create=True)
    face.anyface.upper_face = 1.25
    assert bpy.ops.anyface.preset_save(name="Mine") == {"FINISHED"}
    before = (own_folder / "mine.json").read_bytes()
    face.anyface.upper_face = 1.75
    assert bpy.ops.anyface.preset_export(filepath=str(tmp_path / "mine")) == {"FINISHED"}
    with pytest.raises(RuntimeError, match="exists already"):
        bpy.ops.anyface.preset_export(filepath=str(tmp_path / "mine"))
    for _ in range(2):
        bpy.ops.anyface.preset_import(filepath=str(tmp_path / "mine.json"))
    assert (own_folder / "mine.json").read_bytes() == before
    assert {path.name for path in own_folder.glob("mine*")} == {"mine.json", "mine_2.json"}
    for path in own_folder.glob("mine*"):
        path.unlink()


def test_shipped_presets_are_good_and_stay(stage, face, addon, installed):
    presets = addon("core.presets")
    shipped = sorted((installed / "presets").glob("*.json"))
    names = [presets.read(path).name for path in shipped]
    assert 4 <= len(names) <= 8 and len(set(names)) == len(names)
    for path in shipped:
        assert bpy.ops.anyface.preset_apply(path=str(path)) == {"FINISHED"}
        assert bpy.ops.anyface.generate() == {"FINISHED"}
    with pytest.raises(RuntimeError, match="one of your own"):
        bpy.ops.anyface.preset_delete(name=names[0])


def test_the_natural_preset_is_the_default(face, addon, installed):
    defaults = values_of(face, addon)
    face.anyface.articulation, face.anyface.blinks_per_minute = 0.3, 50.0
    bpy.ops.anyface.preset_apply(path=str(installed / "presets" / "natural.json"))
    assert values_of(face, addon) == pytest.approx(defaults)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("{", "not JSON"),
        ("[]", "expected an Anyface preset"),
        ('{"anyface_preset": 9}', "of version 1"),
        ('{"anyface_preset": 1, "values": {"articulation": 3}}', "expected 0 to 2, got 3"),
        ('{"anyface_preset": 1, "values": {"articulation": NaN}}', "got NaN"),
        ('{"anyface_preset": 1, "values": {"emotion": "merry"}}', "got 'merry'"),
        ('{"anyface_preset": 1, "values": {"sound_file": "x"}}', "got 'sound_file'"),
    ],
)
def test_files_that_are_no_presets_are_refused_in_words(face, addon, tmp_path, text, message):
    path = tmp_path / "other.json"
    path.write_text(text)
    before = values_of(face, addon)
    with pytest.raises(RuntimeError, match="other.json.*" + message):
        bpy.ops.anyface.preset_import(filepath=str(path))
    assert values_of(face, addon) == before
    assert "other" not in json.dumps([p.name for p in addon("ui.presets").everyone()])


def test_preset_ranges_are_those_of_the_sliders(face, addon):
    sliders = face.anyface.bl_rna.properties
    for name, (low, high) in addon("core.presets").numbers().items():
        limits = sliders[name].hard_min, sliders[name].hard_max
        assert limits == pytest.approx((low, high)), name
