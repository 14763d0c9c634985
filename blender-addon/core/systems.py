"""The systems of the library and the controls that each of them understands.

The list comes from the library. It is read once, without loading models. The panel, the presets
and the command are built from it.
"""

from ctypes import byref, sizeof
from dataclasses import dataclass
from functools import cache

from . import library, sliders
from .errors import AnyfaceError

# What a control acts on, numbered as in `AnyfaceControlStage`.
FACE, MOTION = 0, 1
# What a control's numbers mean, numbered as in `AnyfaceControlValues`.
REAL, WHOLE, CHOICE = 0, 1, 2


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
    values: int
    stage: int
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
class System:
    """A method that turns speech into motion; the panel shows `controls` in this order."""

    name: str
    label: str
    help: str
    controls: tuple[Control, ...]
    takes_events: bool = False
    # Whether it hears emotion in the voice or in another recording.
    hears_emotion: bool = False
    # Whether its motion can start from a given pose.
    starts_from_pose: bool = False
    # The names in `sliders.NAMES` that its takes may have.
    sliders: tuple[str, ...] = ()


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
    by_name = {}
    for control in (control for system in known() for control in system.controls):
        by_name.setdefault(control.name, control)
    return tuple(by_name.values())


def find(name: str, among: tuple[System, ...]) -> System:
    """The system called `name`; "" means the first one. Raises `AnyfaceError("input")`."""
    match = next((system for system in among if name in ("", system.name)), None)
    if match is None:
        names = ", ".join(system.name for system in among)
        raise AnyfaceError("input", f"system: expected one of {names}, got {name!r}")
    return match


@cache
def units() -> dict[str, str]:
    """The action units of the extension's library: a label for each unit number."""
    try:
        loaded = library.load(library.library_path())
    except AnyfaceError:
        return {}
    names = library.texts(loaded.anyface_action_unit_name)
    return dict(zip(names, library.texts(loaded.anyface_action_unit_label), strict=True))


def by_name(name: str) -> System:
    """The system called `name`, or one without abilities if no library can be loaded."""
    among = known()
    return find(name, among) if among else System("", "", "", ())


def read(loaded) -> tuple[System, ...]:
    """The systems of a loaded library."""
    return tuple(_system(loaded, number) for number in range(loaded.anyface_system_count()))


def _system(loaded, number: int) -> System:
    calls = (loaded.anyface_system_name, loaded.anyface_system_label, loaded.anyface_system_help)
    name, label, text = (call(number).decode() for call in calls)
    count = loaded.anyface_system_control_count(number)
    controls = tuple(_control(loaded, number, at) for at in range(count))
    takes_events = loaded.anyface_system_takes_events(number) == 1
    hears_emotion = loaded.anyface_system_hears_emotion(number) == 1
    starts = loaded.anyface_system_starts_from_pose(number) == 1
    has = loaded.anyface_system_has_slider
    sliders_of_system = tuple(name for at, name in enumerate(sliders.NAMES) if has(number, at) == 1)
    able = takes_events, hears_emotion, starts
    return System(name, label, text, controls, *able, sliders_of_system)


def _control(loaded, system: int, number: int) -> Control:
    description = library.Control()
    if loaded.anyface_system_control(system, number, byref(description), sizeof(description)) != 0:
        text = f"the library cannot describe control {number} of system {system}"
        raise AnyfaceError("internal", text)
    name, unit = description.name.decode(), description.unit.decode()
    return Control(
        name=name,
        flag=name.removesuffix(f"_{unit}").replace("_", "-"),
        label=description.label.decode(),
        help=description.help.decode(),
        choices=tuple(description.choices[at].decode() for at in range(description.choice_count)),
        values=description.values,
        stage=description.stage,
        low=description.low,
        high=description.high,
        default=description.default_value,
        is_animatable=bool(description.animatable),
    )
