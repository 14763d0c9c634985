"""One task on one file: open, do, save, report."""

import argparse
import sys
import time
from collections.abc import Callable

from ..core import json_file
from ..core.errors import AnyfaceError, plain, readable, say
from . import bake, disk, landmarks, rig

# The function of each task: it changes the open file and returns the fields of the report.
TASKS: dict[str, Callable[[argparse.Namespace], dict]] = {
    "bake": bake.run,
    "rig": rig.run,
    "landmarks": landmarks.run,
}


def main(options: argparse.Namespace) -> int:
    """Does one task with parsed options; prints one line, writes the report."""
    outcome = measured(lambda: _do(options))
    outcome["object"] = options.object
    tell(outcome)
    if not options.report:
        return outcome["exit_code"]
    try:
        json_file.write(options.report, outcome)
    except AnyfaceError as error:
        say(f"anyface: {error}", sys.stderr)
        return outcome["exit_code"] or error.exit_code
    return outcome["exit_code"]


def _do(options) -> dict:
    if options.file:
        disk.open_file(options.file)
    done = TASKS[options.task](options)
    if options.save:
        done["file"] = disk.save(options.save)
    return done


def measured(work: Callable[[], dict]) -> dict:
    """The result of `work`, or the reason for any failure, with exit code and seconds."""
    began = time.monotonic()
    try:
        outcome = {"ok": True, **work(), "exit_code": 0}
    except BaseException as raised:
        error = plain(raised)
        outcome = {
            "ok": False,
            "kind": error.kind,
            "message": readable(error),
            "exit_code": error.exit_code,
        }
    outcome["seconds"] = round(time.monotonic() - began, 3)
    return outcome


def tell(outcome: dict) -> None:
    """Prints the outcome as one line, a failure on standard error."""
    stream = sys.stdout if outcome["ok"] else sys.stderr
    say(f"anyface: {outcome['message']}", stream)
