"""Clips on disk: what takes long to make is made once."""

import hashlib
import json
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import TypeVar

import torch

Row = TypeVar("Row")


def cached(path: Path, kind: type[Row], make: Callable[[], Iterable[Row]]) -> list[Row]:
    """Rows of the dataclass `kind` from a file, which `make` fills the first time."""
    if not path.exists():
        path.parent.mkdir(parents=True, exist_ok=True)
        partial = path.with_suffix(".partial")
        torch.save([vars(row) for row in make()], partial)
        partial.rename(path)
    return [kind(**fields) for fields in torch.load(path)]


def digest(*parts: object) -> str:
    """A short name for what json can hold."""
    return hashlib.sha256(json.dumps([*parts]).encode()).hexdigest()[:12]
