"""Events: what a face does for a while beside its speech, and what an artist calls it.

An event is made of action units of the Facial Action Coding System; which there are, the library
tells. An expression of an artist becomes units in `understand`, and nowhere else.
"""

import difflib
import re
from collections.abc import Callable
from dataclasses import dataclass

from . import json_file
from .errors import AnyfaceError

# The largest strength that the library takes.
MAX_STRENGTH = 2.0
LEFT, RIGHT = "L", "R"
SIDES = {"left": LEFT, "l": LEFT, "right": RIGHT, "r": RIGHT}
# What takes no side: its shapes have none.
_WITHOUT_SIDES = {"1", "17", "26", "28"}
_UNIT = re.compile(r"(?:au\s*)?0*(\d+)\s*(left|right|l|r)?(?=[\s,;+&]|$)[\s,;+&]*", re.IGNORECASE)
_OVER_SPEECH = "!"
# "smile:0.5", "smile!:0.5" and "smile:0.5!".
_STRENGTH = re.compile(r"(.*?):\s*(\d*\.?\d+)\s*(!)?", re.DOTALL)
_END = re.compile(r"end(?:\W+(.*))?", re.IGNORECASE | re.DOTALL)


@dataclass(frozen=True)
class Event:
    """Units such as "12" or "45L" from `start_s` to `end_s`, seconds from the begin of the sound.

    `strength` is 0 to 2; `over_speech` lets lips stay apart that the speech brings together;
    `name` is what a report calls it.
    """

    start_s: float
    end_s: float
    units: tuple[str, ...]
    strength: float = 1.0
    over_speech: bool = False
    name: str = ""


@dataclass(frozen=True)
class Expression:
    """A word of the menu: `units` as in `Event`."""

    name: str
    label: str
    units: tuple[str, ...]


MENU = (
    Expression("smile", "Smile", ("6", "12")),
    Expression("smirk", "Smirk", ("12L", "14L")),
    Expression("wink", "Wink", ("6L", "45L")),
    Expression("blink", "Blink", ("45",)),
    Expression("surprised blink", "Surprised Blink", ("1", "2", "45")),
    Expression("surprise", "Surprise", ("1", "2", "5", "26")),
    Expression("brow raise", "Brow Raise", ("1", "2")),
    Expression("worried brows", "Worried Brows", ("1", "4")),
    Expression("frown", "Frown", ("4",)),
    Expression("angry look", "Angry Look", ("4", "5", "7")),
    Expression("squint", "Squint", ("6", "7")),
    Expression("wide eyes", "Wide Eyes", ("5",)),
    Expression("sneer", "Sneer", ("9", "10")),
    Expression("disgust", "Disgust", ("9", "10", "15")),
    Expression("sad mouth", "Sad Mouth", ("15", "17")),
    Expression("grimace", "Grimace", ("10", "20")),
    Expression("sarcastic laugh", "Sarcastic Laugh", ("6", "12L", "14L", "26")),
    Expression("jaw drop", "Jaw Drop", ("26",)),
    Expression("pressed lips", "Pressed Lips", ("28",)),
)


@dataclass(frozen=True)
class Understood:
    """What was read in an expression: `units`, or none and a `hint` in words; how strongly the
    words ask for them."""

    units: tuple[str, ...] = ()
    over_speech: bool = False
    hint: str = ""
    strength: float = 1.0


@dataclass(frozen=True)
class Words:
    """What a text asks for: units, how strongly; without units the nearest text that has some, or
    why it could not be read."""

    units: tuple[str, ...] = ()
    strength: float = 1.0
    nearest: str = ""
    wrong: str = ""


def _nobody(_text: str) -> Words:
    return Words()


def understand(
    text: str, known: dict[str, str], words: Callable[[str], Words] = _nobody
) -> Understood:
    """The units of an expression: of units, `12,6L`, or of words, `left wink`; a ! at the end puts
    it over the speech.

    `known` are the library's units, their labels by name; `words` reads texts that are not in the
    menu.
    """
    asked = text.strip()
    over_speech = asked.endswith(_OVER_SPEECH)
    asked = asked.removesuffix(_OVER_SPEECH).strip()
    if not asked:
        return Understood(hint="it says nothing: write units such as 12,6L, or words such as smile")
    written = _units_of(asked)
    if written is None:
        found = of_words(asked, words)
        hint = found.wrong or ("" if found.units else _not_understood(asked, found.nearest))
        return Understood(found.units, over_speech and not hint, hint, found.strength)
    unknown = [name for name in written if name.rstrip("LR") not in known]
    if unknown:
        expected = ", ".join(known)
        return Understood(hint=f"unit: expected some of {expected}, got {unknown[0]}")
    return Understood(written, over_speech)


