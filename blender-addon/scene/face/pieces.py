"""A face made of several objects: teeth, tongue, eyes and lashes beside the face mesh.

All of them are read into one mesh in the face object's space and animated in one run. Then the
result is cut apart again, and each object gets its own keys.
"""

from dataclasses import dataclass, replace

import bpy
import numpy as np

from ...core import measure
from ...core.errors import AnyfaceError
from ...core.job import Progress
from ...core.take import BY_SHAPE, ROLES, FaceMesh, PartRoles, Piece, Take
from . import mesh, rest

# An object that moves less than this in every frame gets no keys.
STILL_MM = 0.005
# What programs call a mesh whose maker gave it no name.
_NO_NAMES = ("cube", "geometry", "icosphere", "mesh", "node", "object", "plane", "sphere")
# A part of a face is no larger than this share of the face's box, and its box ends within this
# share outside the face's.
_LARGEST, _OUTSIDE = 0.5, 0.05
# Words in the names of objects, and the role that they mean; the first match counts.
_NAMES = (
    (("lash", "brow", "beard", "mustache", "moustache"), "nearest"),
    (("tongue", "teeth_low", "teeth low", "lower", "bottom"), "jaw"),
    (("teeth_up", "teeth up", "upper", "hair", "glasses", "hat"), "skull"),
    (("eye", "pupil", "iris", "cornea"), "gaze"),
)


@dataclass
class Part:
    """An object beside the face; `role` is one of `ROLES`, or "" to guess it by shape and place."""

    name: str
    role: str = ""


def add(face: FaceMesh, ob, parts: list[Part], loose: dict[int, str]) -> None:
    """Appends the objects of `parts` to the vertices of `face`, which was read from `ob`.

    `loose` gives roles to single connected parts by number. Raises `AnyfaceError("mesh")` for
    objects that are gone or are not meshes.
    """
    face.pieces = [Piece(ob.name, 0, len(face.positions), np.eye(4), BY_SHAPE)]
    positions, triangles = [face.positions], [face.triangles]
    to_face = _inverse(rest.world(ob), ob.name) if parts else np.eye(4)
    for part in parts:
        other = object_of(part, ob)
        matrix = to_face @ rest.world(other)
        _inverse(matrix, other.name)
        part_face = mesh.read_face(other)
        first = sum(len(block) for block in positions)
        corners = (
            part_face.triangles[:, ::-1]
            if np.linalg.det(matrix[:3, :3]) < 0
            else part_face.triangles
        )
        positions.append(
            (part_face.positions @ matrix[:3, :3].T + matrix[:3, 3]).astype(np.float32)
        )
        triangles.append(corners + np.uint32(first))
        role = ROLES.index(part.role) if part.role else BY_SHAPE
        face.pieces.append(Piece(other.name, first, len(part_face.positions), matrix, role))
    face.positions = np.concatenate(positions)
    face.triangles = np.concatenate(triangles)
    if parts or loose:
        face.roles = _roles(face.pieces, loose)


def _inverse(matrix: np.ndarray, name: str) -> np.ndarray:
    """The inverse of a matrix; raises `AnyfaceError("mesh")` if the object is scaled to zero."""
    if not np.isfinite(matrix).all() or np.linalg.cond(matrix[:3, :3]) > 1e6:
        raise AnyfaceError("mesh", f"{name} is scaled to zero along an axis: give it a scale first")
    return np.linalg.inv(matrix)


def object_of(part: Part, ob):
    """The object of a part; raises `AnyfaceError("mesh")` if it is gone or cannot be a part."""
    other = bpy.data.objects.get(part.name)
    if other is None:
        text = f"{part.name} is gone: take it out of the parts of {ob.name}"
        raise AnyfaceError("mesh", text, ("drop_lost_parts",))
    if other.type != "MESH":
        kind = other.type.lower()
        raise AnyfaceError("mesh", f"{part.name}: expected a mesh, got a {kind}: take it out")
    if other == ob or other.data == ob.data:
        raise AnyfaceError("mesh", f"{part.name} is the face itself: take it out of its parts")
    return other


def _roles(pieces: list[Piece], loose: dict[int, str]) -> PartRoles:
    owners = np.concatenate([np.full(p.count, n, dtype=np.uint32) for n, p in enumerate(pieces)])
    roles = [piece.role for piece in pieces]
    return PartRoles(owners, roles, list(loose), [ROLES.index(role) for role in loose.values()])


def split(take: Take, pieces: list[Piece]) -> list[tuple[Piece, Take | None]]:
    """The take of each piece in its object's own space; None if the piece does not move.

    The face itself always has a take.
    """
    largest = take.largest_of or measure.largest(take, pieces, Progress())
    return [
        (piece, None)
        if number > 0 and mm < STILL_MM
        else (piece, replace(take, motion=take.motion.of_piece(piece), largest_mm=mm))
        for number, (piece, mm) in enumerate(zip(pieces, largest, strict=True))
    ]


def suggest(ob, objects, centre, radius: float) -> list[Part]:
    """Objects that look like parts of the face, each with the role that its name suggests.

    These are meshes near `centre` (world, `[3]`) that are not much larger than the head, whose
    radius is `radius`.
    """
    parts = []
    for other in objects:
        if other == ob or other.type != "MESH" or other.data == ob.data:
            continue
        if len(other.data.polygons) == 0 or other.get(mesh.LANDMARKS_PROPERTY):
            continue
        box = mesh.corners(other)
        middle, size = box.mean(axis=0), np.ptp(box, axis=0).max()
        if np.linalg.norm(middle - centre) <= radius and size <= 2.5 * radius:
            parts.append(Part(other.name, role_of_name(other.name)))
    return parts


def role_of_name(name: str) -> str:
    """The role that the name of an object suggests, or ""."""
    lower = name.lower()
    for words, role in _NAMES:
        if any(word in lower for word in words):
            return role
    return ""


def is_inside(other, ob) -> bool:
    """Whether a mesh whose name says nothing lies within the face `ob`, as teeth and lashes do.

    Such names are those that *Separate by Loose Parts* gives, which are the face's own with another
    number, and those that programs give.
    """
    name = _letters(other.name)
    if name and name != _letters(ob.name) and name not in _NO_NAMES:
        return False
    box, face_box = mesh.corners(other), mesh.corners(ob)
    low, high = face_box.min(axis=0), face_box.max(axis=0)
    room = _OUTSIDE * (high - low).max()
    is_within = (box >= low - room).all() and (box <= high + room).all()
    return bool(is_within and np.ptp(box, axis=0).max() <= _LARGEST * (high - low).max())


def _letters(name: str) -> str:
    return "".join(letter for letter in name.lower() if letter.isalpha())
