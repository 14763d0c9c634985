"""The jobs file: a JSON object with `shots`, and `defaults` for what most of them share.

A shot names the `file` to open, the file to `save`, and options of `bake` without their dashes. If
several faces of one file are animated, `faces` lists such options for each. Paths are relative to
the jobs file.
"""

import functools
import hashlib
import json
import os
import re
from argparse import ArgumentError
from dataclasses import dataclass, replace
from pathlib import Path

from ..core import json_file, model_card, options, schema, wording
from ..core.errors import AnyfaceError
from .paths import PathMap

_OWN = ("name", "file", "save", "faces")
_NAME = re.compile(r"[\w.-]+")
_parser = functools.cache(options.step_parser)
_LONGEST = 200
# The stem of the file beside the reports that sums them up.
SUMMARY = "batch"


@dataclass(frozen=True)
class Shot:
    """A file to open, the command lines to run on it, and the file to write.

    `digest` changes with the row and with the files that it reads. If it differs from the digest in
    the report, a finished shot is done again.
    """

    name: str
    file: str
    save: str
    report: str
    steps: tuple[tuple[str, ...], ...]
    digest: str = ""


@dataclass(frozen=True)
class Broken:
    """An invalid row: `outcome` is what its report says, under the name of `shot`."""

    shot: Shot
    outcome: dict


@dataclass(frozen=True)
class Listed:
    """The rows of a jobs file: valid `shots` and invalid `broken` ones.

    `total` counts all rows of the file.
    """

    shots: list[Shot]
    broken: list[Broken]
    total: int


def read(
    path: Path, reports: Path, paths: PathMap | None = None, chosen: range | None = None
) -> Listed:
    """The rows of the file, or those with the numbers `chosen`, counted from 1.

    An invalid row does not keep the others from being done. Raises `AnyfaceError("input")` if the
    file as a whole or its `defaults` are wrong.
    """
    paths = paths or PathMap()
    content = schema.check(str(path), json_file.read(path), schema.OBJECT)
    rows = schema.check(f"{path}: shots", content.get("shots"), schema.LIST)
    defaults = _row(f"{path.name}, defaults", content.get("defaults", {}))
    if chosen is None:
        chosen = range(1, len(rows) + 1)
    elif chosen.start > len(rows):
        text = f"--rows: expected rows of 1 to {len(rows)}, got {chosen.start}"
        raise AnyfaceError("input", text)
    shots, wrong = {}, {}
    for number, row in enumerate(rows, start=1):
        where = f"{path.name}, shot {number}"
        try:
            row = {**defaults, **_row(where, row)}
            shots[number] = _shot(where, row, path.parent.resolve(), reports, paths)
        except AnyfaceError as error:
            wrong[number] = error
    wrong |= _clashes(path, shots)
    good = {number: shot for number, shot in shots.items() if number not in wrong}
    names = {SUMMARY, *(shot.name.casefold() for shot in good.values())}
    broken = []
    for number, error in sorted(wrong.items()):
        name = _name_of(number, rows[number - 1], names)
        names.add(name.casefold())
        if number in chosen:
            broken.append(_broken(name, reports, error))
    shots = [shot for number, shot in good.items() if number in chosen]
    return Listed(shots, broken, len(rows))


def _broken(name: str, reports: Path, error: AnyfaceError) -> Broken:
    outcome = {"ok": False, "kind": error.kind, "message": f"{error}: mend the row, then run again"}
    shot = Shot(name, "", "", str(reports / f"{name}.json"), ())
    return Broken(shot, {**outcome, "exit_code": error.exit_code, "seconds": 0.0})


def _name_of(number: int, row, names: set[str]) -> str:
    """The name of an invalid row; "row-" and its number if it has no unique valid name."""
    name = row.get("name") if isinstance(row, dict) else None
    if name is None and isinstance(row, dict) and isinstance(row.get("save"), str):
        name = Path(row["save"]).stem
    if _is_name(name) and name.casefold() not in names:
        return name
    name = f"row-{number}"
    while name in names:
        name += "-"
    return name


def _is_name(name) -> bool:
    is_text = isinstance(name, str) and _NAME.fullmatch(name) is not None
    # With the suffix of a report, a longer name would be too long for a file.
    return is_text and len(name.encode()) <= _LONGEST


def _row(where: str, row) -> dict:
    """Checks and returns a row or the defaults: options with single values, also in `faces`."""
    rules = dict.fromkeys(("file", "save", "name"), (schema.TEXT,)) | {"faces": (schema.LIST,)}
    schema.fields(where, row, rules, schema.SCALAR)
    for number, face in enumerate(row.get("faces", []), start=1):
        schema.fields(f"{where}, face {number}", face, {}, schema.SCALAR)
    return row


