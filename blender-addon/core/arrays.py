"""Arrays, numbers and texts in the form in which the native library reads them.

The library gets an address and trusts the sizes beside it, and ends a text at its first zero. So
all that a caller brings passes through here.
"""

import os

import numpy as np
from numpy.typing import ArrayLike

from .errors import AnyfaceError


def array_of(what: str, values: ArrayLike, kind: type, *shape: int | str) -> np.ndarray:
    """`values` as numbers of a numpy `kind`, row by row in memory.

    A number in `shape` is the length of that axis; a letter stands for any length. Without `shape`
    the array may have any. An empty list is an array without rows. Raises `AnyfaceError("input")`
    that names the array `what`.
    """
    try:
        with np.errstate(all="ignore"):
            array: np.ndarray = np.ascontiguousarray(values, dtype=kind)
    except (TypeError, ValueError, OverflowError) as error:
        raise AnyfaceError("input", f"{what}: expected an array of numbers: {error}") from error
    if np.shape(values) == (0,) and shape and isinstance(shape[0], str):
        # An empty list has no rows that could tell their length.
        return np.empty([n if isinstance(n, int) else 0 for n in shape], dtype=kind)
    lengths = zip(shape, array.shape, strict=False)
    fits = array.ndim == len(shape) and all(a == b for a, b in lengths if isinstance(a, int))
    if shape and not (fits and np.ndim(values) == array.ndim):
        expected = ", ".join(str(length) for length in shape)
        got = ", ".join(str(length) for length in np.shape(values))
        raise AnyfaceError("input", f"{what}: expected [{expected}], got [{got}]")
    return array


def number_of(what: str, value) -> float:
    """`value` as a number. Raises `AnyfaceError("input")` that names it `what`."""
    try:
        return float(value)
    except (TypeError, ValueError, OverflowError) as error:
        raise AnyfaceError("input", f"{what}: expected a number, got {value!r}") from error


def bytes_of(what: str, text: str) -> bytes:
    """`text` in UTF-8. Raises `AnyfaceError("input")` that names it `what`."""
    if not isinstance(text, str):
        raise AnyfaceError("input", f"{what}: expected a text, got {text!r:.60}")
    try:
        return _without_zero(what, text.encode())
    except UnicodeEncodeError as error:
        raise AnyfaceError("input", f"{what}: expected letters: {error}") from error


def path_of(path: str | bytes | os.PathLike) -> bytes:
    """The path of a file. Raises `AnyfaceError("input")`."""
    try:
        return _without_zero("path", os.fsencode(path))
    except (TypeError, UnicodeEncodeError) as error:
        raise AnyfaceError("input", f"path: expected the path of a file: {error}") from error


def _without_zero(what: str, text: bytes) -> bytes:
    if b"\0" in text:
        raise AnyfaceError("input", f"{what}: expected no zero byte, got {text!r:.60}")
    return text
