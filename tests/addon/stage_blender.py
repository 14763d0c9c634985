"""Stands in for `blender -b --command anyface shot`: the real bpy and extension, a stage for the
library. Each face that is begun leaves a file in `ANYFACE_TEST_MARKS`, takes `ANYFACE_TEST_S`
seconds, and ends in a crash where the file `crash` lies there (once).
"""

import importlib
import os
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
    """Tells that it has begun, and takes its time."""

    def animate(self, *arguments):
        """As `Stage.animate`."""
        (MARKS / f"begun-{os.getppid()}-{os.getpid()}-{uuid.uuid4().hex[:6]}").touch()
        if (MARKS / "crash").exists():
            (MARKS / "crash").unlink()
            os.abort()
        time.sleep(float(os.environ.get("ANYFACE_TEST_S", "0")))
        return super().animate(*arguments)


name = anyface_batch.load_extension().__name__


def addon(part):
    """A module of the extension."""
    return importlib.import_module(f"{name}.{part}")


stand_in(addon, SlowStage(addon("core.take")))
assert sys.argv[1:] == ["-b", "--command", "anyface", "shot"], sys.argv
code = importlib.import_module(f"{name}.command").main(["shot"])
sys.stdout.flush()
os._exit(code)
