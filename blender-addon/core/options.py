"""Tasks and options of Blender's `--command anyface`, of `python -m anyface_batch` and of the rows
of a jobs file.
"""

import argparse
import math
from typing import Any

from . import systems


def parser(program: str, modes: str = "") -> argparse.ArgumentParser:
    """The parser of all tasks; `modes` is the help text of `--mode`.

    A wrong command line raises `SystemExit` with code 2.
    """
    top = argparse.ArgumentParser(prog=program, description="Makes faces talk.")
    tasks = top.add_subparsers(dest="task", required=True)
    for name, (text, add, saves) in _TASKS.items():
        task = tasks.add_parser(name, help=text)
        task.add_argument("--file", metavar="FILE", help="open this .blend before the task")
        add(task, modes)
        task.add_argument("--save", required=saves, metavar="FILE", help="the .blend to write")
        task.add_argument("--report", metavar="FILE", help="write a report as JSON")
        task.add_argument("--quiet", action="store_true", help="print no progress")
    batch = tasks.add_parser(
        "batch", help="animate many shots, in processes here or on other machines"
    )
    add_batch(batch)
    tasks.add_parser("shot", help="animate one shot of a batch, read from standard input")
    return top


def real(text: str) -> float:
    """A finite number; raises `argparse.ArgumentTypeError`."""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise argparse.ArgumentTypeError(f"expected a finite number, got {text[:40]!r}")
    return value


def rows(text: str) -> range:
    """Rows `A-B` or a single row, counted from 1; raises `argparse.ArgumentTypeError`."""
    first, dash, last = text.partition("-")
    try:
        numbers = range(int(first), int(last if dash else first) + 1)
    except ValueError:
        numbers = range(0)
    if not numbers or numbers.start < 1:
        raise argparse.ArgumentTypeError(f"expected rows such as 1-20, got {text[:40]!r}")
    return numbers


def step_parser(task: str) -> argparse.ArgumentParser:
    """The parser of one task in a row of a jobs file, without the file to open or save.

    A wrong option raises `argparse.ArgumentError`.
    """
    step = _Step(prog=task, exit_on_error=False, add_help=False)
    _TASKS[task][1](step, "")
    step.set_defaults(task=task)
    return step


class _Step(argparse.ArgumentParser):
    """A parser that raises errors and never ends the process."""

    def error(self, message):
        """Raises `argparse.ArgumentError` with the message."""
        raise argparse.ArgumentError(None, message)


def _add_bake(task: argparse.ArgumentParser, modes: str) -> None:
    """Options that are left out take the values stored on the object."""
    _add_object(task)
    source = task.add_mutually_exclusive_group()
    source.add_argument("--strip", help="name of a sound strip")
    source.add_argument("--audio", metavar="FILE", help="a sound file")
    task.add_argument("--start", type=int, metavar="FRAME", help="first frame of --audio")
    task.add_argument("--scene", help="name of the scene (default: the active one)")
    task.add_argument(
        "--emotion", metavar="NAME:X[,…]", help="for example happy:0.7; or auto, auto-arousal, off"
    )
    task.add_argument("--mode", help=modes)
    task.add_argument("--error", type=real, metavar="MM", help="largest error of basis keys")
    task.add_argument("--fps", type=real, help="default: the scene's")
    task.add_argument(
        "--emotion-of", metavar="FILE", help="another recording whose emotion the face shows"
    )
    text = task.add_mutually_exclusive_group()
    text.add_argument("--text", metavar="WORDS", help="the words that are spoken")
    text.add_argument("--text-file", metavar="FILE", help="a file with these words, UTF-8")
    task.add_argument(
        "--events", metavar="FILE", help="JSON file of events, used instead of strips and markers"
    )
    task.add_argument("--axes", choices=("AUTO", "WORLD", "LOCAL", "LOCAL_Y_UP"))
    task.add_argument("--landmarks", metavar="FILE", help="JSON file with the 68 landmarks")
    _add_fields(task)
    _add_controls(task)


def files_read() -> tuple[str, ...]:
    """The options of `bake` that name files to read."""
    others = (field.flag for field in systems.plain_fields(*systems.PATHS))
    return ("audio", "events", "emotion-of", "text-file", "landmarks", *others)


def _add_fields(task: argparse.ArgumentParser) -> None:
    """Adds an option for each field that has no option of its own."""
    for field in systems.plain_fields():
        kind: dict[str, Any] = {"metavar": "FILE"} if field.kind in systems.PATHS else {}
        if field.kind == systems.NUMBER:
            kind = {"type": int if field.is_whole else real}
        help = field.help.replace("%", "%%")
        task.add_argument(f"--{field.flag}", dest=field.name, help=help, **kind)


