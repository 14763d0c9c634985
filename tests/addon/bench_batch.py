"""Times a batch with one shot per process, and a batch with many shots per process.

    ANYFACE_EXTENSION=the.zip python tests/addon/bench_batch.py --sound speech.wav --shots 300

Each shot puts that speech on the sample head and saves its own .blend. Prints shots per minute.
"""

import argparse
import importlib
import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
import zipfile
from pathlib import Path

import bpy


def main() -> None:
    """Writes the shots, then runs the batch once for each size of chunk."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--shots", type=int, default=300)
    parser.add_argument("--chunks", default="1,20")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--blender", default="")
    parser.add_argument("--sound", required=True, type=Path, help="speech of 4 s or more, as WAV")
    options = parser.parse_args()
    folder = Path(tempfile.mkdtemp(prefix="anyface-batch-"))
    extension = folder / "extension"
    zipfile.ZipFile(os.environ["ANYFACE_EXTENSION"]).extractall(extension)
    shutil.copy(options.sound, folder / "voice.wav")
    write_shot(extension, folder / "shot.blend")
    shots = [{"save": f"out/sh{n:04d}.blend", "seed": n} for n in range(options.shots)]
    shared = {"file": "shot.blend", "object": "Head", "audio": "voice.wav"}
    (folder / "jobs.json").write_text(json.dumps({"defaults": shared, "shots": shots}))
    for chunk in map(int, options.chunks.split(",")):
        words = [sys.executable, extension / "anyface_batch.py", "batch", folder / "jobs.json"]
        words += ["--workers", options.workers, "--chunk", chunk, "--again"]
        words += ["--blender", options.blender] if options.blender else []
        began = time.monotonic()
        subprocess.run([str(word) for word in words], check=True, stdout=subprocess.DEVNULL)
        took = time.monotonic() - began
        print(f"chunks of {chunk}: {took:.1f} s, {60.0 * options.shots / took:.1f} shots a minute")
    shutil.rmtree(folder)


def write_shot(extension: Path, path: Path) -> None:
    """Writes a .blend with the sample head."""
    sys.path.insert(0, str(extension))
    package = importlib.import_module("anyface_batch").load_extension().__name__
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    mesh = importlib.import_module(f"{package}.scene.face.sample_head").mesh(1.0)
    bpy.context.scene.collection.objects.link(bpy.data.objects.new("Head", mesh))
    bpy.ops.wm.save_as_mainfile(filepath=str(path))


if __name__ == "__main__":
    main()
    sys.stdout.flush()
    # bpy 4.5 hangs if Python ends while an add-on's properties are registered.
    os._exit(0)
