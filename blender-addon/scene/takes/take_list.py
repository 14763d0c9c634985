"""Several takes on one character: one plays, the others wait as actions or as NLA strips.

The keys of a waiting take stay at 0, and its curves lie in an action of their own. A custom
property of the shape keys points to that action, so that it is saved and may be renamed.
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
    """The takes of `ob`, sorted by name, oldest first."""
    shape_keys = ob.data.shape_keys if ob is not None and ob.type == "MESH" else None
    listed = [
        Row(take_record.id, take_record.name, "NLA" if take_record.in_nla else "WAITS")
        for take_record in record.read_kept(shape_keys)
    ]
    current = record.read(shape_keys)
    if current is not None:
        listed.append(Row(current.id, current.name or _new_name(shape_keys), "PLAYS"))
    return sorted(listed, key=lambda row: (len(row.name), row.name))


def name_of(ob) -> str:
    """The name of the take that plays, or the one that it would get; empty without a take."""
    current = record.read(ob.data.shape_keys)
    return "" if current is None else current.name or _new_name(ob.data.shape_keys)


def keep(ob) -> bool:
    """Sets the current take aside, so that the next one can join it; False if there is none.

    The takes of the objects beside the face are set aside too.
    """
    others = together.others_of(ob)
    current = record.read(_editable(ob))
    waits = _keep(ob)
    if waits:
        turns.keep(ob, current.id)
    for other in others if waits else ():
        _keep(other)
    return waits


def _keep(ob) -> bool:
    shape_keys = _editable(ob)
    take_record = record.read(shape_keys)
    if take_record is None:
        return False
    cannot = outputs.of_record(take_record).cannot_wait
    if cannot:
        raise AnyfaceError("mesh", f"{ob.name}: {cannot}")
    take_record.name = take_record.name or _new_name(shape_keys)
    with guard.object_mode(ob):
        record.clear(shape_keys)
        shape_keys[_ACTION + take_record.id] = _take_out(ob, take_record)
        record.write_kept(shape_keys, [*record.read_kept(shape_keys), take_record])
    return True


def switch(ob, take_id: str) -> None:
    """Sets the current take aside and plays another one."""
    shape_keys = _editable(ob)
    current = record.read(shape_keys)
    if current is not None and current.id == take_id:
        return
    _find(shape_keys, take_id)
    keep(ob)
    _play(ob, take_id)
    turns.play(ob, take_id)
    for other, take_record in _beside(ob, take_id):
        _play(other, take_record.id)
    panel_settings.bring_back(ob)


def channels_of(shape_keys, take_record: record.Record):
    """The holder of the curves of a take, whether it plays or waits; None if it is gone."""
    action = shape_keys.get(_ACTION + take_record.id)
    if action is not None:
        return next(iter(curves.bags(action)), None)
    return curves.channels(shape_keys.animation_data)


def _beside(ob, take_id: str) -> list[tuple]:
    """The other objects that play a take of `ob`, each with its own record of the take."""
    meshes = [part for part in identity.parts_of(ob) if part.type == "MESH"]
    pairs = [
        (part, take_record)
        for part in meshes
        for take_record in record.everyone(part.data.shape_keys)
    ]
    return [(part, take_record) for part, take_record in pairs if take_record.belongs_to == take_id]


def _play(ob, take_id: str) -> None:
    shape_keys = _editable(ob)
    waiting = record.read_kept(shape_keys)
    take_record = next(take_record for take_record in waiting if take_record.id == take_id)
    record.write_kept(shape_keys, [other for other in waiting if other.id != take_id])
    with guard.object_mode(ob):
        _put_in(ob, take_record)
        record.write(shape_keys, take_record)


def rename(ob, take_id: str, name: str) -> None:
    """Renames a take, and its action if the take waits."""
    shape_keys = _editable(ob)
    name = name.strip()
    if not name:
        raise AnyfaceError("input", "take: expected a name, got nothing")
    current, waiting = record.read(shape_keys), record.read_kept(shape_keys)
    for take_record in waiting:
        if take_record.id == take_id:
            take_record.name = name
            shape_keys[_ACTION + take_record.id].name = f"{ob.name} {name}"
    record.write_kept(shape_keys, waiting)
    if current is not None and current.id == take_id:
        current.name = name
        record.write(shape_keys, current)


def push_down(ob, take_id: str) -> None:
    """Puts a take into a strip on its own NLA track, where it can be blended."""
    shape_keys = _editable(ob)
    current = record.read(shape_keys)
    if current is not None and current.id == take_id:
        keep(ob)
    for other, take_record in _beside(ob, take_id):
        _push(other, take_record.id)
    _push(ob, take_id)


def _push(ob, take_id: str) -> None:
    shape_keys = _editable(ob)
    waiting = record.read_kept(shape_keys)
    take_record = next((take_record for take_record in waiting if take_record.id == take_id), None)
    if take_record is None or take_record.in_nla:
        return
    nla.push(ob, take_record, shape_keys[_ACTION + take_record.id])
    take_record.in_nla = True
    record.write_kept(shape_keys, waiting)


def delete(ob, take_id: str) -> None:
    """Deletes a take with its keys, its action and its strip; the others stay."""
    shape_keys = _editable(ob)
    current = record.read(shape_keys)
    _find(shape_keys, take_id)
    switch(ob, take_id)
    together.remove_all(ob)
    if current is not None and current.id != take_id:
        switch(ob, current.id)


def _take_out(ob, take_record: record.Record):
    """Moves the curves of a take off the character; returns the action that holds them now."""
    shape_keys = ob.data.shape_keys
    animation = shape_keys.animation_data
    paths = outputs.of_record(take_record).paths(take_record)
    action = animation.action
    alone = take_record.made_action and all(
        curve.data_path in paths for bag in curves.bags(action) for curve in bag.fcurves
    )
    if alone:
        animation.action = None
    else:
        alone_action, bag = curves.new_action(take_record.name)
        curves.copy_paths(action, bag, paths)
        curves.remove(animation, paths)
        artist_keys.restore(shape_keys, take_record)
        take_record.made_action, action = False, alone_action
    action.name = f"{ob.name} {take_record.name}"
    for name in take_record.keys:
        if name in shape_keys.key_blocks:
            shape_keys.key_blocks[name].value = 0.0
    for name, value in take_record.values.items():
        if name in shape_keys.key_blocks:
            shape_keys.key_blocks[name].value = value
    return action


def _put_in(ob, take_record: record.Record) -> None:
    """Gives the character the curves of a waiting take."""
    shape_keys = ob.data.shape_keys
    action = shape_keys.get(_ACTION + take_record.id)
    if action is None:
        raise AnyfaceError("mesh", f"{take_record.name}: its action was deleted")
    del shape_keys[_ACTION + take_record.id]
    animation = shape_keys.animation_data or shape_keys.animation_data_create()
    nla.leave(shape_keys, take_record, action)
    take_record.in_nla = False
    if take_record.values:
        artist_keys.note_values(shape_keys, take_record)
    if animation.action is None:
        curves.assign(animation, action)
        take_record.made_action = True
        return
    paths = outputs.of_record(take_record).paths(take_record)
    curves.copy_paths(action, curves.key_channels(ob, take_record), paths)
    curves.delete_action(action)


def _new_name(shape_keys) -> str:
    names = {take_record.name for take_record in record.everyone(shape_keys)}
    return next(name for n in range(1, 10_000) if (name := f"Take {n}") not in names)


def _find(shape_keys, take_id: str) -> None:
    if all(take_record.id != take_id for take_record in record.everyone(shape_keys)):
        raise AnyfaceError("input", f"take: this object has no take {take_id!r}")


def _editable(ob):
    guard.check_editable(ob)
    guard.unshare(ob)
    return ob.data.shape_keys
