"""Measures what the extension costs in Blender, for the tables of docs/measured/speed.md.

It also prints the sliders' errors for docs/blender-takes.md.

Run by `cargo xtask addon --bench` in Blender's Python module, on a zip with the optimised library.
If `ANYFACE_BLENDER` names an executable beside `enter` (packaging/chroot.sh), the numbers of a
window are measured there. The head is the default one, subdivided and then decimated to `VERTICES`.
The voice is flite's, which reads `TEXT` over and over.
"""

# Import this first: it sets Blender's resource folder, which Blender reads only once.
from conftest import PACKAGE, zip_path  # isort: skip

import importlib
import os
import shutil
import subprocess
import sys
import tempfile
import time
import wave
from contextlib import contextmanager
from pathlib import Path

import bpy
import numpy as np

import bench_search
import bench_sliders
from figures import write_wav
from screen import Screen, install_in
from test_heads import import_head

TEXT = (
    "The birch canoe slid on the smooth planks. Glue the sheet to the dark blue background. "
    "It is easy to tell the depth of a well. These days a chicken leg is a rare dish. "
    "Rice is often served in round bowls. The juice of lemons makes fine punch. "
    "The box was thrown beside the parked truck. The hogs were fed chopped corn and garbage. "
    "Four hours of steady work faced us. A large size in stockings is hard to sell. "
)
SHORT_S, LONG_S, ENDLESS_S = 5.0, 50.0, 300.0
FPS, LONG_FPS = 24, 30
VERTICES = 26_700
TIMES = 3
# Speech is generated and removed this many times, to see how much memory stays in use.
CYCLES = 12
# Esc is pressed after this many seconds of work.
ESC_AFTER_S = (0.3, 2.0, 6.0)
TIMED = """
import importlib, time
bake = importlib.import_module('bl_ext.user_default.anyface.scene.bake')
spent = bpy.app.driver_namespace.setdefault('spent', {'read': [], 'write': []})
def timed(name, function):
    def call(*arguments):
        began = time.perf_counter()
        try:
            return function(*arguments)
        finally:
            spent[name].append(time.perf_counter() - began)
    return call
for name in spent:
    setattr(bake, name, timed(name, getattr(bake, name)))
"""
SCENE = """
window, area, region, side = area_of('VIEW_3D')
area.spaces[0].show_region_ui = True
for ob in list(bpy.data.objects):
    bpy.data.objects.remove(ob)
with bpy.context.temp_override(window=window, area=area, region=region):
    bpy.ops.wm.ply_import(filepath={mesh!r})
    bpy.ops.view3d.view_axis(type='FRONT')
    bpy.ops.view3d.view_all()
ob = bpy.context.object
ob.name = 'Head'
ob.anyface.source, ob.anyface.sound_file = 'FILE', {voice!r}
"""


def main() -> None:
    """Prints one line of a table for each measurement. Arguments name the parts to measure."""
    parts = {
        "headless": headless,
        "estimates": estimates,
        "sliders": sliders,
        "cycles": cycles,
        "refusals": refusals,
        "window": with_window,
    }
    folder = Path(tempfile.mkdtemp(prefix="anyface-bench-"))
    try:
        bpy.ops.extensions.package_install_files(
            filepath=str(zip_path()), repo="user_default", enable_on_install=True
        )
        prepare(folder)
        for part in sys.argv[1:] or parts:
            parts[part](folder)
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def line(what: str, *values) -> None:
    """One line of a Markdown table."""
    print(f"| {what} | {', '.join(str(value) for value in values)} |", flush=True)


def seconds(values) -> str:
    """ "0.92 to 1.01 s", or milliseconds where that reads better."""
    low, high = min(values), max(values)
    if high < 0.2:
        return f"{1000 * low:.0f} to {1000 * high:.0f} ms"
    return f"{low:.2f} to {high:.2f} s"


def prepare(folder: Path) -> None:
    """Writes the voices and the head, `head.ply`."""
    speak(folder)
    empty()
    ob = import_head()
    change(ob, "SUBSURF", subdivision_type="SIMPLE", levels=1)
    change(ob, "TRIANGULATE")
    change(ob, "DECIMATE", ratio=VERTICES / len(ob.data.vertices))
    bpy.ops.wm.ply_export(filepath=str(folder / "head.ply"))
    line("Blender, vertices, processors", bpy.app.version_string, len(ob.data.vertices), cores())
    line("load of the machine before", f"{os.getloadavg()[0]:.1f}")


def empty() -> None:
    """A new file without objects."""
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)


def change(ob, kind: str, **settings) -> None:
    """Applies a modifier."""
    modifier = ob.modifiers.new(kind, kind)
    for name, value in settings.items():
        setattr(modifier, name, value)
    bpy.ops.object.modifier_apply(modifier=kind)


