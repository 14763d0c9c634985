"""The picture of emotions in docs/command-line.md: a head says the same with five of them.

    target/venvs/bpy/bin/python packaging/demo/emotions.py --extension target/anyface-….zip \
        --audio demo-output/voice.wav --out docs/images/emotions.jpg
"""

import argparse
import subprocess
import tempfile
from pathlib import Path

import make_demo

# Which says where Blender keeps its settings before it loads it.
from make_demo import bpy

EMOTIONS = ("neutral", "happy", "sad", "angry", "surprised")
# Frames at 25 fps, of the demo's sentence: "name", "make".
FRAMES = (30, 80)
SIZE = (400, 480)


def main() -> None:
    """One column an emotion, one row a frame."""
    parser = argparse.ArgumentParser(description=__doc__)
    for name in ("--extension", "--audio", "--out"):
        parser.add_argument(name, required=True, type=Path)
    options = parser.parse_args()
    make_demo.install(options.extension.resolve())
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    scene = bpy.context.scene
    make_demo.stage(scene, 25)
    make_demo.sound(scene, options.audio.resolve())
    scene.render.resolution_x, scene.render.resolution_y = SIZE
    scene.cycles.samples = 16
    head = make_demo.character("WOMAN", (0.0, 0.0, 0.0))
    scene.camera.location, scene.camera.data.lens = (0.0, -19.0, 0.25), 205
    with tempfile.TemporaryDirectory() as folder:
        for number, emotion in enumerate(EMOTIONS):
            make_demo.animate(head, argparse.Namespace(emotion=emotion, intensity=1.0))
            for row, frame in enumerate(FRAMES):
                scene.frame_set(frame)
                place = row * len(EMOTIONS) + number
                scene.render.filepath = str(Path(folder) / f"{place:02d}.png")
                bpy.ops.render.render(write_still=True)
        tile(Path(folder), options.out)


def tile(folder: Path, out: Path) -> None:
    """All pictures of a folder as one."""
    command = ["ffmpeg", "-y", "-loglevel", "error", "-i", str(folder / "%02d.png")]
    grid = f"scale=300:-1,tile={len(EMOTIONS)}x{len(FRAMES)}"
    subprocess.run([*command, "-vf", grid, "-frames:v", "1", "-q:v", "3", str(out)], check=True)


if __name__ == "__main__":
    main()
