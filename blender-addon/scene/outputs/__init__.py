"""The ways to write a take. Each has its own file, and a line in `ALL`."""

from ...core.errors import AnyfaceError
from ...core.take import Take
from ..shape_keys import record
from .arkit import Arkit
from .basis import Basis
from .cache import Cache
from .controls import Controls
from .csv import Csv
from .frames import Frames
from .keys import Keys
from .output import Output
from .output import OutputSettings as OutputSettings

# Menus number the outputs in this order, and .blend files store the number. The first is the
# default.
ALL: tuple[Output, ...] = (
    Basis(),
    Frames(),
    Cache(),
    Keys(),
    Arkit(),
    Csv(),
    Controls(),
)
MODES = tuple(output.name for output in ALL)
# "basis, frames, …": the modes that a command line accepts.
WORDS = f"{', '.join(MODES[:-1])} or {MODES[-1]}"
# The items of a menu: name, label, help and number.
ITEMS = [(output.name, output.label, output.help, n) for n, output in enumerate(ALL)]


def of(mode: str) -> Output:
    """The output of that name; raises `AnyfaceError("input")` for an unknown one."""
    if mode not in MODES:
        raise AnyfaceError("input", f"mode: expected {' or '.join(MODES)}, got {mode!r}")
    return ALL[MODES.index(mode)]


def of_take(take: Take) -> Output:
    """The output that a take is made for."""
    return of(take.output)


def of_record(take_record: record.Record) -> Output:
    """The output of a take in keys. A take of a later version is treated as named shapes."""
    return next((output for output in ALL if output.name == take_record.mode), Output())


def of_object(ob) -> Output | None:
    """The output of the take that moves the mesh of `ob`, or None."""
    if record.is_generated(ob):
        return of_record(record.read(ob.data.shape_keys))
    return next((output for output in ALL if output.on_mesh and output.find(ob)), None)


def has_take(ob) -> bool:
    """True where `ob` (or None) carries something generated: keys, a cache, a table."""
    if ob is None or ob.type != "MESH":
        return False
    return record.is_generated(ob) or any(output.find(ob) for output in ALL)
