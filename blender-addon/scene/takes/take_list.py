"""Several takes on one character: one plays, the others wait as actions or lie in the NLA.

A take that waits keeps its keys, at 0, and its curves in an action of its own; a custom property
of the shape keys points to that action, so that it is saved and may be renamed.
"""

from dataclasses import dataclass

from ...core.errors import AnyfaceError
from .. import identity, outputs
from ..animation import curves
from ..life import turns
from ..shape_keys import artist_keys, guard, record
from . import nla, panel_settings, together

_ACTION = "anyface_take_"


@dataclass
class Row:
    """A take in the list; `state` is "PLAYS", "WAITS" or "NLA"."""

    id: str
    name: str
    state: str


def rows(ob) -> list[Row]:
    """The takes of `ob`, oldest first by name."""
    shape_keys = ob.data.shape_keys if ob is not None and ob.type == "MESH" else None
    found = [
        Row(taken.id, taken.name, "NLA" if taken.in_nla else "WAITS")
        for taken in record.read_kept(shape_keys)
    ]
    current = record.read(shape_keys)
    if current is not None:
        found.append(Row(current.id, current.name or _new_name(shape_keys), "PLAYS"))
    return sorted(found, key=lambda row: (len(row.name), row.name))


def keep(ob) -> bool:
    """The current take waits from now on, and the next one goes beside it; False without one.

    So do the takes of the objects beside the face.
    """
    others = together.others_of(ob)
    current = record.read(_editable(ob))
    kept = _keep(ob)
    if kept:
        turns.keep(ob, current.id)
    for other in others if kept else ():
        _keep(other)
    return kept


def _keep(ob) -> bool:
    shape_keys = _editable(ob)
    taken = record.read(shape_keys)
    if taken is None:
        return False
    cannot = outputs.of_record(taken).cannot_wait
    if cannot:
        raise AnyfaceError("mesh", f"{ob.name}: {cannot}")
    taken.name = taken.name or _new_name(shape_keys)
    with guard.object_mode(ob):
        record.clear(shape_keys)
        shape_keys[_ACTION + taken.id] = _take_out(ob, taken)
        record.write_kept(shape_keys, [*record.read_kept(shape_keys), taken])
    return True


def switch(ob, take_id: str) -> None:
    """Makes a take the one that plays."""
    shape_keys = _editable(ob)
    current = record.read(shape_keys)
    if current is not None and current.id == take_id:
        return
    _find(shape_keys, take_id)
    keep(ob)
    _play(ob, take_id)
    turns.play(ob, take_id)
    for other, taken in _beside(ob, take_id):
        _play(other, taken.id)
    panel_settings.bring_back(ob)


def channels_of(shape_keys, taken: record.Record):
    """What holds the curves of a take, whether it plays or waits; None where that is gone."""
    action = shape_keys.get(_ACTION + taken.id)
    if action is not None:
        return next(iter(curves.bags(action)), None)
    return curves.channels(shape_keys.animation_data)


def _beside(ob, take_id: str) -> list[tuple]:
    """The objects that have a part of a take of `ob`, and its record there."""
    meshes = [part for part in identity.parts_of(ob) if part.type == "MESH"]
    found = [(part, taken) for part in meshes for taken in record.everyone(part.data.shape_keys)]
    return [(part, taken) for part, taken in found if taken.belongs_to == take_id]


def _play(ob, take_id: str) -> None:
    shape_keys = _editable(ob)
    kept = record.read_kept(shape_keys)
    taken = next(taken for taken in kept if taken.id == take_id)
    record.write_kept(shape_keys, [other for other in kept if other.id != take_id])
    with guard.object_mode(ob):
        _put_in(ob, taken)
        record.write(shape_keys, taken)


