"""Measures how close a take's sliders come to a new run; docs/blender-takes.md has the worst.

Part of `bench_blender.py`. Each case reports the worst of two voices and two emotions.
"""

import importlib
import itertools
import subprocess

import bpy
import numpy as np

import test_heads
from conftest import PACKAGE
from figures import film

SENTENCE = "The birch canoe slid on the smooth planks. Glue the sheet to the dark blue background."
HEADS = ("default head", "head.ply")
VOICES = ("slt", "rms")
EMOTIONS = (("happy", 0.7), ("angry", 1.0))
# The slider values of each case, by their names in `anyface_output`.
CASES = {
    "as made": {},
    "articulation 0.5": {"articulation": 0.5},
    "articulation 1.3": {"articulation": 1.3},
    "articulation 2": {"articulation": 2.0},
    "blinks 0": {"closing": 0.0},
    "articulation 1.3, emotion 0.5, blinks 0": {
        "articulation": 1.3,
        "emotion": 0.5,
        "closing": 0.0,
    },
    "emotion 0, blinks 0": {"emotion": 0.0, "closing": 0.0},
}
# The same for takes without blinks. A new run with another emotion blinks at other times, and that
# would hide all other differences.
WITHOUT_BLINKS = {
    "emotion 0": {"emotion": 0.0},
    "emotion 0.25": {"emotion": 0.25},
    "emotion 0.5": {"emotion": 0.5},
}


def measure(folder, empty):
    """Returns `{head: {case: (largest motion of the new run, mean error, largest error)}}` in mm.

    `head.ply` must be in `folder`.
    """
    misses = {}
    for head, voice, emotion in itertools.product(HEADS, VOICES, EMOTIONS):
        empty()
        ob = ready(folder, head, voice, emotion)
        rows = one_take(ob, CASES, emotion[1])
        ob.anyface.blinks_per_minute = 0.0
        rows |= one_take(ob, WITHOUT_BLINKS, emotion[1])
        for case, row in rows.items():
            worst = misses.setdefault(head, {})
            worst[case] = np.maximum(row, worst.get(case, 0.0))
    return misses


def ready(folder, head, voice, emotion):
    """A head in metres with a voice and an emotion."""
    sound = folder / f"{voice}.wav"
    if not sound.is_file():
        subprocess.run(["flite", "-voice", voice, "-t", SENTENCE, "-o", str(sound)], check=True)
    if head == "head.ply":
        bpy.ops.wm.ply_import(filepath=str(folder / head))
    else:
        test_heads.import_head()
    ob = test_heads.ready(bpy.context.object, str(sound))
    ob.anyface.emotion, ob.anyface.intensity = emotion
    return ob


def one_take(ob, cases, intensity):
    """Per case: how far the new run moves the face, and the slider's mean and largest error."""
    generate(ob, "basis")
    original, shown = whole(ob), {}
    for case, places in cases.items():
        for name, place in places.items():
            setattr(ob.anyface_output, name, place)
        shown[case] = whole(ob)
        for name in places:
            setattr(ob.anyface_output, name, 1.0)
    blinks_per_minute, rows = ob.anyface.blinks_per_minute, {}
    for case, places in cases.items():
        ob.anyface.articulation = places.get("articulation", 1.0)
        ob.anyface.intensity = intensity * places.get("emotion", 1.0)
        ob.anyface.blinks_per_minute = blinks_per_minute * places.get("closing", 1.0)
        generate(ob, "frames")
        truth = whole(ob)
        left = lengths_mm(shown[case], truth)
        rows[case] = np.array([lengths_mm(truth, original).max(), left.mean(), left.max()])
    ob.anyface.articulation, ob.anyface.intensity = 1.0, intensity
    ob.anyface.blinks_per_minute = blinks_per_minute
    return rows


def generate(ob, mode):
    """Generates a take that replaces the current one."""
    ob.anyface.mode = mode
    assert bpy.ops.anyface.generate() == {"FINISHED"}


def whole(ob):
    """Positions `[T, V, 3]` of all frames of the take, without those that ease back to rest."""
    end = ob.data.shape_keys.animation_data.action.frame_range[1]
    ease = importlib.import_module(f"{PACKAGE}.scene.animation.curves").EASE_S
    return film(ob, range(1, int(end - ease * bpy.context.scene.render.fps) + 1))


def lengths_mm(a, b):
    """Distances in mm between vertices whose positions are in metres."""
    return 1000 * np.linalg.norm(a - b, axis=2)
