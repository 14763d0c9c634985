"""Checks a mesh before shape keys are written, and protects what the artist has there."""

from contextlib import contextmanager

import bpy

from ...core.errors import AnyfaceError
from ..animation import curves, digest
from . import record


def check_editable(ob) -> None:
    """Raises `AnyfaceError("mesh")` with the remedy where relative keys cannot be written."""
    check_local(ob)
    # Absolute keys play one after the other, so relative keys cannot be added to them.
    if ob.data.shape_keys is None or ob.data.shape_keys.use_relative:
        return
    if own_keys(ob.data.shape_keys):
        raise AnyfaceError(
            "mesh",
            f"{ob.name}: its shape keys are absolute, and keys that add up would not show: "
            "turn Relative on (Object Data > Shape Keys), or remove these keys",
            ("turn_relative_on",),
        )


def check_local(ob) -> None:
    """Raises `AnyfaceError("mesh")` with the remedy where `ob` cannot get keys of any kind."""
    check_mesh(ob)
    for block in (ob, ob.data):
        if block.library is not None:
            raise AnyfaceError(
                "mesh",
                f"{block.name} is linked from {block.library.filepath}, and keys added to linked "
                "data are lost on save: make object and mesh local (Object > Relations > Make "
                "Local), open that file, or make a library "
                "override (Object > Library Override > Make) and choose Cache File",
                ("use_cache", "make_local"),
            )
        if block.override_library is not None and block is ob.data:
            raise AnyfaceError(
                "mesh",
                f"the mesh {block.name} is a library override, and keys added to it are lost on "
                "save: choose Cache File, or make the mesh local (Object > Relations > Make Local)",
                ("use_cache", "make_local"),
            )
    _check_animation(ob)


def check_mesh(ob) -> None:
    """Raises `AnyfaceError("mesh")` where `ob` is no mesh object."""
    if ob is None or ob.type != "MESH" or ob.data is None:
        what = "nothing" if ob is None else f"{ob.name} ({ob.type.lower()})"
        raise AnyfaceError("mesh", f"expected a mesh object, got {what}: pick the face mesh")


def check_size(ob, vertices: int) -> None:
    """Raises `AnyfaceError("mesh")` where the mesh has changed since it was read."""
    if vertices != len(ob.data.vertices):
        raise AnyfaceError(
            "mesh",
            f"{ob.name} changed while the take was made: expected {vertices} vertices, "
            f"got {len(ob.data.vertices)}",
        )


def own_keys(shape_keys) -> list[str]:
    """Names of the keys that are not ours; empty where we have added all."""
    if shape_keys is None:
        return []
    ours = record.all_keys(shape_keys)
    names = [block.name for block in shape_keys.key_blocks if block.name not in ours]
    # A Basis that we made counts as ours unless the artist has added keys.
    basis_is_ours = any(take_record.made_keys for take_record in record.everyone(shape_keys))
    return [] if basis_is_ours and len(names) == 1 else names


def notes(ob) -> list[str]:
    """Notes about settings of the artist that hide the motion."""
    messages = []
    if ob.show_only_shape_key:
        messages.append(f"{ob.name} shows its active shape key alone: turn Solo off to see it move")
    if ob.hide_viewport or ob.hide_get():
        messages.append(f"{ob.name} is hidden")
    return messages


def _check_animation(ob) -> None:
    shape_keys = ob.data.shape_keys
    animation = shape_keys.animation_data if shape_keys is not None else None
    if animation is None:
        return
    if animation.use_tweak_mode:
        text = f"{ob.name}: leave the NLA strip's tweak mode (Tab) first"
        raise AnyfaceError("mesh", text, ("leave_tweak_mode",))
    action = animation.action
    if action is not None and action.library is not None:
        raise AnyfaceError(
            "mesh",
            f"{ob.name}: its shape keys use the linked action {action.name}: make it local first",
        )


def unshare(ob) -> None:
    """Gives `ob` a mesh and actions of its own, where other objects use them too."""
    mesh = ob.data
    if not record.everyone(mesh.shape_keys):
        return
    if mesh.users - mesh.use_fake_user > 1:
        with object_mode(ob):
            ob.data = mesh.copy()
    shape_keys = ob.data.shape_keys
    actions = [value for name, value in shape_keys.items() if name not in record.ORIGINALS]
    actions = [action for action in actions if isinstance(action, bpy.types.Action)]
    for action in {*actions, curves.action_of(shape_keys)}:
        curves.own_action(shape_keys, action)


def make_single_user(ob, take_record: record.Record) -> None:
    """Gives `ob` its own mesh, its keys their own action, and a Basis where it has no keys.

    Properties of the shape keys point to the originals, so that Remove can go back to them. The
    originals stay as they are, even if other objects that use them are animated meanwhile.
    """
    mesh, action = ob.data, curves.action_of(ob.data.shape_keys)
    shared = mesh.users - mesh.use_fake_user > 1
    if shared:
        ob.data = mesh.copy()
        take_record.shared_mesh_print = digest.mesh_digest(ob.data)
    if action is not None and action.users - action.use_fake_user > 1:
        copy = action.copy()
        ob.data.shape_keys.animation_data.action = copy
        take_record.shared_action_print = digest.action_digest(copy)
    if ob.data.shape_keys is None:
        ob.shape_key_add(name="Basis", from_mix=False)
        take_record.made_keys = True
    if shared:
        ob.data.shape_keys[record.SHARED_MESH] = mesh
    if take_record.shared_action_print:
        ob.data.shape_keys[record.SHARED_ACTION] = action


@contextmanager
def object_mode(ob):
    """Leaves edit or sculpt mode while keys are written, and returns to it afterwards.

    Edit mode has a second copy of the mesh, which would overwrite keys added meanwhile.
    """
    before = ob.mode
    if before in ("OBJECT", "POSE"):
        yield
        return
    with bpy.context.temp_override(active_object=ob, object=ob):
        bpy.ops.object.mode_set(mode="OBJECT")
    try:
        yield
    finally:
        with bpy.context.temp_override(active_object=ob, object=ob):
            bpy.ops.object.mode_set(mode=before)


@contextmanager
def selection_kept(ob):
    """Keeps the active shape key of `ob` active while keys are added or removed."""
    name = ob.active_shape_key.name if ob.active_shape_key is not None else ""
    index = ob.active_shape_key_index
    try:
        yield
    finally:
        blocks = ob.data.shape_keys.key_blocks if ob.data.shape_keys is not None else ()
        position = blocks.find(name) if name and blocks else -1
        ob.active_shape_key_index = (
            position if position >= 0 else min(index, max(len(blocks) - 1, 0))
        )
