"""Sliders that change a finished take as a new run would."""

import json

import bpy
import numpy as np
import pytest

import figures
from figures import Stage, curves, everything, film, grid, motion, shape, stand_in, tone

START = 5
FPS = 24
NAMES = ("articulation", "emotion", "blinks")
# The name of the property on the panel, where it differs.
PROPERTY = {"blinks": "closing"}


@pytest.fixture
def stage(addon):
    """A `Stage` that replaces the engine. Its takes have all sliders."""
    stage = Stage(addon("core.take"))
    stage.sliders = NAMES
    stand_in(addon, stage)
    return stage


def ready(tmp_path):
    bpy.context.scene.render.fps = FPS
    ob = grid()
    ob.anyface.source, ob.anyface.start_frame = "FILE", START
    ob.anyface.sound_file = tone(tmp_path / "tone.wav")
    return ob


def generate():
    assert bpy.ops.anyface.generate() == {"FINISHED"}


def values(ob):
    """The values of all keyframes of a take."""
    fcurves = curves(ob.data.shape_keys.animation_data.action)
    return np.array([[point.co[1] for point in curve.keyframe_points] for curve in fcurves])


def expected_face(addon, stage, position, name, frame):
    """The displacements `[V, 3]` at a frame of the take with one slider at `position`."""
    moved = motion(2 * FPS, 144, stage.rank, stage.size)
    take_basis = figures.basis(stage.take_module, moved)
    changes = figures.sliders(addon("core.sliders"), NAMES, take_basis.weights)
    weights = take_basis.weights + changes[name].at(position)
    return np.tensordot(weights[frame], take_basis.vectors, axes=1)


@pytest.mark.parametrize("name", NAMES)
def test_a_slider_shows_what_its_variation_is(stage, tmp_path, addon, name):
    ob = ready(tmp_path)
    rest = shape(ob, START)
    generate()
    frame = 12
    for position in (0.0, 0.4, 1.0):
        setattr(ob.anyface_output, PROPERTY.get(name, name), position)
        assert getattr(ob.anyface_output, PROPERTY.get(name, name)) == pytest.approx(position)
        moved = shape(ob, START + frame) - rest
        assert np.abs(moved - expected_face(addon, stage, position, name, frame)).max() < 2e-6, (
            position
        )


@pytest.mark.parametrize("start", [1, START])
def test_blinks_leave_the_other_frames_alone(stage, tmp_path, start):
    ob = ready(tmp_path)
    ob.anyface.start_frame = start
    generate()
    frames = start + np.arange(2 * FPS)
    before = film(ob, frames)
    ob.anyface_output.closing = 0.0
    changed = np.abs(film(ob, frames) - before).max(axis=(1, 2)) > 1e-6
    assert np.flatnonzero(changed).tolist() == list(range(10, 15))


def test_sliders_add_up_with_strength_and_shift_and_go_back(stage, tmp_path):
    ob = ready(tmp_path)
    rest = shape(ob, START)
    generate()
    settings, frames = ob.anyface_output, START + np.arange(2 * FPS)
    alone, before = {}, film(ob, frames) - rest
    first = values(ob)
    for name in ("articulation", "emotion"):
        setattr(settings, name, 0.3)
        alone[name] = film(ob, frames) - rest - before
        setattr(settings, name, 1.0)
    settings.strength, settings.articulation, settings.shift = 0.5, 0.3, 4.0
    settings.emotion, settings.strength = 0.3, 0.8
    both = film(ob, frames + 4.0) - rest
    assert np.abs(both - 0.8 * (before + sum(alone.values()))).max() < 2e-6
    settings.articulation = settings.emotion = settings.strength = 1.0
    settings.shift = 0.0
    assert np.abs(film(ob, frames) - rest - before).max() < 2e-6
    assert np.abs(values(ob) - first).max() < 1e-6


