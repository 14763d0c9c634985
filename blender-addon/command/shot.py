"""Does the shots of a batch, one after another, in a process that only its parent watches.

Each line of standard input is a shot (`farm.jobs.Shot` as JSON); the line `farm.attempt.END` says
that it has ended. Blender, the models and what is known of faces stay loaded for the next shot. If
the input ends during a shot, this process exits at once: another process does that shot.
"""

import json
import os
import queue
import sys
import threading
from contextlib import suppress

from ..core import beside, memory
from ..core import options as words
from ..core.errors import AnyfaceError
from ..farm import ledger
from ..farm.attempt import END
from . import disk
from .run import TASKS, measured, tell

_ORPHANED = 70


def main() -> int:
    """Does shots and writes their reports until the input ends; returns the last exit code."""
    lines, code = _Lines(), 0
    while (line := lines.next()) is not None:
        shot = json.loads(line)
        with ledger.claim(shot):
            outcome = ledger.finished(shot)
            if outcome is None:
                ledger.clear(shot)
                outcome = measured(lambda shot=shot: _do(shot))
                ledger.close(shot, {**outcome, "memory_mb": memory.peak_mb()})
        tell(outcome)
        code = outcome["exit_code"]
        # Not through `say`, which writes the mark's first letter as an escape: so no name that is
        # printed can stand for the mark.
        with suppress(OSError, ValueError):
            print(END, flush=True)
    return code


class _Lines:
    """The lines of standard input. A thread reads them, so that it notices when the input ends."""

    def __init__(self):
        self._lines = queue.SimpleQueue()
        # The number of lines that were read, and the number of lines whose shot has ended.
        self._read_count, self._ended_count = 0, -1
        threading.Thread(target=self._read, name="anyface-parent", daemon=True).start()

    def next(self) -> bytes | None:
        """Waits for the next line; None at the end. Call it once the previous shot has ended."""
        self._ended_count += 1
        return self._lines.get()

    def _read(self) -> None:
        # Not through sys.stdin's buffer: a thread that holds its lock breaks Python's shutdown.
        rest = b""
        while part := os.read(sys.stdin.fileno(), 1 << 16):
            *lines, rest = (rest + part).split(b"\n")
            for line in lines:
                self._read_count += 1
                self._lines.put(line)
        if self._read_count > self._ended_count:
            os._exit(_ORPHANED)
        self._lines.put(None)


def _do(shot: dict) -> dict:
    beside.remove_all(shot["save"])
    disk.open_file(shot["file"])
    faces = [_step(step) for step in shot["steps"]]
    message = "; ".join(face["message"] for face in faces)
    disk.make_folder(os.path.dirname(shot["save"]))
    return {"message": message, "file": disk.save(shot["save"]), "faces": faces}


def _step(step: list[str]) -> dict:
    task, *line = step
    options = words.step_parser(task).parse_args(line)
    try:
        return {"object": options.object, **TASKS[task](options)}
    except AnyfaceError as error:
        raise AnyfaceError(error.kind, f"{options.object}: {error}") from error
