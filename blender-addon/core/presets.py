"""Presets of a performance as JSON files to keep and share. Does not depend on Blender.

`{"anyface_preset": 1, "name": "Calm Narrator", "values": {"articulation": 0.8, …}}`; values that
are left out stay unchanged.
"""

import math
import re
from dataclasses import dataclass, field, replace
from pathlib import Path

from . import json_file, schema, systems
from .emotion import EMOTIONS, MAX_INTENSITY, read_shares, write_shares
from .errors import AnyfaceError
from .take import EMOTION_SOURCES

VERSION = 1
SUFFIX = ".json"
# The text values that a preset may hold, with their choices.
WORDS = {"emotion": EMOTIONS, "emotion_source": EMOTION_SOURCES}
# Emotions beside the first one, as text: "sad:0.6,upset:0.2".
MIXED = "mixed"


def numbers() -> dict[str, tuple[float, float]]:
    """The numbers that a preset may hold, with their ranges: intensity and the library's own."""
    real = [control for control in systems.controls() if control.values == systems.REAL]
    return {"intensity": (0.0, MAX_INTENSITY)} | {c.name: (c.low, c.high) for c in real}


def names() -> tuple[str, ...]:
    """The names of all values that a preset may hold."""
    return (*WORDS, MIXED, *numbers())


@dataclass
class Preset:
    """Values by the names of the panel's properties; `path` is its file, if it has one."""

    name: str
    values: dict = field(default_factory=dict)
    path: Path | None = None


def read(path) -> Preset:
    """Reads a preset from a file. Raises `AnyfaceError`: "file" if it cannot be read, "input" if it
    does not hold a preset; the message names the wrong value."""
    path = Path(path)
    document = json_file.read(path)
    if not isinstance(document, dict) or document.get("anyface_preset") != VERSION:
        raise AnyfaceError("input", f"{path.name}: expected an Anyface preset of version {VERSION}")
    values = schema.check(f"{path.name}: values", document.get("values"), schema.OBJECT)
    values = _without_jaw_lips(values)
    name = document.get("name") or path.stem
    schema.check(f"{path.name}: name", name, schema.TEXT)
    return Preset(name, {key: _checked(path.name, key, values[key]) for key in values}, path)


def _without_jaw_lips(values: dict) -> dict:
    """Converts `jaw_lips` to `articulation` and `jaw`. Presets held it before the jaw had a control
    of its own: -1 halved the jaw's motion and gave the lips half more, 1 the other way round."""
    shift = values.get("jaw_lips")
    if not isinstance(shift, int | float) or not -1.0 <= shift <= 1.0:
        return values
    jaw, lips = 1.0 + 0.5 * shift, 1.0 - 0.5 * shift
    articulation = min(2.0, lips * values.get("articulation", 1.0))
    others = {name: value for name, value in values.items() if name != "jaw_lips"}
    return others | {"articulation": articulation, "jaw": min(2.0, jaw / lips)}


def _checked(where: str, name: str, value):
    if name in WORDS:
        if value not in WORDS[name]:
            known = ", ".join(WORDS[name])
            raise AnyfaceError("input", f"{where}: {name}: expected one of {known}, got {value!r}")
        return value
    if name == MIXED:
        schema.check(f"{where}: {name}", value, schema.TEXT)
        try:
            return write_shares(read_shares(value))
        except AnyfaceError as error:
            raise AnyfaceError("input", f"{where}: {name}: {error}") from error
    ranges = numbers()
    if name not in ranges:
        known = ", ".join(names())
        raise AnyfaceError("input", f"{where}: expected some of {known}, got {name!r}")
    low, high = ranges[name]
    number = isinstance(value, int | float) and not isinstance(value, bool)
    if not number or not math.isfinite(value) or not low <= value <= high:
        raise AnyfaceError("input", f"{where}: {name}: expected {low:g} to {high:g}, got {value!r}")
    return float(value)


def write(preset: Preset, path) -> Path:
    """Writes the whole preset or nothing; returns its path. Raises `AnyfaceError("file")`."""
    path = Path(path)
    values = {name: preset.values[name] for name in names() if name in preset.values}
    rounded = {n: round(v, 6) if isinstance(v, float) else v for n, v in values.items()}
    document = {"anyface_preset": VERSION, "name": preset.name, "values": rounded}
    json_file.write(path, document)
    return path


def file_name(name: str) -> str:
    """A file name for a preset: "Calm / Narrator" becomes "calm_narrator.json".

    Raises `AnyfaceError("input")` for a name without letters and digits.
    """
    stem = re.sub(r"\W+", "_", name.lower()).strip("_")
    if not stem:
        raise AnyfaceError("input", f"preset: expected a name with letters or digits, got {name!r}")
    return stem[:80] + SUFFIX


def with_free_name(preset: Preset, folder) -> Preset:
    """The preset under a name that no other of the folder has: its own, or one with a number.

    Raises `AnyfaceError("input")` as `file_name` does.
    """
    name, number = preset.name, 1
    while True:
        path = Path(folder) / file_name(name)
        if not path.exists() or _holds(path, replace(preset, name=name)):
            return replace(preset, name=name, path=path)
        number += 1
        # The number stays in the file name, which is cut.
        name = f"{preset.name[:60]} {number}"


def _holds(path: Path, preset: Preset) -> bool:
    try:
        return replace(read(path), path=preset.path) == preset
    except AnyfaceError:
        return False


def in_folder(folder) -> list[Preset]:
    """The presets of a folder, sorted by name; files that hold none are skipped."""
    presets_found = []
    for path in sorted(Path(folder).glob(f"*{SUFFIX}")) if folder else []:
        try:
            presets_found.append(read(path))
        except AnyfaceError:
            continue
    return sorted(presets_found, key=lambda preset: preset.name.lower())
