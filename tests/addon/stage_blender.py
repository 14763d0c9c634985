"""Stands in for `blender -b --command anyface shot`, with a stage instead of the library.

bpy and the extension are real, and the library decodes the sounds. Each face leaves a file in
`ANYFACE_TEST_MARKS` when it begins, and takes `ANYFACE_TEST_S` seconds. If a file `crash` lies in
that folder, the face removes it and crashes. A request with the seed `ANYFACE_TEST_KILL` kills the
process.
"""

import importlib
import os
import signal
import sys
import time
import uuid
from pathlib import Path

FOLDER = Path(os.environ["ANYFACE_TEST_EXTENSION"])
MARKS = Path(os.environ["ANYFACE_TEST_MARKS"])
sys.path[:0] = [str(FOLDER), str(Path(__file__).resolve().parent)]

import anyface_batch  # noqa: E402

from figures import Stage, stand_in  # noqa: E402


class SlowStage(Stage):
    """Marks that a face has begun, and takes its time."""

    def animate(self, *arguments):
        """As `Stage.animate`."""
        (MARKS / f"begun-{os.getppid()}-{os.getpid()}-{uuid.uuid4().hex[:6]}").touch()
        if (MARKS / "crash").exists():
            (MARKS / "crash").unlink()
            os.abort()
        if str(arguments[5].fields["seed"]) == os.environ.get("ANYFACE_TEST_KILL"):
            os.kill(os.getpid(), signal.SIGKILL)
        time.sleep(float(os.environ.get("ANYFACE_TEST_S", "0")))
        return super().animate(*arguments)

    def decode(self, path):
        """Decodes as an engine does, but without loading models."""
        native = addon("core.native")
        reader = native.Engine.__new__(native.Engine)
        reader._library = addon("core.library").load(addon("core.library").library_path())
        return reader.decode(path)


name = anyface_batch.load_extension().__name__


def addon(part):
    """A module of the extension."""
    return importlib.import_module(f"{name}.{part}")


stand_in(addon, SlowStage(addon("core.take")))
assert sys.argv[1:] == ["-b", "--command", "anyface", "shot"], sys.argv
code = importlib.import_module(f"{name}.command").main(["shot"])
sys.stdout.flush()
os._exit(code)
