"""Times how long Blender freezes while it writes a ten-minute take; a row for each of three takes.

`python tests/addon/bench_landing.py` measures the steps in Blender's Python module. If
`ANYFACE_BLENDER` names an executable beside `enter`, a timer in its window measures too: the
processor time of the interface's thread from one look to the next. That includes evaluation and
undo, but as little drawing as possible, because there is no graphics card. The take is synthetic:
56 keys on 26,569 vertices with teeth, at 24 frames a second.
"""

# Import this first: it sets Blender's resource folder, which Blender reads only once.
from conftest import PACKAGE, zip_path  # isort: skip

import importlib
import os
import shutil
import sys
import tempfile
import time
from itertools import pairwise
from pathlib import Path

import bpy

TAKES = 3
# The window runs this first. It makes the same head and the same take.
PREPARE = """
import importlib, sys
sys.path.insert(0, {folder!r})
import bench_take
addon = lambda name: importlib.import_module('bl_ext.user_default.anyface.' + name)
head, take = bench_take.prepare(addon, {folder!r})
for ob in bpy.data.objects:
    ob.display_type = 'BOUNDS'
spent = bpy.app.driver_namespace['spent'] = []
looks = bpy.app.driver_namespace['looks'] = bench_take.pulse()
bench_take.watch(addon, take, spent, looks)
"""
PRESS = """
window, area, region, _ = area_of('VIEW_3D')
with bpy.context.temp_override(window=window, area=area, region=region):
    bpy.ops.anyface.generate('INVOKE_DEFAULT')
"""


def main() -> None:
    """Prints a row for each take."""
    install()
    folder = Path(tempfile.mkdtemp(prefix="anyface-landing-"))
    try:
        in_module(folder)
        blender = os.environ.get("ANYFACE_BLENDER")
        if blender:
            in_window(Path(blender), folder)
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def install() -> None:
    """Installs the extension and opens an empty file."""
    bpy.ops.extensions.package_install_files(
        filepath=str(zip_path()), repo="user_default", enable_on_install=True
    )
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)


def in_module(folder: Path) -> None:
    """Times each step by the clock, without a window."""
    import bench_take

    def addon(name):
        return importlib.import_module(f"{PACKAGE}.{name}")

    head, take = bench_take.prepare(addon, str(folder))
    for number in range(TAKES):
        landing, steps = bench_take.landing(addon, head, take), []
        while True:
            began = time.perf_counter()
            ended = next(landing, landing) is landing  # a generator never yields itself
            steps.append(time.perf_counter() - began)
            if ended:
                break
        row(f"take {number + 1} in Python's module", steps)


def row(what: str, steps: list[float]) -> None:
    """Prints a table row: the number of steps, the last one, the longest before it, their sum."""
    longest = 1000 * max(steps[:-1])
    print(
        f"| {what} | {len(steps)} steps | last {1000 * steps[-1]:.0f} ms | others {longest:.0f} ms "
        f"| {sum(steps):.2f} s |",
        flush=True,
    )


def in_window(blender: Path, folder: Path) -> None:
    """Measures with a timer in the window, from the press until everything is drawn."""
    from screen import Screen, install_in

    for name in ("bench_take.py", "figures.py"):
        shutil.copy(Path(__file__).with_name(name), folder / name)
    install_in(blender, zip_path(), folder)
    screen = Screen(blender.with_name("enter"), blender, folder)
    try:
        screen.ask(PREPARE.format(folder=str(folder)))
        for number in range(TAKES):
            time.sleep(1.5)
            screen.ask("bpy.app.driver_namespace['spent'].clear()")
            screen.ask(PRESS)
            screen.wait("not running()")
            time.sleep(1.5)
            steps = screen.ask("answer = bpy.app.driver_namespace['spent']")
            looks = screen.ask("answer = bpy.app.driver_namespace['looks']")
            block = max(after - before for before, after in pairwise(looks))
            row(f"take {number + 1} in a window, longest block {1000 * block:.0f} ms", steps)
    finally:
        screen.close()


if __name__ == "__main__":
    main()
    sys.stdout.flush()
    os._exit(0)
