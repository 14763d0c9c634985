"""The systems of the library, and what each of them can be asked for.

The library describes them as JSON. It is read once, without loading models. The panel, the presets
and the command are built from it.
"""

import json
from dataclasses import dataclass
from functools import cache

from . import library, sliders
from .errors import AnyfaceError

# What a control acts on.
FACE, MOTION = "face", "motion"
# What a control's numbers mean.
REAL, WHOLE, CHOICE = "real", "whole", "choice"
# Kinds of fields.
NUMBER, TEXT, SOUND, FILE = "number", "text", "sound", "file"
# Their values are paths.
PATHS = (SOUND, FILE)
# Fields of these kinds that have their own place on the screen and their own option.
_BY_HAND = ("text", "fps", "emotion_of")


@dataclass(frozen=True)
class Control:
    """A setting that a system offers its user.

    `name` is the name of the property, `flag` the name of the command's option. Values lie between
    `low` and `high`. The value of a choice is an index into `choices`.
    """

    name: str
    flag: str
    label: str
    help: str
    choices: tuple[str, ...]
    values: str
    stage: str
    low: float
    high: float
    default: float
    is_animatable: bool

    @property
    def is_slider(self) -> bool:
        """True for a real number that acts on the motion: artists adjust these often."""
        return self.stage == MOTION and self.values == REAL

    def number(self, value) -> float:
        """A value as a number. The value of a choice may be given by name."""
        return float(self.choices.index(value) if isinstance(value, str) else value)


@dataclass(frozen=True)
class Field:
    """A setting of a performance that is no control of a system, such as its text.

    `kind` is "number", "text", "emotion", "intervals", "events", "sound" or "pose". Numbers lie
    between `low` and `high`.
    """

    name: str
    label: str
    help: str
    kind: str
    low: float = 0.0
    high: float = 0.0
    default: float = 0.0
    is_whole: bool = False

    @property
    def flag(self) -> str:
        """The name of the command's option."""
        return self.name.replace("_", "-")


@dataclass(frozen=True)
class System:
    """A method that turns speech into motion; the panel shows `controls` in this order."""

    name: str
    label: str
    help: str
    controls: tuple[Control, ...]
    fields: tuple[Field, ...] = ()
    emotions: tuple[str, ...] = ()
    # Action units that events may name, each with its label, and words with fixed units.
    units: tuple[tuple[str, str], ...] = ()
    words: tuple[str, ...] = ()
    takes_events: bool = False
    # Whether it hears emotion in the voice or in another recording.
    hears_emotion: bool = False
    # Whether its motion can start from a given pose.
    starts_from_pose: bool = False
    # The names in `sliders.NAMES` that its takes may have.
    sliders: tuple[str, ...] = ()

    @property
    def shows_performers(self) -> bool:
        """Whether its faces can speak as one person does."""
        return any(field.name == "performer" for field in self.fields)


@cache
def known() -> tuple[System, ...]:
    """The systems of the extension's library, the default one first.

    Empty if the library cannot be loaded; the first use of an engine then reports why.
    """
    try:
        return read(library.load(library.library_path()))
    except AnyfaceError:
        return ()


def controls() -> tuple[Control, ...]:
    """The controls of all systems. Systems that have a control of the same name share it."""
    by_name: dict[str, Control] = {}
    for control in (control for system in known() for control in system.controls):
        by_name.setdefault(control.name, control)
    return tuple(by_name.values())


def plain_fields(*kinds: str) -> tuple[Field, ...]:
    """The fields of some kinds, or of all, that panel and command draw from their descriptions."""
    kinds = kinds or (NUMBER, TEXT, *PATHS)
    every = (field for system in known() for field in system.fields)
    by_name = {field.name: field for field in every if field.name not in _BY_HAND}
    return tuple(field for field in by_name.values() if field.kind in kinds)


def find(name: str, among: tuple[System, ...]) -> System:
    """The system called `name`; "" means the first one. Raises `AnyfaceError("input")`."""
    is_text = isinstance(name, str)
    match = next((system for system in among if is_text and name in ("", system.name)), None)
    if match is None:
        names = ", ".join(system.name for system in among)
        raise AnyfaceError("input", f"system: expected one of {names}, got {name!r}")
    return match


def units() -> dict[str, str]:
    """The action units of the extension's library: a label for each unit number."""
    return dict(by_name("").units)


def words() -> list[str]:
    """The words with fixed units of the extension's library."""
    return list(by_name("").words)


def by_name(name: str) -> System:
    """The system called `name`, or one without abilities if no library can be loaded."""
    among = known()
    return find(name, among) if among else System("", "", "", ())


def read(loaded) -> tuple[System, ...]:
    """The systems of a loaded library."""
    return tuple(map(_system, json.loads(loaded.anyface_describe())))


def _system(described: dict) -> System:
    abilities = described["abilities"]
    return System(
        name=described["name"],
        label=described["label"],
        help=described["help"],
        controls=tuple(map(_control, described["controls"])),
        fields=tuple(Field(**row) for row in described["fields"]),
        emotions=tuple(described["emotions"]),
        units=tuple((unit["name"], unit["label"]) for unit in described["units"]),
        words=tuple(described["words"]),
        takes_events="events" in abilities,
        hears_emotion="emotion" in abilities,
        starts_from_pose="first_pose" in abilities,
        sliders=tuple(name for name in described["sliders"] if name in sliders.NAMES),
    )


def _control(row: dict) -> Control:
    return Control(
        name=row["name"],
        flag=row["name"].removesuffix(f"_{row['unit']}").replace("_", "-"),
        label=row["label"],
        help=row["help"],
        choices=tuple(row["choices"]),
        values=row["values"],
        stage=row["stage"],
        low=row["low"],
        high=row["high"],
        default=row["default"],
        is_animatable=row["animatable"],
    )
