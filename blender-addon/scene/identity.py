"""Who an object is, told from its copies.

What belongs to a face (its teeth, what its head and eyes turn, its table) names it by an id. A
duplicate carries the same words; so every object bears a stamp beside its id that holds for itself
alone: the number that Blender gives it for as long as a file is open, and its name on disk.
"""

import json
import uuid
from dataclasses import asdict, dataclass, field

import bpy
from bpy.props import StringProperty

from ..core import json_file
from ..core.errors import AnyfaceError

PROPERTY = "anyface_identity"
# Another one for every file that is opened: numbers of objects hold as long.
_session = ""


@dataclass
class Identity:
    """`id` of an object, `face` the id of the face whose part it is, and its stamp."""

    id: str = field(default_factory=lambda: uuid.uuid4().hex[:12])
    face: str = ""
    session: str = ""
    number: int = 0
    name: str = ""


def read(ob) -> Identity | None:
    """What is written on an object, be it a copy or not; None for nothing."""
    text = getattr(ob, PROPERTY, "")
    if not text:
        return None
    try:
        return json_file.known_fields(Identity, json.loads(text))
    except (ValueError, TypeError, AttributeError):
        return None


def write(ob, identity: Identity) -> None:
    """Stores an identity with the stamp of `ob`."""
    identity.session, identity.number, identity.name = _session, number(ob), ob.name
    text = json.dumps(asdict(identity))
    if getattr(ob, PROPERTY) != text and not ob.is_property_readonly(PROPERTY):
        setattr(ob, PROPERTY, text)


def number(ob) -> int:
    """What Blender calls an object until another file is opened, whatever its name."""
    return getattr(ob, "session_uid", 0)


def with_number(object_number: int, name: str):
    """The object of that number, whatever it is called now; None where it is gone.

    Blender versions that number nothing know it by its `name`.
    """
    if not object_number:
        return bpy.data.objects.get(name)
    return next((ob for ob in bpy.data.objects if number(ob) == object_number), None)


def is_copy(ob, identity: Identity) -> bool:
    """True where `found` was written on another object since the file was opened, or comes from
    the linked object that `ob` overrides."""
    linked = ob.override_library.reference if ob.override_library is not None else None
    inherited = read(linked) if linked is not None else None
    if inherited is not None and inherited.id == identity.id:
        return True
    return identity.session == _session and identity.number != number(ob)


def is_current(ob, identity: Identity) -> bool:
    """True where `found` was written on `ob` itself since the file was opened."""
    return identity.session == _session and not is_copy(ob, identity)


def known(ob) -> str:
    """The id of `ob`; empty where it has none, or only that of the one it was copied from."""
    identity = read(ob)
    return "" if identity is None or is_copy(ob, identity) else identity.id


def of(ob) -> str:
    """The id of `ob`, which gets one where it has none of its own.

    Raises `AnyfaceError("mesh")` for linked objects, which cannot keep one.
    """
    if ob.library is not None:
        raise AnyfaceError("mesh", f"{ob.name} is linked: pick an object of this file")
    if not known(ob):
        write(ob, Identity())
    return read(ob).id


def join(face, part) -> None:
    """From now on `part` belongs to `face`."""
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
    """Another file is open: numbers of objects are new."""
    global _session
    _session = uuid.uuid4().hex[:12]


def register() -> None:
    """Adds the property to objects; overrides keep theirs."""
    begin_session()
    bpy.types.Object.anyface_identity = StringProperty(
        options={"HIDDEN"}, override={"LIBRARY_OVERRIDABLE"}
    )


def unregister() -> None:
    """Takes it away; values stay in the file."""
    del bpy.types.Object.anyface_identity
