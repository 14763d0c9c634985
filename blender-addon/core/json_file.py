"""Reads JSON files with clear errors and never leaves one half written. Needs no Blender."""

import json
import math
import os
import socket
from contextlib import suppress
from dataclasses import fields
from pathlib import Path
from typing import get_args, get_origin

from .errors import AnyfaceError

# Presets, jobs and landmarks are far smaller.
_LARGEST_BYTES = 64 << 20
# Longer numbers fit neither a float nor 64 bits.
_MAX_DIGITS = 19


def read(path):
    """The content of a file: text that can be written again, finite numbers that fit 64 bits.

    Raises `AnyfaceError`: "file" if the file cannot be read, "input" if it is no such JSON.
    """
    try:
        return parse(read_text(path))
    except ValueError as error:
        raise AnyfaceError("input", f"{path}: not JSON: {error}") from error


def read_text(path) -> str:
    """The text of a JSON file, without parsing it. Raises `AnyfaceError` as `read` does."""
    try:
        with open(path, "rb") as file:
            data = file.read(_LARGEST_BYTES + 1)
        if len(data) > _LARGEST_BYTES:
            raise ValueError(f"expected at most {_LARGEST_BYTES} bytes, got more")
        return data.decode("utf-8-sig")
    except OSError as error:
        raise AnyfaceError("file", f"{path}: {error.strerror or error}") from error
    except ValueError as error:
        raise AnyfaceError("input", f"{path}: not JSON: {error}") from error


def parse(text: str):
    """The content of a JSON text, with the checks of `read`. Raises `ValueError`."""
    try:
        value = json.loads(text, parse_int=_whole, parse_float=_real, parse_constant=_no_number)
        # Half of a surrogate pair is no text: Python could read it but never write it.
        json.dumps(value, ensure_ascii=False).encode("utf-8")
    except RecursionError:
        raise ValueError("expected lists in lists to end, got too many") from None
    except UnicodeEncodeError as error:
        raise ValueError(f"expected text, got half a character: {error.reason}") from None
    return value


def known_fields(kind, values: dict):
    """A dataclass of `kind` from the `values` that it has fields for: later versions write more.

    Raises `TypeError` if `values` is no such object, or if a field would hold another type.
    """
    if not isinstance(values, dict):
        raise TypeError(f"expected an object, got {values!r:.60}")
    known = {item.name: item.type for item in fields(kind)}
    chosen = {name: value for name, value in values.items() if name in known}
    for name, value in chosen.items():
        if not _is_of(known[name], value):
            raise TypeError(f"{name}: expected {known[name]}, got {value!r:.60}")
    return kind(**chosen)


def record(kind, text):
    """A dataclass of `kind` from a JSON text of a .blend, which anybody may have written; None if
    it is no such text."""
    try:
        return known_fields(kind, json.loads(text)) if isinstance(text, str) else None
    except (ValueError, TypeError, RecursionError):
        return None


def records(kind, text) -> list:
    """As `record`, from a list of objects; empty if it is no such text."""
    try:
        rows = json.loads(text) if isinstance(text, str) else []
        return [known_fields(kind, row) for row in rows] if isinstance(rows, list) else []
    except (ValueError, TypeError, RecursionError):
        return []


def _is_of(kind, value) -> bool:
    """Whether a value of a JSON text has a type such as `str` or `dict[str, list[float]]`."""
    of, parts = get_origin(kind) or kind, get_args(kind)
    if isinstance(value, int) and of in (int, float):
        return -(10**_MAX_DIGITS) < value < 10**_MAX_DIGITS
    if of is tuple:
        is_long = isinstance(value, list) and len(value) == len(parts)
        return is_long and all(map(_is_of, parts, value))
    if of is dict and parts:
        return isinstance(value, dict) and all(_is_of(parts[1], one) for one in value.values())
    if of is list and parts:
        return isinstance(value, list) and all(_is_of(parts[0], one) for one in value)
    return isinstance(value, of)


def _whole(digits: str) -> int:
    if len(digits.lstrip("-")) > _MAX_DIGITS:
        raise ValueError(f"expected at most {_MAX_DIGITS} digits, got {len(digits)}")
    return int(digits)


def _real(digits: str) -> float:
    value = float(digits)
    return value if math.isfinite(value) else _no_number(digits)


def _no_number(word: str):
    raise ValueError(f"expected a finite number, got {word[:20]}")


def write(path, content) -> None:
    """Writes a temporary file, then renames it: a reader finds the old file or the whole new one.

    Raises `AnyfaceError("file")`; the old file then stays.
    """
    write_text(path, to_text(content))


def to_text(content) -> str:
    """The text of a JSON file."""
    return json.dumps(content, indent=1, ensure_ascii=False) + "\n"


def write_text(path, text: str) -> None:
    """Writes any text as `write` does."""
    path = Path(path)
    beside = path.with_name(f".{path.name}.{socket.gethostname()}.{os.getpid()}")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        # File names may hold half a character, which is written as its number. Line ends stay as
        # they are in `text`, because scripts for other systems bring line ends of their own.
        with open(beside, "w", encoding="utf-8", errors="backslashreplace", newline="\n") as file:
            file.write(text)
            file.flush()
            os.fsync(file.fileno())
        os.replace(beside, path)
    except OSError as error:
        raise AnyfaceError("file", f"{path}: {error.strerror or error}") from error
    finally:
        with suppress(OSError):
            beside.unlink(missing_ok=True)