def test_emotion_and_blinks_change_more_together_than_each_alone(stage, tmp_path, addon):
    module = addon("core.sliders")
    stage.sliders = module.ALL
    ob = ready(tmp_path)
    rest = shape(ob, START)
    generate()
    take_basis = figures.basis(stage.take_module, motion(2 * FPS, 144, stage.rank, stage.size))
    changes = figures.sliders(module, module.ALL, take_basis.weights)
    first = values(ob)
    for emotion, blinks in ((0.0, 0.0), (0.3, 0.4), (1.5, 0.0), (0.3, 1.0)):
        ob.anyface_output.emotion, ob.anyface_output.closing = emotion, blinks
        together = 1.0 - (1.0 - emotion) * (1.0 - blinks)
        places = {"emotion": emotion, "blinks": blinks, module.TOGETHER: together}
        weights = take_basis.weights + sum(
            changes[name].at(place) for name, place in places.items()
        )
        moved = shape(ob, START + 12) - rest
        assert np.abs(moved - np.tensordot(weights[12], take_basis.vectors, axes=1)).max() < 2e-6
    ob.anyface_output.emotion = ob.anyface_output.closing = 1.0
    assert np.abs(values(ob) - first).max() < 1e-6


def test_keys_have_room_for_every_place_of_every_slider(stage, tmp_path):
    ob = ready(tmp_path)
    generate()
    for place in (0.0, 1.5):
        for name in NAMES:
            setattr(ob.anyface_output, PROPERTY.get(name, name), place)
        for block, numbers in zip(ob.data.shape_keys.key_blocks[1:], values(ob), strict=True):
            assert block.slider_min <= numbers.min() and numbers.max() <= block.slider_max


def test_a_slider_ends_where_its_variations_end(stage, tmp_path):
    ob = ready(tmp_path)
    generate()
    ob.anyface_output.articulation = 2.0
    assert ob.anyface_output.articulation == 1.5
    ob.anyface_output.closing = 0.5
    assert ob.anyface_output.closing == 0.5


def test_work_of_the_artist_on_the_curves_goes_along(stage, tmp_path):
    ob = ready(tmp_path)
    generate()
    curve = curves(ob.data.shape_keys.animation_data.action)[0]
    curve.keyframe_points[20].co[1] += 0.25
    curve.update()
    before = [tuple(point.co) for point in curve.keyframe_points]
    ob.anyface_output.articulation = 0.2
    ob.anyface_output.articulation = 1.0
    for point, (frame, value) in zip(curve.keyframe_points, before, strict=True):
        assert tuple(point.co) == pytest.approx((frame, value), abs=1e-6)


def test_sliders_survive_saving_and_go_with_the_take(stage, tmp_path, addon):
    ob = ready(tmp_path)
    before = everything()
    generate()
    frames = START + np.arange(0, 2 * FPS, 7)
    normal = film(ob, frames)
    ob.anyface_output.emotion = 0.0
    changed = film(ob, frames)
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "shot.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "shot.blend"))
    ob = bpy.data.objects["Head"]
    assert ob.anyface_output.emotion == 0.0
    assert np.abs(film(ob, frames) - changed).max() < 1e-6
    ob.anyface_output.emotion = 1.0
    assert np.abs(film(ob, frames) - normal).max() < 2e-6
    assert bpy.ops.anyface.remove() == {"FINISHED"}
    assert [row for row in everything() if "sounds" not in row] == before


def test_a_slider_is_undone_in_one_step(stage, tmp_path):
    ob = ready(tmp_path)
    bpy.ops.ed.undo_push(message="before")
    generate()
    bpy.ops.ed.undo_push(message="Generate")
    frames = START + np.arange(0, 2 * FPS, 7)
    normal = film(ob, frames)
    ob.anyface_output.emotion = 0.2
    bpy.ops.ed.undo_push(message="Emotion")
    changed = film(ob, frames)
    bpy.ops.ed.undo()
    ob = bpy.data.objects["Head"]
    assert ob.anyface_output.emotion == 1.0
    assert np.abs(film(ob, frames) - normal).max() < 1e-7
    bpy.ops.ed.redo()
    ob = bpy.data.objects["Head"]
    assert ob.anyface_output.emotion == pytest.approx(0.2)
    assert np.abs(film(ob, frames) - changed).max() < 1e-7