def rename(ob, take_id: str, name: str) -> None:
    """Gives a take, and its action, another name."""
    shape_keys = _editable(ob)
    name = name.strip()
    if not name:
        raise AnyfaceError("input", "take: expected a name, got nothing")
    current, kept = record.read(shape_keys), record.read_kept(shape_keys)
    for taken in kept:
        if taken.id == take_id:
            taken.name = name
            shape_keys[_ACTION + taken.id].name = f"{ob.name} {name}"
    record.write_kept(shape_keys, kept)
    if current is not None and current.id == take_id:
        current.name = name
        record.write(shape_keys, current)


def push_down(ob, take_id: str) -> None:
    """Puts a take as a strip on an NLA track of its own, where it can be blended."""
    shape_keys = _editable(ob)
    current = record.read(shape_keys)
    if current is not None and current.id == take_id:
        keep(ob)
    for other, taken in _beside(ob, take_id):
        _push(other, taken.id)
    _push(ob, take_id)


def _push(ob, take_id: str) -> None:
    shape_keys = _editable(ob)
    kept = record.read_kept(shape_keys)
    taken = next((taken for taken in kept if taken.id == take_id), None)
    if taken is None or taken.in_nla:
        return
    nla.push(ob, taken, shape_keys[_ACTION + taken.id])
    taken.in_nla = True
    record.write_kept(shape_keys, kept)


def delete(ob, take_id: str) -> None:
    """Takes a take away with its keys, its action and its strip; the others stay."""
    shape_keys = _editable(ob)
    current = record.read(shape_keys)
    _find(shape_keys, take_id)
    switch(ob, take_id)
    together.remove_all(ob)
    if current is not None and current.id != take_id:
        switch(ob, current.id)


def _take_out(ob, taken: record.Record):
    """Takes the curves off the character; the action in which they now are."""
    shape_keys = ob.data.shape_keys
    animation = shape_keys.animation_data
    paths = outputs.of_record(taken).paths(taken)
    action = animation.action
    alone = taken.made_action and all(
        curve.data_path in paths for bag in curves.bags(action) for curve in bag.fcurves
    )
    if alone:
        animation.action = None
    else:
        alone_action, bag = curves.new_action(taken.name)
        curves.copy_paths(action, bag, paths)
        curves.remove(animation, paths)
        artist_keys.restore(shape_keys, taken)
        taken.made_action, action = False, alone_action
    action.name = f"{ob.name} {taken.name}"
    for name in taken.keys:
        if name in shape_keys.key_blocks:
            shape_keys.key_blocks[name].value = 0.0
    for name, value in taken.values.items():
        if name in shape_keys.key_blocks:
            shape_keys.key_blocks[name].value = value
    return action


def _put_in(ob, taken: record.Record) -> None:
    """Gives the character the curves of a take that waits."""
    shape_keys = ob.data.shape_keys
    action = shape_keys.get(_ACTION + taken.id)
    if action is None:
        raise AnyfaceError("mesh", f"{taken.name}: its action was deleted")
    del shape_keys[_ACTION + taken.id]
    animation = shape_keys.animation_data or shape_keys.animation_data_create()
    nla.leave(shape_keys, taken, action)
    taken.in_nla = False
    if taken.values:
        artist_keys.note_values(shape_keys, taken)
    if animation.action is None:
        curves.assign(animation, action)
        taken.made_action = True
        return
    paths = outputs.of_record(taken).paths(taken)
    curves.copy_paths(action, curves.key_channels(ob, taken), paths)
    curves.delete_action(action)


def _new_name(shape_keys) -> str:
    names = {taken.name for taken in record.everyone(shape_keys)}
    return next(name for n in range(1, 10_000) if (name := f"Take {n}") not in names)


def _find(shape_keys, take_id: str) -> None:
    if all(taken.id != take_id for taken in record.everyone(shape_keys)):
        raise AnyfaceError("input", f"take: expected one that is there, got {take_id!r}")


def _editable(ob):
    guard.check_editable(ob)
    guard.own(ob)
    return ob.data.shape_keys
