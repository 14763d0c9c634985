"""The head and the long take of bench_landing.py, for both Blender's module and its window."""

import time
from dataclasses import replace
from pathlib import Path

import bpy
import numpy as np

from figures import babble, grid

MINUTES, FPS, SIDE, KEYS = 10, 24, 163, 56
_TEETH = 5


def prepare(addon, folder: str):
    """Makes a head with teeth whose sound is a short tone, and a take of `MINUTES` for it."""
    bpy.context.scene.render.fps = FPS
    for ob in list(bpy.data.objects):
        bpy.data.objects.remove(ob)
    teeth, head = grid("Teeth_low", _TEETH, 0.05), grid("Head", SIDE)
    head.anyface.source = "FILE"
    head.anyface.sound_file = babble(Path(folder) / "voice.wav")
    part = head.anyface_face.parts.add()
    part.object, part.name, part.role = teeth, teeth.name, "jaw"
    return head, _take(addon, SIDE**2 + _TEETH**2)


def _take(addon, vertices: int):
    """A take of random motion, `MINUTES` long. Every key moves in every frame."""
    module, random = addon("core.take"), np.random.default_rng(1)
    weights = random.uniform(-1, 1, (MINUTES * 60 * FPS, KEYS)).astype(np.float32)
    vectors = random.normal(size=(KEYS, vertices, 3)).astype(np.float32) * 1e-3
    take = module.Take(float(FPS), 9.0, "basis", module.Basis(vectors, weights, 0.1))
    return replace(take, largest_of=[9.0, 9.0])


def landing(addon, head, take):
    """The generator that writes the take onto the head in steps."""
    settings = addon("ui.settings").from_object(head)
    engine = addon("ui.running").engine(settings.system)
    bake = addon("scene.bake")
    return bake.landing(head, bake.read(head, bpy.context.scene, settings, engine), take)


def watch(addon, take, spent: list[float], looks: list[float]) -> None:
    """From now on *Generate* writes `take` and appends the seconds of each slice to `spent`.

    `looks`, the list of `pulse`, starts anew at the first slice.
    """
    addon("scene.bake").Snapshot.work = lambda self, progress: take
    time_slices(addon, spent, looks)


def time_slices(addon, spent: list[float], looks: list[float]) -> None:
    """As `watch`, but for whatever take *Generate* makes."""
    operators = addon("ui.operators")
    slice_of = operators.InThread._slice

    def timed(self, context):
        if not spent:
            looks[:] = [time.thread_time()]
        began = time.perf_counter()
        try:
            return slice_of(self, context)
        finally:
            spent.append(time.perf_counter() - began)

    operators.InThread._slice = timed


def pulse() -> list[float]:
    """Starts a timer that notes the processor time of the interface's thread, in seconds.

    Returns the list that the timer appends to.
    """
    times = []

    def look():
        times.append(time.thread_time())
        return 0.004

    bpy.app.timers.register(look)
    return times
