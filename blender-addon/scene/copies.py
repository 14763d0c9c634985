"""Recognises duplicates: each gets its own identity, and objects copied together stay together.

If teeth are duplicated along with a face, Blender itself updates the list of parts. If a head is
duplicated alone, its teeth stay with the original head.
"""

import bpy
from bpy.app.handlers import persistent

from . import identity
from .life import turns
from .rig_controls import control_actions

# Property groups in which an override has values of its own.
_GROUPS = (
    "anyface", "anyface_audio", "anyface_face", "anyface_life_settings", "anyface_output",
    "anyface_controls", "anyface_mouth_chart",
)  # fmt: skip


def settle() -> None:
    """Finds the copies made since the last call, and gives them identities of their own."""
    bearers = {}
    for ob in bpy.data.objects:
        _prepare_override(ob)
        object_identity = identity.read(ob) if ob.library is None else None
        if object_identity is not None:
            bearers.setdefault(object_identity.id, []).append((ob, object_identity))
    originals, copies = {}, {}
    for object_id, members in bearers.items():
        originals[object_id] = _original(members)
        duplicates = [ob for ob, _ in members if ob != originals[object_id]]
        if duplicates:
            copies[object_id] = sorted(duplicates, key=lambda ob: ob.name)
    for ob in originals.values():
        if ob is not None:
            identity.write(ob, identity.read(ob))
    if copies:
        _renew(copies, originals)


def _prepare_override(ob) -> None:
    """Reads our property groups on the linked object, which creates them.

    Blender compares an override with its linked object value by value only where both have the
    group.
    """
    linked = ob.override_library.reference if ob.override_library is not None else None
    for name in _GROUPS if linked is not None else ():
        getattr(linked, name)


def _original(members: list[tuple]):
    """The object that the identity was written for; None if only copies of it are left."""
    for ob, object_identity in members:
        if identity.is_current(ob, object_identity):
            return ob
    unsure = [pair for pair in members if not identity.is_copy(*pair)]
    named = [ob for ob, object_identity in unsure if object_identity.name == ob.name]
    named += sorted((ob for ob, _ in unsure), key=lambda ob: ob.name)
    return named[0] if named else None


def _renew(copies: dict[str, list], originals: dict) -> None:
    """Gives copies identities of their own; `copies` lists them by the id that they carry."""
    before = {ob: identity.read(ob) for duplicates in copies.values() for ob in duplicates}
    for ob in before:
        identity.write(ob, identity.Identity())
    for ob, object_identity in before.items():
        face = _face_of(ob, originals.get(object_identity.id), copies.get(object_identity.face, []))
        if face is not None:
            identity.join(face, ob)
    for ob in before:
        turns.follow(ob, copies)
        control_actions.follow(ob, copies)
        _drop_foreign_parts(ob)


def _face_of(part, original, faces: list):
    """The face among the copied `faces` that the copy `part` belongs to, or None."""
    for face in faces:
        if any(row.object == part for row in face.anyface_face.parts):
            return face
    # If a script has copied the objects, the copied face still points to the original part.
    for face in faces:
        for row in face.anyface_face.parts if original is not None else ():
            if row.object == original:
                row.object, row.name = part, part.name
                return face
    return None


def _drop_foreign_parts(face) -> None:
    rows = face.anyface_face.parts
    # An override keeps the rows from its library, but Generate leaves such parts out.
    for at in reversed(range(len(rows) if face.override_library is None else 0)):
        owner = identity.face_of(rows[at].object) if rows[at].object is not None else None
        if owner not in (None, face):
            rows.remove(at)


@persistent
def _on_load(*_) -> None:
    identity.begin_session()
    settle()


@persistent
def _on_save(*_) -> None:
    settle()


def register() -> None:
    """Watches files being opened and saved."""
    bpy.app.handlers.load_post.append(_on_load)
    bpy.app.handlers.save_pre.append(_on_save)


def unregister() -> None:
    """Stops watching."""
    bpy.app.handlers.load_post.remove(_on_load)
    bpy.app.handlers.save_pre.remove(_on_save)