def _shot(where: str, row: dict, folder: Path, reports: Path, paths: PathMap) -> Shot:
    for field in ("file", "save"):
        if not row.get(field) or "\0" in row[field]:
            raise AnyfaceError("input", f"{where}: expected a path in {field!r}")
    name = row.get("name", Path(row["save"]).stem)
    if not _is_name(name):
        raise AnyfaceError(
            "input",
            f"{where}: name: expected up to {_LONGEST} letters, digits, '.', '-' and '_', got "
            f"{name[:60]!r}",
        )
    if name.casefold() == SUMMARY:
        raise AnyfaceError(
            "input", f"{where}: name: expected another than {name!r}, which the summary has"
        )
    shared = {field: value for field, value in row.items() if field not in _OWN}
    faces = row.get("faces", [{}])
    if not faces:
        raise AnyfaceError("input", f"{where}: faces: expected at least one, got none")
    where = f"{where} ({name})"
    steps = tuple(_step(where, {**shared, **face}, folder, paths) for face in faces)
    shot = Shot(
        name=name,
        file=str(folder / paths.here(row["file"])),
        save=str(folder / paths.here(row["save"])),
        report=str(reports / f"{name}.json"),
        steps=steps,
    )
    return replace(shot, digest=_digest(row, shot))


def _step(where: str, row: dict, folder: Path, paths: PathMap) -> tuple[str, ...]:
    """The command line of one face of a row, checked with the parser that the worker will use."""
    row = dict(row)
    task = row.pop("task", options.TASKS[0])
    if task not in options.TASKS:
        raise AnyfaceError("input", f"{where}: task: expected {options.TASKS}, got {task!r}")
    words = []
    path_options = (*options.files_read(), "out", "weights")
    for field, value in row.items():
        if value is None:
            continue
        field = field.replace("_", "-")
        if "\0" in field or "\0" in str(value):
            raise AnyfaceError("input", f"{where}: {field}: expected text without a null")
        if field in path_options:
            value = folder / paths.here(str(value))
        words.append(f"--{field}={value}")
    try:
        unknown = _parser(task).parse_known_args(words)[1]
    except ArgumentError as error:
        raise AnyfaceError("input", f"{where}: {error}") from None
    if unknown:
        raise AnyfaceError("input", f"{where}: {task} does not know {' '.join(unknown)}")
    return (task, *words)


def _digest(row: dict, shot: Shot) -> str:
    """A digest of the row, of the size and time of the files it reads, and of its models' time.

    No path of this machine goes into it, so that all machines agree on which shots are finished.
    """
    digest = hashlib.blake2b(json.dumps(row).encode(), digest_size=12)
    for path in (shot.file, *_values(shot, *options.files_read())):
        if os.path.isfile(path):
            state = os.stat(path)
            digest.update(f"{state.st_size} {state.st_mtime_ns} ".encode())
    for models in _values(shot, "weights"):
        digest.update(f"{model_card.changed_ns(Path(models))} ".encode())
    return digest.hexdigest()


def _clashes(path: Path, shots: dict[int, Shot]) -> dict[int, AnyfaceError]:
    """Errors, by row number, of rows that get in each other's way.

    Rows run in any order and at the same time. So no two rows may share a name or write the same
    file, and no row may write a file that a row reads.
    """
    errors = {}
    for what, of in (("name", lambda shot: {shot.name.casefold()}), ("output", _written)):
        owners = {}
        for number, shot in shots.items():
            for key in of(shot):
                owners.setdefault(key, []).append(number)
        for key, numbers in owners.items():
            for number in numbers if len(numbers) > 1 else ():
                others = wording.listed([str(n) for n in numbers if n != number][:3])
                where = f"{path.name}, shot {number}"
                text = f"{where}: shots {others} have the {what} {key} too"
                errors[number] = AnyfaceError("input", text)
    files = {key for shot in shots.values() for key in _files_read(shot)}
    for number, shot in shots.items():
        for key in _written(shot) & files:
            text = f"{path.name}, shot {number}: {key} is read and written: save elsewhere"
            errors[number] = AnyfaceError("input", text)
    return errors


def _written(shot: Shot) -> set[str]:
    return {_key(shot.save), *map(_key, _values(shot, "out"))}


def _files_read(shot: Shot) -> set[str]:
    return {_key(shot.file), *map(_key, _values(shot, *options.files_read()))}


def _key(path: str) -> str:
    # Some file systems ignore case.
    return os.path.realpath(path).casefold()


def _values(shot: Shot, *names: str) -> list[str]:
    words = [word.partition("=") for step in shot.steps for word in step[1:]]
    return [value for option, _, value in words if option.removeprefix("--") in names]
