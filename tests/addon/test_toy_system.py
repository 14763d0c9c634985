"""The extension finds a system that it does not know through the library's registry alone.

The Rust tests build that library (tests/systems/main.rs). Without it the test is skipped.
"""

import math
import os
import struct
import subprocess
import sys
import wave
from pathlib import Path

import pytest

from conftest import ROOT, zip_path

_TARGET = Path(os.environ.get("CARGO_TARGET_DIR", ROOT / "target"))
_LIBRARY = _TARGET / "debug" / "libanyface_toy.so"
_HEAD = ROOT / "weights/shared/default_head"
# The steps of an artist, in a separate process: a process loads the library only once.
_SCRIPT = """
import importlib, sys
import bpy, numpy as np
extension, head, voice, out = sys.argv[1:]
bpy.ops.extensions.package_install_files(
    filepath=extension, repo="user_default", enable_on_install=True)
bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
bpy.ops.wm.obj_import(filepath=head, use_split_objects=False, use_split_groups=False)
ob = bpy.context.object
ob.name = "Head"
command = importlib.import_module("bl_ext.user_default.anyface.command")
code = command.main(["bake", "--object", "Head", "--audio", voice, "--system", "toy", "--drop",
    "20", "--mode", "frames", "--save", out])
assert code == 0, code
keys = ob.data.shape_keys.key_blocks
rest, moved = (np.empty(3 * len(ob.data.vertices), np.float32) for _ in range(2))
keys[0].points.foreach_get("co", rest)
most = 0.0
for key in keys[1:]:
    key.points.foreach_get("co", moved)
    most = max(most, float(np.linalg.norm((moved - rest).reshape(-1, 3), axis=1).max()))
print("LARGEST", len(keys), most)
"""


@pytest.mark.skipif(os.name == "nt", reason="ignored, the library with a toy is built for Linux")
@pytest.mark.skipif(not _LIBRARY.is_file(), reason="the Rust tests built no library with a toy")
def test_a_system_of_the_registry_alone_moves_a_head(tmp_path):
    with wave.open(str(tmp_path / "voice.wav"), "wb") as voice:
        voice.setnchannels(1)
        voice.setsampwidth(2)
        voice.setframerate(16000)
        loudness = (math.sin(i / 1500.0) ** 4 * math.sin(0.08 * i) for i in range(24000))
        voice.writeframes(b"".join(struct.pack("<h", int(20000 * x)) for x in loudness))
    done = subprocess.run(
        [sys.executable, "-c", _SCRIPT, str(zip_path()), str(_HEAD / "head.obj"),
         str(tmp_path / "voice.wav"), str(tmp_path / "o.blend")],
        env={**os.environ, "ANYFACE_LIBRARY": str(_LIBRARY),
             "BLENDER_USER_RESOURCES": str(tmp_path / "user")},
        capture_output=True,
        text=True,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr
    _, keys, largest = next(s for s in done.stdout.splitlines() if s.startswith("LARGEST")).split()
    # The chin drops by up to 20 mm, and the head is in metres.
    assert int(keys) > 30 and 0.01 < float(largest) < 0.03, done.stdout
