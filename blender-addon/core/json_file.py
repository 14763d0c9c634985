"""JSON files that are read with clear errors and never half written. It knows no Blender."""

import json
import math
import os
import socket
from contextlib import suppress
from dataclasses import fields
from pathlib import Path

from .errors import AnyfaceError

# Presets, jobs and landmarks are far smaller.
_LARGEST_BYTES = 64 << 20
# Longer numbers fit neither a float nor 64 bits.
_MOST_DIGITS = 19


def read(path):
    """What the file holds: text that can be written again, numbers that are finite and fit 64 bits.

    Raises `AnyfaceError`: "file" where it cannot be read, "input" where it is no such JSON.
    """
    try:
        return parse(read_text(path))
    except ValueError as error:
        raise AnyfaceError("input", f"{path}: not JSON: {error}") from error


def read_text(path) -> str:
    """The text of a JSON file, whatever it holds. Raises `AnyfaceError` as `read` does."""
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
    """What a JSON text holds, as `read` has it. Raises `ValueError`."""
    try:
        value = json.loads(text, parse_int=_whole, parse_float=_real, parse_constant=_no_number)
        # One half of a pair of surrogates is no text: it could be read but never written.
        json.dumps(value, ensure_ascii=False).encode("utf-8")
    except RecursionError:
        raise ValueError("expected lists in lists to end, got too many") from None
    except UnicodeEncodeError as error:
        raise ValueError(f"expected text, got half a character: {error.reason}") from None
    return value


def known_fields(kind, values: dict):
    """A dataclass of `kind` with those of `values` that it knows: later versions write more.

    Raises `TypeError` or `AttributeError` for what is no such object.
    """
    known = {item.name for item in fields(kind)}
    return kind(**{name: value for name, value in values.items() if name in known})


def _whole(digits: str) -> int:
    if len(digits.lstrip("-")) > _MOST_DIGITS:
        raise ValueError(f"expected at most {_MOST_DIGITS} digits, got {len(digits)}")
    return int(digits)


def _real(digits: str) -> float:
    value = float(digits)
    return value if math.isfinite(value) else _no_number(digits)


def _no_number(word: str):
    raise ValueError(f"expected a finite number, got {word[:20]}")


def write(path, content) -> None:
    """Writes beside, then renames: a reader finds the old file or the whole new one.

    Raises `AnyfaceError("file")`; what lay there stays.
    """
    write_text(path, json.dumps(content, indent=1, ensure_ascii=False) + "\n")


def write_text(path, text: str) -> None:
    """Writes any text as `write` does."""
    path = Path(path)
    beside = path.with_name(f".{path.name}.{socket.gethostname()}.{os.getpid()}")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        # Half a character, as names of files may have it, stands there as its number.
        # Scripts for other systems have their own line ends wherever they are written.
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