def _add_controls(task: argparse.ArgumentParser) -> None:
    """Adds the choice of system and an option for each control that the library lists."""
    task.add_argument("--system", choices=[system.name for system in systems.known()] or None)
    kinds: dict[str, dict[str, Any]] = {systems.REAL: {"type": real}, systems.WHOLE: {"type": int}}
    for control in systems.controls():
        kind = kinds.get(control.values, {"choices": control.choices})
        help = control.help.replace("%", "%%")
        task.add_argument(f"--{control.flag}", dest=control.name, help=help, **kind)


def _add_rig(task: argparse.ArgumentParser, _modes: str) -> None:
    """Options of the shapes."""
    _add_face(task)
    task.add_argument("--visemes", action="store_true", help="make the 15 Oculus visemes as well")
    task.add_argument(
        "--by",
        choices=("network", "field"),
        default="network",
        help="what moves the skin; field: the field of the FaceTalk head most like the face",
    )
    task.add_argument(
        "--in-betweens",
        action="store_true",
        help="with --by field: add NAME_half, the shape at weight 0.5",
    )


def _add_landmarks(task: argparse.ArgumentParser, _modes: str) -> None:
    """Options of the search; the landmarks are stored on the object."""
    _add_face(task)
    task.add_argument("--out", metavar="FILE", help="write the landmarks as JSON")


def _add_face(task: argparse.ArgumentParser) -> None:
    _add_object(task)
    task.add_argument("--axes", choices=("AUTO", "WORLD", "LOCAL", "LOCAL_Y_UP"))


def _add_object(task: argparse.ArgumentParser) -> None:
    task.add_argument("--object", required=True, help="name of the face's object")
    task.add_argument(
        "--weights",
        metavar="FOLDER",
        help="your own models; default: those of the scene or the preferences",
    )


def add_batch(task: argparse.ArgumentParser) -> None:
    """Options of many shots at once."""
    task.add_argument("jobs", help="the JSON file that lists the shots")
    task.add_argument(
        "--rows", type=rows, metavar="A-B", help="only these rows of the file, counted from 1"
    )
    task.add_argument("--workers", type=int, default=1, help="processes on this machine")
    task.add_argument(
        "--chunk",
        type=int,
        default=20,
        metavar="N",
        help="shots that one Blender animates before it restarts",
    )
    task.add_argument(
        "--scheduler", metavar="tcp://…", help="a Dask scheduler, whose workers animate the shots"
    )
    task.add_argument(
        "--connect", type=real, default=30.0, metavar="S", help="seconds to wait for the scheduler"
    )
    task.add_argument("--reports", metavar="FOLDER", help="default: beside the jobs file")
    task.add_argument("--blender", metavar="FILE", help="the Blender that animates the shots")
    task.add_argument(
        "--retries", type=int, default=1, help="how often a shot is tried again after a crash"
    )
    task.add_argument("--timeout", type=real, metavar="S", help="most seconds for one shot")
    task.add_argument("--again", action="store_true", help="animate finished shots again")
    task.add_argument(
        "--map",
        action="append",
        default=[],
        metavar="FROM=TO",
        help="a folder that has another path on this machine; may be repeated",
    )
    task.add_argument("--dry-run", action="store_true", help="print what is left and do nothing")
    task.add_argument(
        "--sum", action="store_true", help="only write the summary page of all reports"
    )
    _add_export(task)


def _add_export(task: argparse.ArgumentParser) -> None:
    """Options of a batch that a farm's engine runs, with `--chunk` rows in each task."""
    export = task.add_argument_group(
        "export", "write a job for a render farm instead of running the batch"
    )
    export.add_argument("--export", choices=("flamenco", "openjd", "slurm", "opencue"))
    export.add_argument(
        "--out", metavar="FOLDER", help="folder of the job; default: beside the jobs file"
    )
    export.add_argument(
        "--memory",
        type=real,
        metavar="GB",
        help="memory of a task; default: estimated from earlier reports",
    )
    export.add_argument("--cores", type=int, metavar="N", help="cores of a task")


# Tasks on one open file: help, the function that adds options, whether --save is required.
_TASKS = {
    "bake": ("animate one face and save the file", _add_bake, True),
    "rig": ("give a face the 52 ARKit shapes as keys, and save the file", _add_rig, True),
    "landmarks": ("find the 68 landmarks of a face", _add_landmarks, False),
}
TASKS = tuple(_TASKS)