def test_each_take_keeps_its_own_sliders(stage, tmp_path, addon):
    takes, ob = addon("scene.takes.take_list"), ready(tmp_path)
    before = everything()
    ob.anyface_output.new_take = True
    generate()
    ob.anyface_output.articulation = 0.5
    stage.sliders = ("emotion",)
    generate()
    adjust, rows = addon("scene.takes.adjust"), {row.name: row.id for row in takes.rows(ob)}
    assert adjust.why_not(ob, "emotion") == "" and adjust.why_not(ob, "articulation")
    assert ob.anyface_output.articulation == 1.0
    takes.switch(ob, rows["Take 1"])
    assert adjust.why_not(ob, "articulation") == ""
    assert ob.anyface_output.articulation == 0.5
    ob.anyface_output.articulation = 1.0
    takes.push_down(ob, rows["Take 1"])
    takes.delete(ob, rows["Take 1"])
    takes.delete(ob, rows["Take 2"])
    assert everything() == before


def test_objects_beside_the_face_follow(stage, tmp_path):
    ob = ready(tmp_path)
    teeth = grid("Teeth_low", side=5, scale=0.1)
    teeth.location = (0.0, 0.02, -0.03)
    bpy.context.view_layer.objects.active = ob
    bpy.context.view_layer.update()
    bpy.ops.anyface.find_parts()
    generate()
    before = shape(teeth, START + 20)
    ob.anyface_output.articulation = 0.0
    assert np.abs(shape(teeth, START + 20) - before).max() > 1e-5
    ob.anyface_output.articulation = 1.0
    assert np.abs(shape(teeth, START + 20) - before).max() < 1e-6


def test_what_cannot_act_says_why(stage, tmp_path, addon):
    adjust, ob = addon("scene.takes.adjust"), ready(tmp_path)
    stage.sliders = ()
    generate()
    said = {name: adjust.why_not(ob, name) for name in NAMES}
    assert "without an emotion" in said["emotion"] and "blinks" in said["blinks"]
    before = values(ob)
    ob.anyface_output.emotion = 0.0
    assert ob.anyface_output.emotion == 1.0 and (values(ob) == before).all()
    ob.anyface.emotion_source = "OFF"
    generate()
    assert "emotion off" in adjust.why_not(ob, "blinks")
    ob.anyface.keyframe_insert("articulation", frame=START)
    ob.anyface.articulation = 0.5
    ob.anyface.keyframe_insert("articulation", frame=START + 20)
    generate()
    assert "changed over time" in adjust.why_not(ob, "articulation")
    ob.anyface.mode = "frames"
    generate()
    assert "New Keys" in adjust.why_not(ob, "emotion")


def test_takes_of_an_earlier_version_say_so(stage, tmp_path, addon):
    ob = ready(tmp_path)
    generate()
    keys = ob.data.shape_keys
    old = {k: v for k, v in json.loads(keys["anyface"]).items() if k not in ("still", "frame_step")}
    keys["anyface"] = json.dumps(old)
    keys["anyface_sliders_" + old["id"]] = b"damaged"
    assert "earlier version" in addon("scene.takes.adjust").why_not(ob, "emotion")
    ob.anyface_output.strength = 0.5
    assert ob.anyface_output.strength == 0.5


def test_caches_say_why(stage, tmp_path, addon):
    ob = ready(tmp_path)
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "shot.blend"))
    ob = bpy.data.objects["Head"]
    ob.anyface.mode = "cache"
    generate()
    assert "cache" in addon("scene.takes.adjust").why_not(ob, "blinks")


def test_packing_loses_next_to_nothing(addon):
    sliders, random = addon("core.sliders"), np.random.default_rng(1)
    rows = np.sign(random.normal(size=(2, 40, 3))) * random.uniform(0.9, 1.0, size=(2, 40, 3))
    changes = {
        "emotion": sliders.SliderChange(np.array([0.0, 1.5]), rows.astype(np.float32)),
        "blinks": sliders.SliderChange(np.array([0.0]), np.zeros((1, 40, 3), dtype=np.float32)),
    }
    unpacked = sliders.unpack(sliders.pack(changes))
    assert list(unpacked) == list(changes)
    for name, change in changes.items():
        assert (unpacked[name].knots == change.knots).all()
        assert np.abs(unpacked[name].changes - change.changes).max() < 3e-4
    for damaged in (b"", b"AFS1", b"AFS1\x10\x00\x00\x00{}", sliders.pack(changes)[:-9]):
        with pytest.raises(ValueError):
            sliders.unpack(damaged)
