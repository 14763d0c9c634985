"""What mending one word costs: *Redo* of half a second in a take of five seconds, for every output.

Run in Blender's Python module, on a zip with the library. The head is the default one, the voice
flite's, the rig the crude one of rigs.py. The mode `events` makes new keys with Cafe-Talk and four
events. Each line gives the clock time of the faster of two runs, and its processor time summed over
all threads.
"""

# Import this first: it sets Blender's resource folder, which Blender reads only once.
from conftest import PACKAGE, zip_path  # isort: skip

import importlib
import os
import shutil
import sys
import tempfile
import time
from pathlib import Path

import bpy
import numpy as np

import rigs
from bench_blender import SHORT_S, own_arkit_keys, speak

FPS, FIRST, LAST = 24, 50, 62
EVENT_CHANNEL = 5
MODES = tuple(sys.argv[1:]) or ("basis", "frames", "cache", "keys", "arkit", "csv", "controls",
                               "events")  # fmt: skip


def main() -> None:
    """Prints one line of a table for each output."""
    folder = Path(tempfile.mkdtemp(prefix="anyface-redo-"))
    try:
        bpy.ops.extensions.package_install_files(
            filepath=str(zip_path()), repo="user_default", enable_on_install=True
        )
        speak(folder)
        for mode in MODES:
            measure(mode, folder)
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def measure(mode: str, folder: Path) -> None:
    """Generates with an output, mends a word twice, and counts the frames outside that changed."""
    ob = character(mode, folder)
    assert bpy.ops.anyface.generate() == {"FINISHED"}
    scene = bpy.context.scene
    scene.use_preview_range = True
    scene.frame_preview_end, scene.frame_preview_start = LAST, FIRST
    outside, spent = [10, FIRST, LAST, 100], []
    before = [positions(ob, frame) for frame in outside]
    for seed in (1, 2):
        ob.anyface.seed = seed
        began, busy = time.perf_counter(), time.process_time()
        assert bpy.ops.anyface.redo() == {"FINISHED"}
        spent.append((time.perf_counter() - began, time.process_time() - busy))
    apart = [not np.array_equal(positions(ob, f), b) for f, b in zip(outside, before, strict=True)]
    clock, busy = min(spent)
    times = f"{clock:.2f} s | {busy:.2f} s"
    print(f"| {mode} | {times} | {sum(apart)} frames outside changed |", flush=True)


def character(mode: str, folder: Path):
    """The default head in a new file, prepared for the output."""
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    bpy.context.scene.render.fps = FPS
    ob = rigs.head()
    ob.anyface.source, ob.anyface.sound_file = "FILE", str(folder / f"{SHORT_S:.0f}.wav")
    bpy.ops.wm.save_as_mainfile(filepath=str(folder / f"{mode}.blend"))
    ob = bpy.data.objects["Head"]
    if mode == "keys":
        own_arkit_keys(ob)
    if mode == "controls":
        rigs.crude(addon, ob)
    if mode == "events":
        put_events(ob)
    ob.anyface.mode = "basis" if mode == "events" else mode
    return ob


def put_events(ob) -> None:
    """Selects Cafe-Talk and puts four events above the voice, one of them in the redone stretch."""
    scene = bpy.context.scene
    ob.anyface.system, ob.anyface_audio.event_channel = "cafe-talk", EVENT_CHANNEL
    for frame, text in ((10, "smile"), (35, "wink"), (FIRST, "jaw drop"), (80, "brow raise")):
        addon("scene.event_strips").add(scene, ob, EVENT_CHANNEL, text, frame)


def addon(name: str):
    """A module of the extension."""
    return importlib.import_module(f"{PACKAGE}.{name}")


def positions(ob, frame: int) -> np.ndarray:
    """The evaluated mesh at a frame."""
    bpy.context.scene.frame_set(frame)
    mesh = ob.evaluated_get(bpy.context.evaluated_depsgraph_get()).data
    flat = np.empty(len(mesh.vertices) * 3, dtype=np.float32)
    mesh.vertices.foreach_get("co", flat)
    return flat


if __name__ == "__main__":
    main()
    sys.stdout.flush()
    os._exit(0)
