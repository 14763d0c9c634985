"""Ways to show a mouth chart: shape keys, objects of a collection, a number, Grease Pencil."""

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
# The types of Grease Pencil objects: up to Blender 4.2, and since 4.3.
PENCIL_TYPES = ("GPENCIL", "GREASEPENCIL")


@dataclass
class Drawings:
    """The artist's choice: where the drawings are, and which drawing shows each mouth.

    `names` maps each mouth to a shape key or an object, `numbers` maps it to a frame or an index.
    """

    kind: str
    output: str
    ob: object = None
    collection: object = None
    property: str = "mouth"
    names: dict[str, str] = field(default_factory=dict)
    numbers: dict[str, int] = field(default_factory=dict)


def names_of(drawings: Drawings) -> list[str]:
    """The names of all possible drawings: shape keys, or objects of the collection."""
    if drawings.output == KEYS:
        keys = getattr(drawings.ob.data, "shape_keys", None) if drawings.ob is not None else None
        return [block.name for block in keys.key_blocks] if keys is not None else []
    if drawings.output == OBJECTS and drawings.collection is not None:
        return [ob.name for ob in drawings.collection.all_objects]
    return []


def check(drawings: Drawings) -> None:
    """Raises `AnyfaceError` with the remedy where a chart cannot be shown."""
    _OUTPUTS[drawings.output].check(drawings)


def channels(drawings: Drawings, changes: list[tuple[int, str]]) -> list[Channel]:
    """The animated properties, with a value for each of the changes; call `check` first."""
    return _OUTPUTS[drawings.output].channels(drawings, [mouth for _, mouth in changes])


def shown_on(drawings: Drawings) -> list:
    """The objects that carry the curves."""
    if drawings.output == OBJECTS:
        return list({bpy.data.objects[name]: None for name in _named(drawings).values()})
    return [drawings.ob]


def make(drawings: Drawings) -> dict[str, str]:
    """Adds the custom property or the modifier that will be animated, where one is needed.

    Returns arguments for `entry.put`.
    """
    if drawings.output == NUMBER and is_new_property(drawings):
        drawings.ob[drawings.property.strip()] = min(drawings.numbers.values())
        return {"made_property": drawings.property.strip()}
    if drawings.output == PENCIL:
        modifiers, kind = _pencil(drawings.ob)
        modifier = modifiers.new(MODIFIER, kind)
        modifier.mode = "FIX"
        return {"made_modifier": modifier.name}
    return {}


def _named(drawings: Drawings) -> dict[str, str]:
    """The name of the drawing of each mouth; raises `AnyfaceError` for names that do not exist."""
    known, where = names_of(drawings), _where(drawings)
    named = {mouth: name for mouth, name in drawings.names.items() if name}
    for mouth, name in named.items():
        if name not in known:
            listed = ", ".join(known[:8]) or "nothing"
            raise AnyfaceError(
                "input", f"{mouth}: expected one of {where} ({listed}), got {name!r}"
            )
    return mouth_chart.complete(drawings.kind, named, where)


def _where(drawings: Drawings) -> str:
    if drawings.output == KEYS:
        return f"the shape keys of {drawings.ob.name}"
    return f"the collection {drawings.collection.name}"


def _check_keys(drawings: Drawings) -> None:
    if drawings.ob is None or drawings.ob.type != "MESH" or drawings.ob.data.shape_keys is None:
        name = drawings.ob.name if drawings.ob is not None else "nothing"
        text = f"expected a mesh with a shape key for each mouth, got {name}: choose one at Object"
        raise AnyfaceError("input", text)
    if not drawings.ob.data.shape_keys.use_relative:
        raise AnyfaceError(
            "mesh", f"{drawings.ob.name}: its shape keys are absolute: turn Relative on"
        )
    _named(drawings)


