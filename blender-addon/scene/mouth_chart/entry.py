"""Records what a mouth chart has put on an object, and removes it again.

Each object that shows a chart stores the record in a custom property, beside the id of the
character that speaks. *Remove* deletes exactly what the record lists.
"""

import json
from dataclasses import asdict, dataclass, field

import bpy
import numpy as np

from ...core import json_file
from ...core.errors import AnyfaceError
from .. import identity
from ..animation import curves

# Up to Blender 4.5, an object's settings and its custom properties share one set of names.
PROPERTY = "anyface_chart_shown"
GROUP = "Anyface Mouth Chart"
# The data-blocks whose properties are animated: an object itself, or the shape keys of its mesh.
OBJECT, KEY = "OBJECT", "KEY"


@dataclass
class Channel:
    """A property that a chart animates; each of `values` `[N]` holds from its frame to the next.

    `holder` says which data-block of `ob` has the property. `label` is the artist's name for it.
    """

    ob: object
    holder: str
    path: str
    label: str
    values: np.ndarray


@dataclass
class Undo:
    """What to undo on a data-block when the chart is removed.

    `before` holds the earlier values by data path. The `made_*` fields say what was added to hold
    the curves.
    """

    before: dict[str, float] = field(default_factory=dict)
    made_action: bool = False
    made_slot: bool = False
    made_animation_data: bool = False


@dataclass
class Entry:
    """The record of a chart on an object.

    `speaks` is the id of the character, and `shows` is the id of the object itself. `on` holds an
    `Undo` for each holder. `made_property` and `made_modifier` name what was added for the chart.
    """

    speaks: str
    shows: str
    on: dict[str, dict] = field(default_factory=dict)
    made_property: str = ""
    made_modifier: str = ""


def read(ob) -> Entry | None:
    """The record of the chart on an object, or None."""
    entry = json_file.record(Entry, ob.get(PROPERTY))
    try:
        for undo in entry.on.values() if entry is not None else ():
            json_file.known_fields(Undo, undo)
    except TypeError:
        return None
    return entry


def shown_by(speaker) -> list:
    """The objects that show the chart of a character."""
    local = [ob for ob in bpy.data.objects if ob.library is None and PROPERTY in ob]
    return [ob for ob in local if _is_of(speaker, ob)]


def _is_of(speaker, ob) -> bool:
    """Whether an object shows the chart of a character.

    If a character shows its own chart, a copy of it shows that chart as its own. If an object shows
    another character's chart, a copy of the object belongs to nobody.
    """
    entry = read(ob)
    if entry is None:
        return False
    if entry.speaks == entry.shows:
        return ob == speaker
    return entry.speaks == identity.known(speaker) and entry.shows == identity.known(ob)


def block_of(ob, holder: str):
    """The data-block that holds the animated properties."""
    return ob.data.shape_keys if holder == KEY else ob


def check(ob, holder: str) -> None:
    """Raises `AnyfaceError("mesh")` for a linked object, whose keyframes would not be saved."""
    block = block_of(ob, holder)
    if ob.library is not None or (block is not None and block.library is not None):
        text = f"{ob.name} is linked, and a mouth chart on it would be lost: make it local first"
        raise AnyfaceError("mesh", text)


def check_free(channels: list[Channel]) -> None:
    """Raises `AnyfaceError("input")` if the artist has keyframes or a driver on a property.

    Curves of an earlier chart do not count, because they are removed first.
    """
    for channel in channels:
        block, entry = block_of(channel.ob, channel.holder), read(channel.ob)
        animation = block.animation_data
        ours = entry.on.get(channel.holder, {}).get("before", {}) if entry is not None else {}
        if animation is None or channel.path in ours:
            continue
        driven = any(driver.data_path == channel.path for driver in animation.drivers)
        if driven or curves.find_any(animation, channel.path) is not None:
            has = "a driver" if driven else "keyframes"
            text = f"{channel.ob.name}: {channel.label} has {has} of its own, which stay: delete"
            raise AnyfaceError("input", f"{text} them, or choose another for the chart")


def put(speaker, channels: list[Channel], frames: np.ndarray, made_property="", made_modifier=""):
    """Puts the curves of a chart on an object, which must be the same for all `channels`."""
    ob = channels[0].ob
    entry = Entry(identity.of(speaker), identity.of(ob))
    entry.made_property, entry.made_modifier = made_property, made_modifier
    for holder in {channel.holder: None for channel in channels}:
        entry.on[holder] = asdict(_put(ob, holder, channels, frames))
    ob[PROPERTY] = json.dumps(asdict(entry))


def _put(ob, holder: str, channels: list[Channel], frames: np.ndarray) -> Undo:
    block, undo = block_of(ob, holder), Undo()
    curves.own_action(block, block.animation_data.action if block.animation_data else None)
    if block.animation_data is None:
        block.animation_data_create()
        undo.made_animation_data = True
    bag = curves.own_channels(block.animation_data, f"{ob.name} {GROUP}", holder, undo)
    for channel in channels:
        if channel.holder == holder:
            undo.before[channel.path] = float(block.path_resolve(channel.path))
            curves.write(bag, channel.path, frames, channel.values, constant=True, group=GROUP)
    return undo


def take_off(ob) -> bool:
    """Removes a chart from an object and restores its properties; False where there is none."""
    entry = read(ob)
    if entry is None or ob.library is not None:
        return False
    for holder, stored in entry.on.items():
        block = block_of(ob, holder) if holder == OBJECT or ob.type == "MESH" else None
        if block is not None and block.library is None:
            _take_off(block, json_file.known_fields(Undo, stored))
    if entry.made_property and entry.made_property in ob:
        del ob[entry.made_property]
    for every in filter(None, (ob.modifiers, getattr(ob, "grease_pencil_modifiers", None))):
        if entry.made_modifier and entry.made_modifier in every:
            every.remove(every[entry.made_modifier])
    del ob[PROPERTY]
    return True


def _take_off(block, undo: Undo) -> None:
    animation = block.animation_data
    if animation is not None:
        curves.own_action(block, animation.action)
        curves.remove(animation, set(undo.before), GROUP)
        curves.drop_empty_action(animation, undo)
        curves.drop_idle_animation(block, undo.made_animation_data)
    for path, value in undo.before.items():
        _set(block, path, value)


def _set(block, path: str, value: float) -> None:
    """Sets a property by its path, unless it is gone by now."""
    try:
        now = block.path_resolve(path)
    except ValueError:
        return
    if path.endswith("]"):
        holder, _, name = path.rpartition("[")
        owner = block.path_resolve(holder) if holder else block
        owner[name.strip("\"']")] = type(now)(value)
        return
    holder, _, name = path.rpartition(".")
    setattr(block.path_resolve(holder) if holder else block, name, type(now)(value))
