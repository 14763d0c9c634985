"""The shots of a batch, one after another, in a process that nobody watches but its parent.

Each line of standard input is a shot (`farm.jobs.Shot` as JSON); the line `farm.attempt.END` says
that it has ended. Blender, the models and what is known of faces stay for the next one. Where the
input ends while a shot is at work this process ends at once: the shot is done elsewhere.
"""

import json
import os
import queue
import sys
import threading

from ..core import beside, memory
from ..core import options as words
from ..core.errors import AnyfaceError, say
from ..farm import ledger
from ..farm.attempt import END
from . import disk
from .run import TASKS, measured, tell

_ORPHANED = 70


def main() -> int:
    """Does shots and writes their reports until no more come; returns the exit code of the last."""
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
        say(END, sys.stdout)
    return code


class _Lines:
    """The lines of standard input, which a thread reads: it also sees where the input ends."""

    def __init__(self):
        self._lines = queue.SimpleQueue()
        # Lines that were read, and lines whose work is done.
        self._read_count, self._ended_count = 0, -1
        threading.Thread(target=self._read, name="anyface-parent", daemon=True).start()

    def next(self) -> bytes | None:
        """The next line, once the work of the one before is done; None where there is none."""
        self._ended_count += 1
        return self._lines.get()

    def _read(self) -> None:
        # Not through the buffer: a thread that holds its lock would break Python's own ending.
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