def _key_channels(drawings: Drawings, mouths: list[str]) -> list[Channel]:
    named, keys = _named(drawings), drawings.ob.data.shape_keys
    drawn = dict.fromkeys(named.values())
    drawn.pop(keys.reference_key.name, None)
    return [
        Channel(
            drawings.ob, KEY, curves.value_path(key), f"the key {key}", _held(named, mouths, key)
        )
        for key in drawn
    ]


def _held(named: dict, mouths: list[str], drawing) -> np.ndarray:
    """Values `[N]`: 1 while `drawing` shows the mouth, else 0."""
    return np.array([float(named[mouth] == drawing) for mouth in mouths])


def _check_objects(drawings: Drawings) -> None:
    if drawings.collection is None:
        raise AnyfaceError("input", "choose the collection whose objects are the drawn mouths")
    _named(drawings)


def _object_channels(drawings: Drawings, mouths: list[str]) -> list[Channel]:
    named, visibilities = _named(drawings), []
    for name in dict.fromkeys(named.values()):
        ob, hidden = bpy.data.objects[name], 1.0 - _held(named, mouths, name)
        for path in ("hide_render", "hide_viewport"):
            visibilities.append(Channel(ob, OBJECT, path, "its visibility", hidden))
    return visibilities


def _check_number(drawings: Drawings) -> None:
    if drawings.ob is None or not drawings.property.strip():
        raise AnyfaceError("input", "choose an object and the name of a property of it")
    if is_new_property(drawings):
        return
    try:
        value = drawings.ob.path_resolve(_path(drawings))
    except ValueError:
        value = None
    if type(value) not in (int, float) or re.search(r"\[\d+\]$", drawings.property):
        got = "nothing of that name" if value is None else type(value).__name__
        text = f"{drawings.ob.name}: expected a number at {drawings.property}, got {got}"
        raise AnyfaceError("input", text)


def is_new_property(drawings: Drawings) -> bool:
    """Whether the number is a custom property that does not exist yet."""
    return _path(drawings).startswith('["') and drawings.property.strip() not in drawings.ob


def _path(drawings: Drawings) -> str:
    """The data path of the number; a plain name is a custom property."""
    text = drawings.property.strip()
    if "." in text or "[" in text:
        return text
    return f'["{bpy.utils.escape_identifier(text)}"]'


def _number_channels(drawings: Drawings, mouths: list[str]) -> list[Channel]:
    values = np.array([float(drawings.numbers[mouth]) for mouth in mouths])
    return [Channel(drawings.ob, OBJECT, _path(drawings), drawings.property, values)]


def _check_pencil(drawings: Drawings) -> None:
    if drawings.ob is None or drawings.ob.type not in PENCIL_TYPES:
        name = drawings.ob.name if drawings.ob is not None else "nothing"
        text = f"expected a Grease Pencil object with a frame for each mouth, got {name}"
        raise AnyfaceError("input", f"{text}: choose one at Object")


def _pencil_channels(drawings: Drawings, mouths: list[str]) -> list[Channel]:
    modifiers, kind = _pencil(drawings.ob)
    modifier = next(one for one in reversed(modifiers) if one.name.startswith(MODIFIER))
    name = bpy.utils.escape_identifier(modifier.name)
    stem = "grease_pencil_modifiers" if kind == "GP_TIME" else "modifiers"
    values = np.array([float(drawings.numbers[mouth]) for mouth in mouths])
    return [Channel(drawings.ob, OBJECT, f'{stem}["{name}"].offset', modifier.name, values)]


def _pencil(ob):
    """The modifiers of a Grease Pencil object, and the type of its Time Offset modifier.

    Blender 4.2 keeps these modifiers in a list of their own. Since 4.3 they are in the same list as
    those of meshes.
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


def check_editable(drawings: Drawings) -> None:
    """Raises `AnyfaceError("mesh")` where an object that shows the chart is linked."""
    for ob in shown_on(drawings):
        entry.check(ob, KEY if drawings.output == KEYS else OBJECT)