def cores() -> int:
    """Processors that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()


def speak(folder: Path) -> None:
    """Writes 5.wav, 50.wav and 300.wav."""
    spoken = folder / "spoken.wav"
    subprocess.run(["flite", "-voice", "slt", "-t", TEXT, "-o", str(spoken)], check=True)
    with wave.open(str(spoken), "rb") as file:
        rate = file.getframerate()
        samples = np.frombuffer(file.readframes(file.getnframes()), dtype="<i2") / 32768.0
    for length_s in (SHORT_S, LONG_S, ENDLESS_S):
        write_wav(folder / f"{length_s:.0f}.wav", np.resize(samples, int(length_s * rate)), rate)


@contextmanager
def timed(into: list):
    """Adds the seconds that the block takes to `into`."""
    began = time.perf_counter()
    yield
    into.append(time.perf_counter() - began)


def headless(folder: Path) -> None:
    """Measures in this process: long speech, playback, growth of the file."""
    ob = long_head(folder)
    spent = []
    with timed(spent):
        assert bpy.ops.anyface.generate() == {"FINISHED"}
    line(f"{LONG_S:.0f} s of speech, new mesh", f"{spent[0]:.1f} s", ob.anyface.report)
    line(".blend larger by", f"{(saved(folder, 'keys') - saved_without(folder)) / 1e6:.1f} MB")
    line("a frame of basis keys", f"{playback_ms():.2f} ms")
    moves = []
    for place in (1.2, 0.8):
        with timed(moves):
            ob.anyface_output.articulation = place
    line("a move of a slider, the first and the next", *(f"{1000 * s:.0f} ms" for s in moves))
    line("a frame then", f"{playback_ms():.2f} ms")
    packed = sum(len(v) for v in ob.data.shape_keys.values() if isinstance(v, bytes))
    line("what sliders keep", f"{packed / 1e6:.2f} MB")
    ob.anyface.mode = "cache"
    with timed(spent):
        assert bpy.ops.anyface.generate() == {"FINISHED"}
    line("the same as a cache file, seen before", f"{spent[1]:.1f} s")
    line("a frame of a cache file", f"{playback_ms():.2f} ms")


def long_head(folder: Path):
    """A file with the head and the long voice."""
    empty()
    bpy.context.scene.render.fps = LONG_FPS
    bpy.ops.wm.ply_import(filepath=str(folder / "head.ply"))
    ob = bpy.context.object
    ob.anyface.source, ob.anyface.sound_file = "FILE", str(folder / f"{LONG_S:.0f}.wav")
    bpy.ops.wm.save_as_mainfile(filepath=str(folder / "without.blend"))
    return ob


def estimates(folder: Path) -> None:
    """For each output: the panel's estimate after a first run, beside the second run's time."""
    tried = [(mode, SHORT_S) for mode in ("basis", "frames", "cache", "keys", "arkit", "csv")]
    # Nobody wants one key per frame for 1,500 frames.
    tried += [(mode, LONG_S) for mode, _ in tried if mode != "frames"]
    for mode, length_s in tried:
        ob = long_head(folder)
        ob.anyface.sound_file = str(folder / f"{length_s:.0f}.wav")
        if mode == "keys":
            own_arkit_keys(ob)
        ob.anyface.mode = mode
        ob.anyface_output.csv_file = str(folder / f"{mode}_{length_s:.0f}.csv")
        assert bpy.ops.anyface.generate() == {"FINISHED"}
        promised = words(ob)
        began, busy = time.perf_counter(), time.process_time()
        assert bpy.ops.anyface.generate() == {"FINISHED"}
        took, busy = time.perf_counter() - began, time.process_time() - busy
        line(f"{mode}, {length_s:.0f} s", promised, f"took {took:.2f} s, processor {busy:.2f} s")


def sliders(folder: Path) -> None:
    """Prints how far the face that a slider makes is from that of a new run, in mm."""
    for head, rows in bench_sliders.measure(folder, empty).items():
        for case, (moved, mean, largest) in rows.items():
            line(f"{head}: {case}", f"{moved:.1f}", f"{mean:.3f}", f"{largest:.2f}")


def cycles(folder: Path) -> None:
    """Prints this process's memory after the first, fifth and last of many runs and removals.

    The first third fills Blender's and Python's own pools.
    """
    ob, memory = long_head(folder), []
    ob.anyface.sound_file = str(folder / f"{SHORT_S:.0f}.wav")
    for _ in range(CYCLES):
        assert bpy.ops.anyface.generate() == {"FINISHED"}
        assert bpy.ops.anyface.remove() == {"FINISHED"}
        memory.append(resident_mb())
    values = (memory[0], memory[CYCLES // 3], memory[-1])
    what = f"memory after 1, {CYCLES // 3 + 1} and {CYCLES} runs and removals"
    line(what, *(f"{value:.0f} MB" for value in values))


def resident_mb() -> float:
    """Memory of this process in MB."""
    with open("/proc/self/statm") as file:
        return int(file.read().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 1e6


def refusals(_folder: Path) -> None:
    """Measures meshes without a face."""
    for vertices, refused_s, cancelled_s in bench_search.measure(empty):
        times = f"{refused_s:.1f} s", f"cancelled {cancelled_s:.2f} s"
        line(f"no face on {vertices} vertices: refused, longest to cancel", *times)


def own_arkit_keys(ob) -> None:
    """Gives `ob` the ARKit shapes as if they were the artist's own keys."""
    ob.anyface.mode = "arkit"
    assert bpy.ops.anyface.generate() == {"FINISHED"}
    del ob.data.shape_keys["anyface"]
    ob.data.shape_keys.animation_data_clear()


