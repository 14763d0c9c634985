"""Removes exactly what a take has put on a mesh."""

import bpy

from ...core.errors import AnyfaceError
from .. import outputs
from ..animation import curves, digest
from ..face import emotion_mask
from ..shape_keys import artist_keys, guard, record, slider_changes


def remove(ob) -> bool:
    """Takes the generated keys, curves, action and copies away; False where there were none.

    A generated key that was renamed belongs to the artist and stays, at rest and without its curve,
    as do keys, curves and drivers that were added since. A mesh or action that had been shared is
    shared again, unless somebody has changed the copy.
    """
    if not record.is_generated(ob):
        return False
    if ob.library is not None or ob.data.library is not None:
        raise AnyfaceError("mesh", f"{ob.name} is linked: remove the take in its own file")
    with guard.object_mode(ob), guard.selection_kept(ob):
        guard.own(ob)
        taken = record.read(ob.data.shape_keys)
        record.clear(ob.data.shape_keys)
        slider_changes.clear(ob.data.shape_keys, taken)
        _inherit(ob.data.shape_keys, taken)
        _remove_curves(ob.data.shape_keys, taken)
        shared = _original(ob.data.shape_keys, record.SHARED_MESH, taken.shared_mesh_print)
        _remove_keys(ob, taken)
        _share_mesh_again(ob, shared, taken)
    ob.data.update()
    return True


def _inherit(shape_keys, taken: record.Record) -> None:
    """What was made once for all takes is undone with the last of them."""
    kept = record.read_kept(shape_keys)
    if not kept:
        return
    for name in ("made_keys", "made_animation_data", "shared_mesh_print"):
        setattr(kept[0], name, getattr(kept[0], name) or getattr(taken, name))
        setattr(taken, name, type(getattr(taken, name))())
    record.write_kept(shape_keys, kept)


def _remove_curves(shape_keys, taken: record.Record) -> None:
    animation = shape_keys.animation_data
    if animation is None:
        return
    _rest_renamed(shape_keys, taken)
    curves.remove(animation, outputs.of_record(taken).paths(taken))
    artist_keys.restore(shape_keys, taken)
    original = _original(shape_keys, record.SHARED_ACTION, taken.shared_action_print)
    _release_action(animation, taken, original)
    curves.drop_idle_animation(shape_keys, taken.made_animation_data)


def _rest_renamed(shape_keys, taken: record.Record) -> None:
    """Brings keys of the take that have other names by now to where they were before it.

    Blender renames their curves along, and these lie in our group, in the order of the keys.
    """
    names, blocks = (*taken.keys, *taken.values), shape_keys.key_blocks
    lost = [name for name in names if name not in blocks]
    others = {curves.value_path(block.name): block for block in blocks if block.name not in names}
    found = [curve for curve in curves.of_group(shape_keys.animation_data) if lost]
    renamed = [curve for curve in found if curve.data_path in others]
    for number, curve in enumerate(renamed):
        block = others[curve.data_path]
        curves.remove(shape_keys.animation_data, {curve.data_path})
        block.value = taken.values.get(lost[number], 0.0) if len(renamed) == len(lost) else 0.0


def _original(shape_keys, name: str, wanted: str):
    """What a copy of ours has stood in for, where `wanted` says so; it is kept no longer."""
    found = shape_keys.get(name) if wanted else None
    if found is not None:
        del shape_keys[name]
    return found


def _release_action(animation, taken: record.Record, original) -> None:
    """Takes our action off; an `original` for which it stood in is played again, unless somebody
    has changed the copy."""
    action = animation.action
    if (
        original is None
        or action is None
        or taken.shared_action_print != digest.action_digest(action)
    ):
        curves.drop_empty_action(animation, taken)
        return
    animation.action = original
    if taken.made_slot:
        animation.action_slot = None
    bpy.data.actions.remove(action)


def _remove_keys(ob, taken: record.Record) -> None:
    shape_keys = ob.data.shape_keys
    outputs.of_record(taken).leave(shape_keys)
    ours = set(taken.keys) - record.all_keys(shape_keys)
    basis = shape_keys.reference_key
    others = [b for b in shape_keys.key_blocks if b.name not in ours and b != basis]
    if taken.made_keys and not others:
        _clear_keys(ob)
    else:
        for block in [b for b in shape_keys.key_blocks if b.name in ours]:
            ob.shape_key_remove(block)
    emotion_mask.drop(ob)
    emotion_mask.hide_heat(ob)


def _clear_keys(ob) -> None:
    """Takes all keys of `ob` away, and what held them.

    Blender counts one user too many of the keys of a copied mesh: they would stay, belong to
    nothing, and be complained of whenever the file is saved.
    """
    name = ob.data.shape_keys.name
    ob.shape_key_clear()
    for left in [keys for keys in bpy.data.shape_keys if keys.name == name and not keys.library]:
        if left.user is None or left.user.shape_keys != left:
            bpy.data.batch_remove([left])


def _share_mesh_again(ob, original, taken: record.Record) -> None:
    if original is None or digest.mesh_digest(ob.data) != taken.shared_mesh_print:
        return
    copy = ob.data
    ob.data = original
    if copy.users == 0:
        action = curves.action_of(copy.shape_keys)
        bpy.data.meshes.remove(copy)
        if action is not None and action.users == 0:
            bpy.data.actions.remove(action)
