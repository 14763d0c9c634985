"""Curves with few keys show the same motion as one key per frame."""

import itertools
import os
import wave
from pathlib import Path

import bpy
import numpy as np
import pytest

from figures import curves, film

START, FPS, SECONDS, HEIGHT = 3, 30, 5.0, 0.25
TOLERANCE_MM = 0.2
CLIPS = Path(os.environ.get("ANYFACE_SHARED", "/nowhere")) / "data" / "clips"


@pytest.fixture
def voice(addon, tmp_path):
    """Five seconds of real speech as a sound file."""
    if not CLIPS.is_dir():
        pytest.skip("ANYFACE_SHARED names no folder of recordings")
    samples, rate, _ = engine(addon).decode(str(CLIPS / "Claire_neutral.wav"))
    path = tmp_path / "voice.wav"
    with wave.open(str(path), "wb") as file:
        file.setnchannels(1)
        file.setsampwidth(2)
        file.setframerate(int(rate))
        file.writeframes((samples[: int(SECONDS * rate)] * 32767.0).astype("<i2").tobytes())
    return path


def engine(addon):
    return addon("ui.running").engine("")


def head(voice, mode="basis"):
    """The default head with the voice as its sound."""
    bpy.context.scene.render.fps = FPS
    bpy.ops.anyface.add_sample_head(height=HEIGHT)
    ob = bpy.context.object
    ob.anyface.source, ob.anyface.start_frame = "FILE", START
    ob.anyface.sound_file, ob.anyface.mode = str(voice), mode
    ob.anyface_life_settings.use = False
    return ob


def generate(ob, kind):
    ob.anyface.curves = kind
    assert bpy.ops.anyface.generate() == {"FINISHED"}, ob.anyface.report


def own_curves(ob):
    return curves(ob.data.shape_keys.animation_data.action)


def count_keys(ob):
    return sum(len(curve.keyframe_points) for curve in own_curves(ob))


def frames():
    return START + np.arange(int(SECONDS * FPS))


def farthest_mm(addon, ob, one, other):
    """The largest distance of any vertex, mm on a head of human size."""
    settings = addon("ui.settings").from_object(ob)
    snapshot = addon("scene.bake").read(ob, bpy.context.scene, settings, engine(addon))
    take = snapshot.perform(addon("core.job").Progress(), range(3))
    return np.linalg.norm(one - other, axis=2).max() * take.unit_mm


@pytest.mark.parametrize("mode", ["basis", "arkit"])
def test_few_keys_show_the_take_within_the_tolerance(addon, voice, mode):
    ob = head(voice, mode)
    generate(ob, "EVERY")
    dense, many = film(ob, frames()), count_keys(ob)
    generate(ob, "SPARSE")
    sparse, few = film(ob, frames()), count_keys(ob)
    off = farthest_mm(addon, ob, sparse, dense)
    print(f"{mode}: {few} keys of {many}, {off:.3f} mm off")
    # The shapes of single phones take keys of their own.
    assert few < many / 3.5
    assert off < TOLERANCE_MM + 0.01
    # The take starts with the scene, in its first pose. Each curve ends with a key of rest, which
    # the report does not count.
    inner = few - len(own_curves(ob))
    assert f"{inner} keys on curves, within 0.2 mm" in ob.anyface.report_details


def test_sliders_and_the_way_back(addon, voice):
    ob = head(voice)
    generate(ob, "EVERY")
    dense = {}
    for name, value in (("articulation", 0.5), ("strength", 0.6), ("closing", 0.0)):
        setattr(ob.anyface_output, name, value)
        dense[name] = film(ob, frames())
        setattr(ob.anyface_output, name, 1.0)
    generate(ob, "SPARSE")
    before = film(ob, frames())
    for name, value in (("articulation", 0.5), ("strength", 0.6), ("closing", 0.0)):
        setattr(ob.anyface_output, name, value)
        off = farthest_mm(addon, ob, film(ob, frames()), dense[name])
        print(f"{name}: {off:.3f} mm off")
        assert off < 4.0 * TOLERANCE_MM, name
        setattr(ob.anyface_output, name, 1.0)
        assert farthest_mm(addon, ob, film(ob, frames()), before) < 0.005, name
    ob.anyface_output.shift = 5.0
    assert farthest_mm(addon, ob, film(ob, frames() + 5.0), before) < 0.005


def test_redo_leaves_all_outside_as_it_was(addon, voice):
    ob = head(voice)
    generate(ob, "SPARSE")
    first, last = 50, 90
    for frame in (first, last):
        bpy.context.scene.timeline_markers.new("F", frame=frame).select = True
    # A key's range cuts off what its curve does between frames, and a redo may widen it.
    for block in ob.data.shape_keys.key_blocks:
        block.slider_min, block.slider_max = -10.0, 10.0
    subframes = np.concatenate([np.arange(1, first + 0.1, 0.5), np.arange(last, 150, 0.5)])
    before, middle, many = film(ob, subframes), film(ob, [70]), count_keys(ob)
    ob.anyface.seed = 5
    assert bpy.ops.anyface.redo() == {"FINISHED"}, ob.anyface.report
    # Named keys move farther than mixtures and against each other; in few frames rounding shows.
    after = film(ob, subframes)
    apart = np.abs(after - before).max(axis=(1, 2))
    assert np.median(apart) < 1e-5
    assert farthest_mm(addon, ob, after, before) < 0.05
    assert np.abs(film(ob, [70]) - middle).max() > 1e-4
    # The redo adds keys at the cuts at both ends, and for the new motion.
    assert count_keys(ob) < 1.8 * many


def test_handles_are_aligned_and_run_forward(voice):
    ob = head(voice)
    generate(ob, "SPARSE")
    free = 0
    for curve in own_curves(ob):
        points = curve.keyframe_points
        for one, two in itertools.pairwise(points):
            assert one.co.x < one.handle_right.x < two.handle_left.x < two.co.x
        free += sum(point.handle_left_type == "FREE" for point in points)
        assert all(point.interpolation == "BEZIER" for point in points)
    # Only the first and the last frame of the take may have a corner.
    assert free <= 2 * len(own_curves(ob))


def test_a_curve_made_in_blender_gets_few_keys_within_its_part_of_the_tolerance(addon):
    sparse, at_once = addon("core.sparse"), addon("core.job").at_once
    values = np.sin(np.arange(120) * 0.15) * 0.3
    few = sparse.Few(engine(addon), TOLERANCE_MM)
    keys = at_once(few.keys(values, 10.0))
    assert len(keys.rows) < 40
    action, bag = addon("scene.animation.curves").new_action("Test", "OBJECT")
    at = np.concatenate([[-5.0], np.arange(120.0), [124.0]])
    padded = np.concatenate([[0.0], values, [0.0]])
    addon("scene.animation.curves").write_take(bag, "location", at, padded, keys, 1)
    curve = bag.fcurves.find("location", index=1)
    samples = np.array([curve.evaluate(frame) for frame in np.arange(120.0)])
    assert np.abs(samples - values).max() * 10.0 < sparse.ALONE * TOLERANCE_MM * 1.02
    bpy.data.actions.remove(action)
