"""Tells an object from its copies.

Teeth, turned objects and tables store the id of the face to which they belong. A duplicate carries
the same id as its original. So every object also carries a stamp that fits only itself: the number
that Blender gives it while a file is open, and its name, which survives on disk.
"""

import json
import uuid
from dataclasses import asdict, dataclass, field

import bpy
from bpy.props import StringProperty

from ..core import json_file
from ..core.errors import AnyfaceError

PROPERTY = "anyface_identity"
# Every file that is opened starts a new session. Numbers of objects are valid for one session.
_session = ""


@dataclass
class Identity:
    """The `id` of an object, the id of the `face` to which it belongs, and its stamp."""

    id: str = field(default_factory=lambda: uuid.uuid4().hex[:12])
    face: str = ""
    session: str = ""
    number: int = 0
    name: str = ""


def read(ob) -> Identity | None:
    """The identity stored on an object, even if the object is a copy; None if there is none."""
    return json_file.record(Identity, getattr(ob, PROPERTY, ""))


def write(ob, identity: Identity) -> None:
    """Stores an identity with the stamp of `ob`."""
    identity.session, identity.number, identity.name = _session, number(ob), ob.name
    text = json.dumps(asdict(identity))
    if getattr(ob, PROPERTY) != text and not ob.is_property_readonly(PROPERTY):
        setattr(ob, PROPERTY, text)


def number(ob) -> int:
    """The number of an object, which survives renaming; valid until another file is opened."""
    return getattr(ob, "session_uid", 0)


def with_number(object_number: int, name: str):
    """The object with that number, even if it was renamed; None if it is gone.

    In Blender versions that do not number objects, finds it by its `name`.
    """
    if not object_number:
        return bpy.data.objects.get(name)
    return next((ob for ob in bpy.data.objects if number(ob) == object_number), None)


def is_copy(ob, identity: Identity) -> bool:
    """True if it is certain that `identity` was written on another object than `ob`.

    Either it was written since the file was opened, and carries the number of another object, or it
    comes from the linked object that `ob` overrides.
    """
    linked = ob.override_library.reference if ob.override_library is not None else None
    inherited = read(linked) if linked is not None else None
    if inherited is not None and inherited.id == identity.id:
        return True
    return identity.session == _session and identity.number != number(ob)


def is_current(ob, identity: Identity) -> bool:
    """True if `identity` was written on `ob` itself since the file was opened."""
    return identity.session == _session and not is_copy(ob, identity)


def known(ob) -> str:
    """The id of `ob`; empty if it has none, or only that of the object it was copied from."""
    identity = read(ob)
    return "" if identity is None or is_copy(ob, identity) else identity.id


def of(ob) -> str:
    """The id of `ob`; creates one if `ob` has none of its own, and makes an override editable.

    Raises `AnyfaceError("mesh")` for objects that cannot store one, such as linked ones.
    """
    if ob.library is not None:
        raise AnyfaceError("mesh", f"{ob.name} is linked: pick an object of this file")
    if ob.override_library is not None and ob.override_library.is_system_override:
        # *Make Library Override* leaves the objects around the one it was used on so, and Blender
        # keeps no change of theirs.
        ob.override_library.is_system_override = False
    if not known(ob):
        write(ob, Identity())
    identity = read(ob)
    if identity is None:
        text = f"{ob.name} stores nothing of Anyface's: make it local, or editable as an override"
        raise AnyfaceError("mesh", text)
    return identity.id


def join(face, part) -> None:
    """Makes `part` belong to `face`."""
    owner = of(face)
    of(part)
    identity = read(part)
    if identity.face != owner:
        identity.face = owner
        write(part, identity)


def parts_of(face) -> list:
    """The objects that belong to `face`."""
    face_id = known(face)
    return [ob for ob in _local() if face_id and ob != face and _face(ob) == face_id]


def face_of(part):
    """The face to which an object belongs, or None."""
    face_id = _face(part)
    return next((ob for ob in _local() if face_id and known(ob) == face_id), None)


def _face(ob) -> str:
    return read(ob).face if known(ob) else ""


def _local() -> list:
    return [ob for ob in bpy.data.objects if ob.library is None]


def begin_session() -> None:
    """Starts a session for a newly opened file, in which objects have new numbers."""
    global _session
    _session = uuid.uuid4().hex[:12]


def register() -> None:
    """Adds the property to objects; overrides can have their own value."""
    begin_session()
    bpy.types.Object.anyface_identity = StringProperty(
        options={"HIDDEN"}, override={"LIBRARY_OVERRIDABLE"}
    )


def unregister() -> None:
    """Removes the property; its values stay in the file."""
    del bpy.types.Object.anyface_identity
