"""Reads the files of a corpus. A file that breaks the layout raises a `CorpusError`."""

import json
import math
from pathlib import Path

import numpy as np


class CorpusError(ValueError):
    """A corpus that cannot be read: `file`, `row` (None for the whole file), `expected` and `actual`."""

    def __init__(self, file: Path, row: int | str | None, expected: str, actual: object):
        self.file, self.row, self.expected, self.actual = file, row, expected, actual
        place = str(file) if row is None else f"{file}, row {row}"
        super().__init__(f"{place}: expected {expected}, found {actual}")


def read_json(path: Path) -> dict:
    """Reads a json object."""
    try:
        content = json.loads(read_text(path))
    except json.JSONDecodeError as error:
        raise CorpusError(path, error.lineno, "json", error.msg) from error
    if not isinstance(content, dict):
        raise CorpusError(path, 1, "a json object", type(content).__name__)
    return content


def read_text(path: Path) -> str:
    """Reads a text file in UTF-8."""
    try:
        return path.read_text(encoding="utf-8-sig")
    except FileNotFoundError:
        raise CorpusError(path, None, "a file", "none") from None
    except UnicodeDecodeError as error:
        raise CorpusError(path, None, "text in UTF-8", error.reason) from error


def read_npz(path: Path) -> dict[str, np.ndarray]:
    """Reads all arrays of a .npz, without pickles."""
    try:
        with np.load(path) as file:
            return {name: file[name] for name in file.files}
    except (OSError, ValueError, EOFError) as error:
        raise CorpusError(path, None, "a .npz of numbers", error) from error


def need_shape(path: Path, values, shape: tuple[int | None, ...], what: str) -> np.ndarray:
    """Returns `values` if they are numbers of this shape. `None` stands for any count above 1."""
    expected = str(["T" if n is None else n for n in shape]).replace("'", "")
    if values is None or np.asarray(values).dtype.kind not in "fiu":
        raise CorpusError(path, None, f"{what} {expected}", "none")
    actual = values.shape
    if len(actual) != len(shape) or any(n != m if n else m < 2 for n, m in zip(shape, actual, strict=True)):
        raise CorpusError(path, None, f"{what} {expected}", list(actual))
    return values


def need_finite(path: Path, values: np.ndarray, frames: np.ndarray) -> None:
    """Raises at the first frame of `values` [T, ...] that has a NaN or infinite number."""
    bad = ~np.isfinite(values.reshape(len(values), -1)).all(axis=1)
    if bad.any():
        frame = int(frames[np.flatnonzero(bad)[0]])
        raise CorpusError(path, frame, "finite numbers in the frame", "NaN or infinity")


def number_of(path: Path, row: int, what: str, text: str) -> float:
    """Parses `text` as a finite number. `what` names it in the error."""
    try:
        value = float(text)
    except ValueError:
        raise CorpusError(path, row, f"{what}: a number", repr(text)) from None
    if not math.isfinite(value):
        raise CorpusError(path, row, f"{what}: a finite number", text)
    return value
