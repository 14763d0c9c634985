"""The jobs file: a JSON object with `shots`, and `defaults` for what most of them share.

A shot names its `file`, where to `save`, and the options of `bake` without their dashes; `faces` is
a list of such options where several faces of one file are animated. Paths count from the jobs file.
"""

import hashlib
import json
import os
import re
from argparse import ArgumentError
from dataclasses import asdict, dataclass
from pathlib import Path

from ..core import json_file, model_card, options, schema
from ..core.errors import AnyfaceError

_PATHS = ("audio", "events", "feeling", "landmarks", "out", "weights")
_OWN = ("name", "file", "save", "faces")
_NAME = re.compile(r"[\w.-]+")
# The stem of the file beside the reports that tells of all of them.
SUMMARY = "batch"


@dataclass(frozen=True)
class Shot:
    """One file to open, the command lines to run on it, one file to write.

    `digest` changes with the row and with the files that it reads: a finished shot is done again
    where it differs from that of the report.
    """

    name: str
    file: str
    save: str
    report: str
    steps: tuple[tuple[str, ...], ...]
    digest: str = ""


def read(path: Path, reports: Path) -> list[Shot]:
    """All shots of the file; raises `AnyfaceError("input")` that names the row."""
    content = schema.check(str(path), json_file.read(path), schema.OBJECT)
    rows = schema.check(f"{path}: shots", content.get("shots"), schema.LIST)
    defaults = _row(f"{path.name}, defaults", content.get("defaults", {}))
    shots = []
    for number, row in enumerate(rows, start=1):
        where = f"{path.name}, shot {number}"
        row = {**defaults, **_row(where, row)}
        shots.append(_shot(where, row, path.parent.resolve(), reports))
    _check_apart(path, shots)
    return shots


def _row(where: str, row) -> dict:
    """A row, or what most of them share: options that are single values, and faces of such."""
    rules = dict.fromkeys(("file", "save", "name"), (schema.TEXT,)) | {"faces": (schema.LIST,)}
    schema.fields(where, row, rules, schema.SCALAR)
    for number, face in enumerate(row.get("faces", []), start=1):
        schema.fields(f"{where}, face {number}", face, {}, schema.SCALAR)
    return row


def _shot(where: str, row: dict, folder: Path, reports: Path) -> Shot:
    for field in ("file", "save"):
        if not row.get(field) or "\0" in row[field]:
            raise AnyfaceError("input", f"{where}: expected a path in {field!r}")
    name = row.get("name", Path(row["save"]).stem)
    if not _NAME.fullmatch(name):
        raise AnyfaceError(
            "input", f"{where}: name: expected letters, digits, '.', '-' and '_', got {name!r}"
        )
    if name.casefold() == SUMMARY:
        raise AnyfaceError(
            "input", f"{where}: name: expected another than {name!r}, which the summary has"
        )
    shared = {field: value for field, value in row.items() if field not in _OWN}
    faces = row.get("faces", [{}])
    if not faces:
        raise AnyfaceError("input", f"{where}: faces: expected at least one, got none")
    steps = tuple(_step(f"{where} ({name})", {**shared, **face}, folder) for face in faces)
    shot = Shot(
        name=name,
        file=str(folder / row["file"]),
        save=str(folder / row["save"]),
        report=str(reports / f"{name}.json"),
        steps=steps,
    )
    return Shot(**{**asdict(shot), "steps": steps, "digest": _digest(shot)})


def _step(where: str, row: dict, folder: Path) -> tuple[str, ...]:
    """The command line of one row, tried on the parser that the worker will use."""
    row = dict(row)
    task = row.pop("task", options.TASKS[0])
    if task not in options.TASKS:
        raise AnyfaceError("input", f"{where}: task: expected {options.TASKS}, got {task!r}")
    words = []
    for field, value in row.items():
        if value is None:
            continue
        if field in _PATHS:
            value = folder / str(value)
        words.append(f"--{field}={value}")
    try:
        unknown = options.step_parser(task).parse_known_args(words)[1]
    except (ArgumentError, SystemExit) as error:
        raise AnyfaceError("input", f"{where}: {error}") from None
    if unknown:
        raise AnyfaceError("input", f"{where}: {task} does not know {' '.join(unknown)}")
    return (task, *words)


def _digest(shot: Shot) -> str:
    """Of the row, and of size and time of the files and models that it names."""
    digest = hashlib.blake2b(json.dumps(asdict(shot)).encode(), digest_size=12)
    words = [word.partition("=") for step in shot.steps for word in step[1:]]
    files = ("--audio", "--events", "--feeling", "--landmarks")
    read = [value for option, _, value in words if option in files]
    for path in (shot.file, *read):
        if os.path.isfile(path):
            state = os.stat(path)
            digest.update(f"{path} {state.st_size} {state.st_mtime_ns}".encode())
    for models in (value for option, _, value in words if option == "--weights"):
        digest.update(f"{models} {model_card.changed_ns(Path(models))}".encode())
    return digest.hexdigest()


def _check_apart(path: Path, shots: list[Shot]) -> None:
    """Shots run in any order and at once: no name, no written file may be met twice."""
    for field in ("name", "save"):
        seen = set()
        for shot in shots:
            value = getattr(shot, field)
            # Some file systems tell no small letters from large ones.
            if value.casefold() in seen:
                raise AnyfaceError("input", f"{path}: two shots have the {field} {value}")
            seen.add(value.casefold())
    files = {shot.file for shot in shots}
    for shot in shots:
        if shot.save in files:
            raise AnyfaceError("input", f"{path}: {shot.save} is read and written: save elsewhere")
