"""Renders a .blend: `render.py FILE.blend FOLDER STILL.png` writes FOLDER/####.png and one good still.

Run by `cargo xtask demo` in Blender's Python module. The file itself holds the shapes and their
keys, so the extension is not needed.
"""

import sys
import time
from pathlib import Path

import bpy

STILL_AT, STILL_SAMPLES = 0.5, 10
"""Where in the film the still is taken, from 0 to 1, and how many samples it gets."""


def main() -> None:
    """Renders all frames and the still, and prints the time left after each frame."""
    blend, folder, still = sys.argv[1], Path(sys.argv[2]), sys.argv[3]
    bpy.ops.wm.open_mainfile(filepath=blend)
    scene = bpy.context.scene
    folder.mkdir(parents=True, exist_ok=True)
    for old in folder.glob("*.png"):
        old.unlink()
    total = scene.frame_end - scene.frame_start + 1
    began = time.monotonic()
    for done, frame in enumerate(range(scene.frame_start, scene.frame_end + 1), start=1):
        scene.frame_set(frame)
        scene.render.filepath = str(folder / f"{done:04d}.png")
        bpy.ops.render.render(write_still=True)
        left_s = (time.monotonic() - began) / done * (total - done)
        print(f"rendered {done} of {total} frames, {left_s / 60:.1f} min left", flush=True)
    render_still(scene, scene.frame_start + round(STILL_AT * (total - 1)), still)


def render_still(scene, frame: int, path: str) -> None:
    """Renders one frame with more samples."""
    scene.frame_set(frame)
    scene.cycles.samples = STILL_SAMPLES
    scene.render.filepath = path
    bpy.ops.render.render(write_still=True)


if __name__ == "__main__":
    main()
