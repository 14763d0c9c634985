"""One shot of a batch, in a process that nobody watches but its parent.

The first line of standard input is the shot (`farm.jobs.Shot` as JSON). The input stays open as
long as the parent lives; where it ends this process ends at once: the shot is done elsewhere.
"""

import json
import os
import sys
import threading

from ..core import beside
from ..core import options as words
from ..core.errors import AnyfaceError
from ..farm import ledger
from . import disk
from .run import TASKS, measured, tell

_ORPHANED = 70


def main() -> int:
    """Does the shot and writes its report; returns the exit code."""
    shot = json.loads(sys.stdin.buffer.readline())
    threading.Thread(target=_watch, name="anyface-parent", daemon=True).start()
    outcome = measured(lambda: _do(shot))
    ledger.close(shot, outcome)
    tell(outcome)
    return outcome["exit_code"]


def _watch() -> None:
    # Not through the buffer: a thread that holds its lock would break Python's own ending.
    while os.read(sys.stdin.fileno(), 1024):
        pass
    os._exit(_ORPHANED)


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
