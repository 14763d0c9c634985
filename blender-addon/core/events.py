"""Events: what a face does for a while beside its speech.

An event is made of action units of the Facial Action Coding System. The library parses the words of
an artist and event files; this module only calls it.
"""

import re
from dataclasses import dataclass
from functools import cache, lru_cache
from pathlib import Path

from . import json_file, library, systems
from .arrays import bytes_of, path_of
from .calls import Calls
from .errors import AnyfaceError

_SIDES = {"L": "left ", "R": "right "}
_END = re.compile(r"end(?:\W+(.*))?", re.IGNORECASE | re.DOTALL)


@dataclass(frozen=True)
class Event:
    """Units such as "12" or "45L" from `start_s` to `end_s`, seconds from the start of the sound.

    `strength` is 0 to 2. `over_speech` keeps the lips apart where the speech brings them together.
    `name` is the event's name in a report.
    """

    start_s: float
    end_s: float
    units: tuple[str, ...]
    strength: float = 1.0
    over_speech: bool = False
    name: str = ""


@dataclass(frozen=True)
class Expression:
    """What the library reads in a text: `said` is the text without strength and `!`.

    If `units` is empty, `hint` says why.
    """

    said: str = ""
    units: tuple[str, ...] = ()
    strength: float = 1.0
    over_speech: bool = False
    hint: str = ""


class Reader(Calls):
    """Reads expressions and events as the `anyface` command does."""

    def __init__(self, models: Path | None = None):
        """`models` is a folder of models, which may read texts differently from the built-in model.

        Raises `AnyfaceError` where there is no library.
        """
        self._library = library.load(library.library_path())
        self._models = path_of(models) if models else None

    def menu(self) -> list[str]:
        """The words that have fixed units."""
        return systems.words()

    def expression(self, text: str) -> Expression:
        """Reads units such as `12,6L`, words such as `left wink:0.5`, or English.

        Raises `AnyfaceError` if the model of texts cannot be used.
        """
        read = self._read("anyface_expression_read", self._models, bytes_of("expression", text))
        return Expression(units=tuple(read.pop("units")), **read)

    def events(self, text: str) -> list[Event]:
        """Reads events from JSON, or from lines such as `1.2-2.0:smile:0.8`.

        Raises `AnyfaceError`, which names the event.
        """
        rows = self._read("anyface_events_read", self._models, bytes_of("events", text))
        written = [tuple(row.pop("units")) for row in rows]
        pairs = zip(rows, written, strict=True)
        return [Event(units=units, name=",".join(units), **row) for row, units in pairs]


@cache
def menu() -> tuple[str, ...]:
    """The words that have fixed units; none if the library cannot be loaded."""
    try:
        return tuple(Reader().menu())
    except AnyfaceError:
        return ()


def expression(text: str, models: Path | None = None) -> Expression:
    """What the library reads in a text, or why it cannot; `models` as for `Reader`."""
    try:
        return _expression(text, models)
    except AnyfaceError as error:
        return Expression(text, hint=str(error))


@lru_cache(maxsize=4096)
def _expression(text: str, models: Path | None) -> Expression:
    return Reader(models).expression(text)


def of_file(path: str, models: Path | None = None) -> list[Event]:
    """Reads the events of a JSON file, as `--events` of the command does.

    Raises `AnyfaceError`, "file", or "input" that names the row.
    """
    try:
        return Reader(models).events(json_file.read_text(path))
    except AnyfaceError as error:
        if error.kind != "input":
            raise
        raise AnyfaceError("input", f"{path}: {error}") from None


def ended_by(text: str, begun: list[str]) -> int | None:
    """The index of the expression in `begun` that a marker named `text` ends.

    `end` ends the last expression, `end smile` the last smile. None for any other name, or if no
    expression fits.
    """
    match = _END.fullmatch(text.strip())
    if match is None:
        return None
    said = _plain(match[1] or "")
    fitting = [at for at, other in enumerate(begun) if not said or _plain(other) == said]
    return fitting[-1] if fitting else None


def _plain(text: str) -> str:
    """An expression without case, separators and the `!` that puts it over the speech."""
    return " ".join(re.findall(r"\w+", text.lower()))


def shortened(notes: list[str], most: int = 6) -> list[str]:
    """The first notes of many, and how many more there are."""
    more = len(notes) - most
    return notes if more <= 0 else [*notes[:most], f"and {more} more of this kind"]


def described(units: tuple[str, ...], known: dict[str, str]) -> str:
    """Units in words: "left lip corner puller, jaw drop"; `known` are their labels by name."""
    labels = [known.get(unit.rstrip("LR"), unit) for unit in units]
    return ", ".join(_SIDES.get(u[-1], "") + label for u, label in zip(units, labels, strict=True))
