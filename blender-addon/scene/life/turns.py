"""Records what takes put on the objects that they turn, and removes it again.

A custom property of each turned object stores the record, beside the id of the character. Remove
deletes exactly what the record lists.
"""

import json
from dataclasses import asdict, dataclass, field

import bpy
import numpy as np

from ...core import json_file
from ...core.errors import AnyfaceError
from .. import identity
from ..animation import curves
from . import turning

# A property of objects that a character turns: a list of `Entry`.
ENTRIES = "anyface_turned"
# Prefix of properties that point to an action: one of a waiting take, or one that no object plays.
_ACTION = "anyface_turned_"


@dataclass
class Entry:
    """The record of what a character's take has put on an object.

    `owner` is the id of the character. `take` is the id of a waiting take; it is empty for the take
    that plays. `before` holds the earlier values by data path. The `made_*` fields say what was
    added for the take and must be removed with it.
    """

    owner: str
    take: str = ""
    before: dict[str, list[float]] = field(default_factory=dict)
    made_action: bool = False
    made_slot: bool = False
    made_animation_data: bool = False


def put(ob, other, channels: list[turning.Channel], at: np.ndarray) -> None:
    """Puts the curves of a take of `ob` on `other`; `at` `[T + 2]` are scene frames."""
    identity.of(other)
    entry = Entry(identity.of(ob), before={channel.path: channel.before for channel in channels})
    bag = _channels(other, entry)
    for channel in channels:
        for index, column in enumerate(channel.values.T):
            curves.write(bag, channel.path, at, column, index=index)
    _store(other, [*_entries(other), entry])


def put_alone(ob, action) -> None:
    """Makes an action that no object plays part of the playing take of `ob`."""
    ob[_ACTION + "now"] = action


def paths_of(ob, other) -> set[str]:
    """The data paths of `other` that the playing take of `ob` already animates."""
    return {path for entry in _of(ob, _entries(other), "") for path in entry.before}


def release(ob) -> None:
    """Removes everything that the playing take of `ob` put on objects, and restores them."""
    owned = _owned(ob)
    for other, entries in owned:
        for entry in _of(ob, entries, ""):
            entries = [other_entry for other_entry in entries if other_entry is not entry]
            _inherit(entries, entry)
            _take_off(other, entry)
        _store(other, entries)
    curves.delete_action(ob.pop(_ACTION + "now", None))
    if owned:
        # The caller reads where the released objects stand.
        bpy.context.view_layer.update()


def keep(ob, take_id: str) -> None:
    """Sets the playing take aside: moves its curves to an action that a property points to."""
    for other, entries in _owned(ob):
        for entry in _of(ob, entries, ""):
            action, bag = curves.new_action(f"{other.name} {take_id}", "OBJECT")
            curves.copy_paths(other.animation_data.action, bag, set(entry.before))
            _inherit([other_entry for other_entry in entries if other_entry is not entry], entry)
            _take_off(other, entry)
            entry.take = take_id
            other[_ACTION + take_id] = action
            _store(other, entries)
    if _ACTION + "now" in ob:
        ob[_ACTION + "own_" + take_id] = ob.pop(_ACTION + "now")


def play(ob, take_id: str) -> None:
    """Makes a waiting take play again."""
    for other, entries in _owned(ob):
        for entry in _of(ob, entries, take_id):
            action = other.pop(_ACTION + take_id)
            entry.take = ""
            if action is not None:
                curves.copy_paths(action, _channels(other, entry), set(entry.before))
                curves.delete_action(action)
            _store(other, entries)
    if _ACTION + "own_" + take_id in ob:
        ob[_ACTION + "now"] = ob.pop(_ACTION + "own_" + take_id)


def follow(copy, copies: dict[str, list]) -> None:
    """Assigns the curves on a copied object to the copy of its character.

    `copies` maps old ids to the copied objects. If the character was not copied, the curves belong
    to the artist from now on.
    """
    entries = []
    for entry in _entries(copy):
        faces = copies.get(entry.owner, [])
        owners = faces if len(faces) == 1 else [face for face in faces if _names(face, copy)]
        if owners:
            entry.owner = identity.known(owners[0])
            entries.append(entry)
    if ENTRIES in copy:
        _store(copy, entries)


def _names(face, other) -> bool:
    """Whether the settings of `face` refer to `other`."""
    stored = face.anyface_life_settings
    kinds = [prop.identifier for prop in stored.bl_rna.properties if prop.type == "POINTER"]
    pointers = [getattr(stored, kind) for kind in kinds]
    return other in [*pointers, *(row.object for row in face.anyface_face.parts)]


def _channels(other, entry: Entry):
    """Where to put curves on an object: in the artist's action, or in one of ours."""
    if other.library is not None:
        raise AnyfaceError("mesh", f"{other.name} is linked: pick an object of this file")
    if other.animation_data is None:
        other.animation_data_create()
        entry.made_animation_data = True
    action = other.animation_data.action
    if _entries(other):
        curves.own_action(other, action)
        action = other.animation_data.action
    if action is not None and not curves.LAYERED and action.users - action.use_fake_user > 1:
        raise AnyfaceError("mesh", f"{other.name} shares its action: make it single-user first")
    return curves.own_channels(other.animation_data, f"{other.name} Anyface", "OBJECT", entry)


def _take_off(other, entry: Entry) -> None:
    animation = other.animation_data
    if animation is not None:
        curves.own_action(other, animation.action)
        curves.remove(animation, set(entry.before))
        curves.drop_empty_action(animation, entry)
        curves.drop_idle_animation(other, entry.made_animation_data)
    entry.made_action = entry.made_slot = entry.made_animation_data = False
    turning.put_back(other, entry.before)


def _of(ob, entries: list[Entry], take_id: str) -> list[Entry]:
    """The entries that belong to one take of `ob`."""
    return [e for e in entries if e.owner == identity.known(ob) and e.take == take_id]


def _inherit(others: list[Entry], gone: Entry) -> None:
    """Hands the `made_*` flags of `gone` to another playing take that uses the same parts."""
    playing = [entry for entry in others if not entry.take]
    if not playing:
        return
    for name in ("made_action", "made_slot", "made_animation_data"):
        setattr(playing[0], name, getattr(playing[0], name) or getattr(gone, name))
        setattr(gone, name, False)


def _owned(ob) -> list[tuple]:
    """The objects that takes of `ob` turn, each with all its entries."""
    owner = identity.known(ob)
    if not owner:
        return []
    pairs = [(other, _entries(other)) for other in bpy.data.objects]
    return [(o, entries) for o, entries in pairs if any(e.owner == owner for e in entries)]


def _entries(other) -> list[Entry]:
    return json_file.records(Entry, other.get(ENTRIES))


def _store(other, entries: list[Entry]) -> None:
    if entries:
        other[ENTRIES] = json.dumps([asdict(entry) for entry in entries])
    elif ENTRIES in other:
        del other[ENTRIES]
