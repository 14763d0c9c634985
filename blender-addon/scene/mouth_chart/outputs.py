"""Where a mouth chart is shown: shape keys, objects of a collection, a number, Grease Pencil."""

import re
from collections.abc import Callable
from dataclasses import dataclass, field

import bpy
import numpy as np

from ...core import mouth_chart
from ...core.errors import AnyfaceError
from ..animation import curves
from . import entry
from .entry import KEY, OBJECT, Channel

KEYS, OBJECTS, NUMBER, PENCIL = "KEYS", "OBJECTS", "NUMBER", "GREASE_PENCIL"
MODIFIER = "Anyface Mouth Chart"
# Types of objects that Grease Pencil has drawn with, until 4.2 and since.
PENCIL_TYPES = ("GPENCIL", "GREASEPENCIL")


@dataclass
class Drawings:
    """What an artist has chosen: where the mouths are, and which drawing shows each.

    `names` are shape keys or objects by mouth, `numbers` frames or indices.
    """

    kind: str
    output: str
    ob: object = None
    collection: object = None
    property: str = "mouth"
    names: dict[str, str] = field(default_factory=dict)
    numbers: dict[str, int] = field(default_factory=dict)


def names_of(wanted: Drawings) -> list[str]:
    """The names among which the drawings are: shape keys, or objects of the collection."""
    if wanted.output == KEYS:
        keys = getattr(wanted.ob.data, "shape_keys", None) if wanted.ob is not None else None
        return [block.name for block in keys.key_blocks] if keys is not None else []
    if wanted.output == OBJECTS and wanted.collection is not None:
        return [ob.name for ob in wanted.collection.all_objects]
    return []


def check(wanted: Drawings) -> None:
    """Raises `AnyfaceError` with what to do where a chart could not be shown."""
    _OUTPUTS[wanted.output].check(wanted)


def channels(wanted: Drawings, changes: list[tuple[int, str]]) -> list[Channel]:
    """What is animated, a value for each of the changes; `check` has found nothing."""
    return _OUTPUTS[wanted.output].channels(wanted, [mouth for _, mouth in changes])


def shown_on(wanted: Drawings) -> list:
    """The objects on which the curves lie."""
    if wanted.output == OBJECTS:
        return list({bpy.data.objects[name]: None for name in _named(wanted).values()})
    return [wanted.ob]


def make(wanted: Drawings) -> dict[str, str]:
    """Makes the custom property or the modifier that is animated, where there is none; returns
    which, as `entry.put` is told."""
    if wanted.output == NUMBER and is_new_property(wanted):
        wanted.ob[wanted.property.strip()] = min(wanted.numbers.values())
        return {"made_property": wanted.property.strip()}
    if wanted.output == PENCIL:
        modifiers, kind = _pencil(wanted.ob)
        made = modifiers.new(MODIFIER, kind)
        made.mode = "FIX"
        return {"made_modifier": made.name}
    return {}


def _named(wanted: Drawings) -> dict[str, str]:
    """The name of the drawing of each mouth; raises `AnyfaceError` for names that are not there."""
    known, where = names_of(wanted), _where(wanted)
    named = {mouth: name for mouth, name in wanted.names.items() if name}
    for mouth, name in named.items():
        if name not in known:
            listed = ", ".join(known[:8]) or "nothing"
            raise AnyfaceError(
                "input", f"{mouth}: expected one of {where} ({listed}), got {name!r}"
            )
    return mouth_chart.complete(wanted.kind, named, where)


def _where(wanted: Drawings) -> str:
    if wanted.output == KEYS:
        return f"the shape keys of {wanted.ob.name}"
    return f"the collection {wanted.collection.name}"


def _check_keys(wanted: Drawings) -> None:
    if wanted.ob is None or wanted.ob.type != "MESH" or wanted.ob.data.shape_keys is None:
        name = wanted.ob.name if wanted.ob is not None else "nothing"
        text = f"expected a mesh with a shape key for each mouth, got {name}: choose one at Object"
        raise AnyfaceError("input", text)
    if not wanted.ob.data.shape_keys.use_relative:
        raise AnyfaceError(
            "mesh", f"{wanted.ob.name}: its shape keys are absolute: turn Relative on"
        )
    _named(wanted)