def of_words(text: str, read: Callable[[str], Words] = _nobody) -> Words:
    """The units of an expression in words: those of `MENU`, with `left` or `right` anywhere, else
    what `read` finds in it."""
    words = re.findall(r"\w+", text.lower())
    sides = {SIDES[word] for word in words if word in SIDES}
    name = " ".join(word for word in words if word not in SIDES)
    entry = next((entry for entry in MENU if entry.name == name), None)
    if entry is not None:
        return Words(on_side(entry.units, sides.pop() if len(sides) == 1 else ""))
    found = read(text)
    if found.units or found.nearest or found.wrong:
        return found
    names = [entry.name for entry in MENU]
    near = difflib.get_close_matches(name, names, n=1, cutoff=0.5)
    near += [entry for entry in names if set(entry.split()) & set(words)]
    return Words(nearest=near[0] if near else "")


def _not_understood(text: str, nearest: str) -> str:
    some = ", ".join(entry.name for entry in MENU[:4])
    more = f"; nearest: {nearest}" if nearest else f", or words such as {some}"
    return f"{text!r} is not understood: expected units such as 12,6L{more}"


def on_side(units: tuple[str, ...], side: str) -> tuple[str, ...]:
    """The same units on one side, "" as they are; those that have no sides stay on both."""
    if not side:
        return units
    names = [unit.rstrip("LR") for unit in units]
    return tuple(name if name in _WITHOUT_SIDES else name + side for name in names)


def strength_of(text: str) -> tuple[str, float]:
    """An expression and the strength behind it: "smile:0.5" is "smile" and 0.5; without one 1."""
    match = _STRENGTH.fullmatch(text.strip())
    if match is None:
        return text.strip(), 1.0
    return match[1].strip() + (match[3] or ""), float(match[2])


def ended_by(text: str, begun: list[str]) -> int | None:
    """Which of the expressions that have `begun`, in their order, a marker of this name ends.

    `end` ends the last of them, `end smile` the last smile; None for any other name.
    """
    match = _END.fullmatch(text.strip())
    if match is None:
        return None
    said = _plain(match[1] or "")
    fitting = [at for at, other in enumerate(begun) if not said or _plain(other) == said]
    return fitting[-1] if fitting else None


def _plain(text: str) -> str:
    """An expression without case, separators and the sign that puts it over the speech."""
    return " ".join(re.findall(r"\w+", text.lower()))


def of_file(
    path: str, known: dict[str, str], words: Callable[[str], Words] = _nobody
) -> list[Event]:
    """Events of a JSON file: a list, or an object with a list `events`, of rows with `start_s`,
    `end_s`, `units` (a list of units, or a text as for `understand`), and where they are there
    `strength` and `over_speech`.

    Raises `AnyfaceError`, "file", or "input" that names the row.
    """
    content = json_file.read(path)
    rows = content.get("events") if isinstance(content, dict) else content
    if not isinstance(rows, list):
        raise AnyfaceError("input", f"{path}: expected a list of events, got {type(rows).__name__}")
    return [_of_row(f"{path}, event {at}", row, known, words) for at, row in enumerate(rows, 1)]


def _of_row(where: str, row, known, words) -> Event:
    try:
        units, start_s, end_s = row["units"], float(row["start_s"]), float(row["end_s"])
        strength, over_speech = float(row.get("strength", 1.0)), row.get("over_speech", False)
        text = units if isinstance(units, str) else ",".join(units)
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        text = "expected start_s, end_s and units"
        raise AnyfaceError("input", f"{where}: {text}: {error}") from None
    if not 0.0 <= start_s < end_s < float("inf"):
        raise AnyfaceError("input", f"{where}: expected rising seconds, got {start_s} to {end_s}")
    if not 0.0 <= strength <= MAX_STRENGTH:
        limits = f"0 to {MAX_STRENGTH:g}"
        raise AnyfaceError("input", f"{where}: strength: expected {limits}, got {strength}")
    found = understand(text, known, words)
    if found.hint:
        raise AnyfaceError("input", f"{where}: {found.hint}")
    over_speech = bool(over_speech) or found.over_speech
    strength = min(strength * found.strength, MAX_STRENGTH)
    return Event(start_s, end_s, found.units, strength, over_speech, text)


def shortened(notes: list[str], most: int = 6) -> list[str]:
    """The first notes of many, and how many more there are."""
    more = len(notes) - most
    return notes if more <= 0 else [*notes[:most], f"and {more} more of this kind"]


def described(units: tuple[str, ...], known: dict[str, str]) -> str:
    """Units in words: "left lip corner puller, jaw drop"."""
    words = {LEFT: "left ", RIGHT: "right "}
    labels = [known.get(unit.rstrip("LR"), unit) for unit in units]
    return ", ".join(words.get(u[-1], "") + label for u, label in zip(units, labels, strict=True))


def _units_of(text: str) -> tuple[str, ...] | None:
    """Units with their sides as they are written; None where the text is anything else."""
    found, at = [], 0
    while at < len(text):
        match = _UNIT.match(text, at)
        if match is None:
            return None
        found.append(match[1] + SIDES.get((match[2] or "").lower(), ""))
        at = match.end()
    return tuple(dict.fromkeys(found))
