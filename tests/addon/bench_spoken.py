"""Times how long Blender's window freezes while a spoken take of the default head is written.

`ANYFACE_BLENDER=… python tests/addon/bench_spoken.py VOICE.wav` uses the settings as a new user
finds them: keys with names and few keyframes each. It measures the processor time of the
interface's thread, as bench_landing.py does.
"""

# Import this first: it sets Blender's resource folder, which Blender reads only once.
from conftest import ROOT, zip_path  # isort: skip

import os
import shutil
import sys
import tempfile
import time
from itertools import pairwise
from pathlib import Path

from bench_landing import PRESS
from screen import Screen, install_in

TAKES = 4
HEAD = ROOT / "weights" / "shared" / "default_head" / "head.obj"
PREPARE = """
import importlib, sys
sys.path.insert(0, {folder!r})
import bench_take
for ob in list(bpy.data.objects):
    bpy.data.objects.remove(ob)
bpy.context.scene.render.fps = bench_take.FPS
bpy.ops.wm.obj_import(filepath={head!r}, use_split_objects=False, use_split_groups=False)
head = bpy.context.object
head.anyface.source, head.anyface.sound_file = 'FILE', {voice!r}
head.display_type = 'BOUNDS'
addon = lambda name: importlib.import_module('bl_ext.user_default.anyface.' + name)
spent = bpy.app.driver_namespace['spent'] = []
looks = bpy.app.driver_namespace['looks'] = bench_take.pulse()
bench_take.time_slices(addon, spent, looks)
"""


def main(voice: str) -> None:
    """Prints a row for each take."""
    blender = Path(os.environ["ANYFACE_BLENDER"])
    folder = Path(tempfile.mkdtemp(prefix="anyface-spoken-"))
    here = Path(__file__).parent
    for path in (here / "bench_take.py", here / "figures.py", HEAD, HEAD.with_suffix(".mtl")):
        shutil.copy(path, folder)
    sound = shutil.copy(voice, folder)
    install_in(blender, zip_path(), folder)
    screen = Screen(blender.with_name("enter"), blender, folder)
    try:
        names = {"folder": str(folder), "head": str(folder / HEAD.name), "voice": str(sound)}
        screen.ask(PREPARE.format(**names))
        for number in range(TAKES):
            time.sleep(1.5)
            screen.ask("bpy.app.driver_namespace['spent'].clear()")
            screen.ask(PRESS)
            screen.wait("not running()")
            time.sleep(1.5)
            slices = screen.ask("answer = bpy.app.driver_namespace['spent']")
            looks = screen.ask("answer = bpy.app.driver_namespace['looks']")
            report = screen.ask("answer = bpy.context.object.anyface.report")
            block = max(after - before for before, after in pairwise(looks))
            print(
                f"| take {number + 1}: {report} | {len(slices)} slices, longest "
                f"{1000 * max(slices):.0f} ms | longest block {1000 * block:.0f} ms |",
                flush=True,
            )
    finally:
        screen.close()
        shutil.rmtree(folder, ignore_errors=True)


if __name__ == "__main__":
    main(sys.argv[1])
    sys.stdout.flush()
    os._exit(0)