def _key_channels(wanted: Drawings, mouths: list[str]) -> list[Channel]:
    named, keys = _named(wanted), wanted.ob.data.shape_keys
    drawn = dict.fromkeys(named.values())
    drawn.pop(keys.reference_key.name, None)
    return [
        Channel(wanted.ob, KEY, curves.value_path(key), f"the key {key}", _held(named, mouths, key))
        for key in drawn
    ]


def _held(named: dict, mouths: list[str], drawing) -> np.ndarray:
    """1 while one of the mouths is shown by a drawing, else 0, `[N]`."""
    return np.array([float(named[mouth] == drawing) for mouth in mouths])


def _check_objects(wanted: Drawings) -> None:
    if wanted.collection is None:
        raise AnyfaceError("input", "choose the collection whose objects are the drawn mouths")
    _named(wanted)


def _object_channels(wanted: Drawings, mouths: list[str]) -> list[Channel]:
    named, found = _named(wanted), []
    for name in dict.fromkeys(named.values()):
        ob, hidden = bpy.data.objects[name], 1.0 - _held(named, mouths, name)
        for path in ("hide_render", "hide_viewport"):
            found.append(Channel(ob, OBJECT, path, "its visibility", hidden))
    return found


def _check_number(wanted: Drawings) -> None:
    if wanted.ob is None or not wanted.property.strip():
        raise AnyfaceError("input", "choose an object and the name of a property of it")
    if is_new_property(wanted):
        return
    try:
        value = wanted.ob.path_resolve(_path(wanted))
    except ValueError:
        value = None
    if type(value) not in (int, float) or re.search(r"\[\d+\]$", wanted.property):
        got = "nothing of that name" if value is None else type(value).__name__
        text = f"{wanted.ob.name}: expected a number at {wanted.property}, got {got}"
        raise AnyfaceError("input", text)


def is_new_property(wanted: Drawings) -> bool:
    """Whether the number is a custom property that is not there yet."""
    return _path(wanted).startswith('["') and wanted.property.strip() not in wanted.ob


def _path(wanted: Drawings) -> str:
    """A data path; a plain name is a custom property."""
    text = wanted.property.strip()
    if "." in text or "[" in text:
        return text
    return f'["{bpy.utils.escape_identifier(text)}"]'


def _number_channels(wanted: Drawings, mouths: list[str]) -> list[Channel]:
    values = np.array([float(wanted.numbers[mouth]) for mouth in mouths])
    return [Channel(wanted.ob, OBJECT, _path(wanted), wanted.property, values)]


def _check_pencil(wanted: Drawings) -> None:
    if wanted.ob is None or wanted.ob.type not in PENCIL_TYPES:
        name = wanted.ob.name if wanted.ob is not None else "nothing"
        text = f"expected a Grease Pencil object with a frame for each mouth, got {name}"
        raise AnyfaceError("input", f"{text}: choose one at Object")


def _pencil_channels(wanted: Drawings, mouths: list[str]) -> list[Channel]:
    modifiers, kind = _pencil(wanted.ob)
    made = next(one for one in reversed(modifiers) if one.name.startswith(MODIFIER))
    name = bpy.utils.escape_identifier(made.name)
    stem = "grease_pencil_modifiers" if kind == "GP_TIME" else "modifiers"
    values = np.array([float(wanted.numbers[mouth]) for mouth in mouths])
    return [Channel(wanted.ob, OBJECT, f'{stem}["{name}"].offset', made.name, values)]


def _pencil(ob):
    """The modifiers of a Grease Pencil object, and what Time Offset is called among them.

    4.2 keeps them apart from those of meshes; since 4.3 they are the same list.
    """
    if ob.type == "GPENCIL":
        return ob.grease_pencil_modifiers, "GP_TIME"
    return ob.modifiers, "GREASE_PENCIL_TIME"


@dataclass(frozen=True)
class _Output:
    """One way to show a chart."""

    check: Callable
    channels: Callable


_OUTPUTS = {
    KEYS: _Output(_check_keys, _key_channels),
    OBJECTS: _Output(_check_objects, _object_channels),
    NUMBER: _Output(_check_number, _number_channels),
    PENCIL: _Output(_check_pencil, _pencil_channels),
}


def check_editable(wanted: Drawings) -> None:
    """Raises `AnyfaceError("mesh")` where an object that shows it is linked."""
    for ob in shown_on(wanted):
        entry.check(ob, KEY if wanted.output == KEYS else OBJECT)