def words(ob) -> str:
    """The estimate as the panel shows it."""
    module = importlib.import_module(f"{PACKAGE}.scene.outputs.estimate")
    output = importlib.import_module(f"{PACKAGE}.ui.output_properties").read(ob)
    seconds = importlib.import_module(f"{PACKAGE}.ui.audio").seconds(ob, bpy.context.scene)
    return module.describe(ob, bpy.context.scene, seconds, ob.anyface, output)


def saved(folder: Path, name: str) -> int:
    """Size in bytes of the file as it is now."""
    path = folder / f"{name}.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(path), copy=True)
    return path.stat().st_size


def saved_without(folder: Path) -> int:
    """Size in bytes of the file before anything was generated."""
    return (folder / "without.blend").stat().st_size


def playback_ms() -> float:
    """Milliseconds that Blender needs for a frame, the best of three rounds of 300."""
    rounds = []
    for _ in range(TIMES):
        with timed(rounds):
            for frame in range(1, 301):
                bpy.context.scene.frame_set(frame)
    return min(rounds) / 300 * 1000


def with_window(folder: Path) -> None:
    """Measures in a window that mouse and keys drive."""
    if "ANYFACE_BLENDER" not in os.environ:
        print("ANYFACE_BLENDER is not set: nothing was measured in a window", flush=True)
        return
    blender = Path(os.environ["ANYFACE_BLENDER"])
    install_in(blender, zip_path(), folder)
    screen = Screen(blender.with_name("enter"), blender, folder)
    try:
        line("Blender with a window", screen.ask("answer = bpy.app.version_string"))
        voice = str(folder / f"{SHORT_S:.0f}.wav")
        screen.ask(SCENE.format(mesh=str(folder / "head.ply"), voice=voice))
        screen.hand("mousemove", 400, 400, "click", "1", "key", "Escape")
        screen.ask("area_of('VIEW_3D')[3].active_panel_category = 'Anyface'")
        screen.ask(TIMED)
        presses(screen)
        redraws(screen)
        escapes(screen, folder)
    finally:
        screen.close()


def presses(screen: Screen) -> None:
    """Measures from the press of *Generate* to the result: first a new mesh, then a known one."""
    waited = []
    for _ in range(1 + TIMES):
        screen.hand("mousemove", *screen.find("anyface.generate"), "sleep", "0.3")
        with timed(waited):
            screen.hand("click", "1")
            screen.wait("keys() and not running()")
        report = screen.ask("answer = bpy.data.objects['Head'].anyface.report")
        screen.press("anyface.remove")
        screen.wait("not keys()")
    line("what was made", report)
    line("press to result, new mesh, weights not yet loaded", f"{waited[0]:.2f} s")
    line("press to result, seen before", seconds(waited[1:]))
    spent = screen.ask("answer = bpy.app.driver_namespace['spent']")
    line("of it the interface's thread: reading", seconds(spent["read"]))
    line("of it the interface's thread: writing", seconds(spent["write"]))


def redraws(screen: Screen) -> None:
    """Measures the longest time that Blender does not respond while it draws the view once."""
    longest_s = []
    for _ in range(TIMES):
        screen.ask("stillness['longest_s'] = 0.0; area_of('VIEW_3D')[1].tag_redraw()")
        time.sleep(1.0)
        longest_s.append(screen.ask("answer = stillness['longest_s']"))
    line("a redraw of the view by Blender itself", seconds(longest_s))


def escapes(screen: Screen, folder: Path) -> None:
    """Measures from Esc to the end of the job, at several stages of a long sound."""
    sound = str(folder / f"{ENDLESS_S:.0f}.wav")
    screen.ask(f"bpy.data.objects['Head'].anyface.sound_file = {sound!r}")
    module = "importlib.import_module('bl_ext.user_default.anyface.ui.running')"
    waited, stages = [], []
    for after_s in ESC_AFTER_S:
        screen.press("anyface.generate")
        screen.wait("running()")
        time.sleep(after_s)
        screen.hand("mousemove", 400, 400)
        stages += screen.ask(f"import importlib; answer = [{module}.current.progress.at[0]]")
        with timed(waited):
            screen.hand("key", "Escape")
            screen.wait("not running()")
    line(f"Esc to the end of the job ({', '.join(stages)})", seconds(waited))


if __name__ == "__main__":
    main()
