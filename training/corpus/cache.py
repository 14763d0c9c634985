"""Keeps clips that take long to make on disk, so that they are made only once."""

import hashlib
import json
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import TypeVar

import torch

Row = TypeVar("Row")


def cached(path: Path, kind: type[Row], make: Callable[[], Iterable[Row]]) -> list[Row]:
    """Rows of the dataclass `kind` from a file. If the file is missing, `make` fills it."""
    if not path.exists():
        path.parent.mkdir(parents=True, exist_ok=True)
        partial = path.with_suffix(".partial")
        torch.save([vars(row) for row in make()], partial)
        partial.rename(path)
    return [kind(**fields) for fields in torch.load(path)]


def digest(*parts: object) -> str:
    """A short hash of values that json can hold, for use in file names."""
    return hashlib.sha256(json.dumps([*parts]).encode()).hexdigest()[:12]
