"""Removes exactly what a take has put on a mesh."""

import bpy

from ...core.errors import AnyfaceError
from .. import outputs
from ..animation import curves, digest
from ..face import emotion_mask
from ..shape_keys import artist_keys, guard, record, slider_changes


def remove(ob) -> bool:
    """Removes the generated keys, curves, action and copies; False if there were none.

    A generated key that was renamed belongs to the artist: it stays, at rest and without its curve.
    Keys, curves and drivers that were added since stay too. A mesh or action that had been shared
    is shared again, unless somebody has changed the copy.
    """
    if not record.is_generated(ob):
        return False
    if ob.library is not None or ob.data.library is not None:
        raise AnyfaceError("mesh", f"{ob.name} is linked: remove the take in its own file")
    with guard.object_mode(ob), guard.selection_kept(ob):
        guard.unshare(ob)
        take_record = record.read(ob.data.shape_keys)
        record.clear(ob.data.shape_keys)
        slider_changes.clear(ob.data.shape_keys, take_record)
        _inherit(ob.data.shape_keys, take_record)
        _remove_curves(ob.data.shape_keys, take_record)
        shared = _original(ob.data.shape_keys, record.SHARED_MESH, take_record.shared_mesh_print)
        _remove_keys(ob, take_record)
        _share_mesh_again(ob, shared, take_record)
    ob.data.update()
    return True


def _inherit(shape_keys, take_record: record.Record) -> None:
    """Hands changes made once for all takes to a waiting take, so the last take undoes them."""
    waiting = record.read_kept(shape_keys)
    if not waiting:
        return
    for name in ("made_keys", "made_animation_data", "shared_mesh_print"):
        setattr(waiting[0], name, getattr(waiting[0], name) or getattr(take_record, name))
        setattr(take_record, name, type(getattr(take_record, name))())
    record.write_kept(shape_keys, waiting)


def _remove_curves(shape_keys, take_record: record.Record) -> None:
    animation = shape_keys.animation_data
    if animation is None:
        return
    _rest_renamed(shape_keys, take_record)
    curves.remove(animation, outputs.of_record(take_record).paths(take_record))
    artist_keys.restore(shape_keys, take_record)
    original = _original(shape_keys, record.SHARED_ACTION, take_record.shared_action_print)
    _release_action(animation, take_record, original)
    curves.drop_idle_animation(shape_keys, take_record.made_animation_data)


def _rest_renamed(shape_keys, take_record: record.Record) -> None:
    """Resets renamed keys of the take to the values that they had before it.

    Blender renames their curves too. The curves lie in our group, in the order of the keys.
    """
    names, blocks = (*take_record.keys, *take_record.values), shape_keys.key_blocks
    lost = [name for name in names if name not in blocks]
    others = {curves.value_path(block.name): block for block in blocks if block.name not in names}
    our_curves = [curve for curve in curves.of_group(shape_keys.animation_data) if lost]
    renamed = [curve for curve in our_curves if curve.data_path in others]
    for number, curve in enumerate(renamed):
        block = others[curve.data_path]
        curves.remove(shape_keys.animation_data, {curve.data_path})
        block.value = (
            take_record.values.get(lost[number], 0.0) if len(renamed) == len(lost) else 0.0
        )


def _original(shape_keys, name: str, copy_print: str):
    """The original of our copy, or None if `copy_print` is empty. Deletes the pointer to it."""
    original = shape_keys.get(name) if copy_print else None
    if original is not None:
        del shape_keys[name]
    return original


def _release_action(animation, take_record: record.Record, original) -> None:
    """Removes our action.

    If it is a copy of `original`, the original plays again, unless somebody has changed the copy.
    """
    action = animation.action
    if (
        original is None
        or action is None
        or take_record.shared_action_print != digest.action_digest(action)
    ):
        curves.drop_empty_action(animation, take_record)
        return
    animation.action = original
    if take_record.made_slot:
        animation.action_slot = None
    bpy.data.actions.remove(action)


def _remove_keys(ob, take_record: record.Record) -> None:
    shape_keys = ob.data.shape_keys
    outputs.of_record(take_record).leave(shape_keys)
    ours = set(take_record.keys) - record.all_keys(shape_keys)
    basis = shape_keys.reference_key
    others = [b for b in shape_keys.key_blocks if b.name not in ours and b != basis]
    if take_record.made_keys and not others:
        _clear_keys(ob)
    else:
        for block in [b for b in shape_keys.key_blocks if b.name in ours]:
            ob.shape_key_remove(block)
    emotion_mask.drop(ob)
    emotion_mask.hide_heat(ob)


def _clear_keys(ob) -> None:
    """Removes all keys of `ob`, and their data-block.

    Blender counts one user too many for the keys of a copied mesh. The keys would stay without an
    owner, and Blender would warn about them at every save.
    """
    name = ob.data.shape_keys.name
    ob.shape_key_clear()
    for left in [keys for keys in bpy.data.shape_keys if keys.name == name and not keys.library]:
        if left.user is None or left.user.shape_keys != left:
            bpy.data.batch_remove([left])


def _share_mesh_again(ob, original, take_record: record.Record) -> None:
    if original is None or digest.mesh_digest(ob.data) != take_record.shared_mesh_print:
        return
    copy = ob.data
    ob.data = original
    if copy.users == 0:
        action = curves.action_of(copy.shape_keys)
        bpy.data.meshes.remove(copy)
        if action is not None and action.users == 0:
            bpy.data.actions.remove(action)
