"""Writes one take on all the objects of a face, and takes it from all of them again."""

from dataclasses import replace

import bpy

from ..core import shapes
from ..core.take import Piece, Take
from . import existing, guard, keys, pieces, record, remove


def write(ob, parts: list[Piece], take: Take, start_frame: float, scene_fps: float) -> None:
    """Puts `take` on `ob` and on the objects beside it that move.

    Nothing is written where one of them cannot be: all are checked first.
    """
    mode = keys.mode_of(take)
    alone = [(Piece(ob.name, 0, 0, None), take)]
    if mode == "keys":
        others = [(piece, _own_keys(take, piece)) for piece in parts[1:]]
        cut = alone + [(piece, part) for piece, part in others if part is not None]
    else:
        cut = pieces.split(take, parts) if len(parts) > 1 else alone
    for piece, _ in cut[1:]:
        guard.check_editable(pieces.object_of(pieces.Part(piece.name), ob), mode)
    remove_others(ob)
    first = keys.write(ob, take if len(cut) == 1 else cut[0][1], start_frame, scene_fps)
    for piece, part in cut[1:]:
        other = bpy.data.objects[piece.name]
        if part is None:
            continue
        taken = keys.write(other, part, start_frame, scene_fps)
        taken.belongs_to = first.id
        record.write(other.data.shape_keys, taken)


def _own_keys(take: Take, piece: Piece) -> Take | None:
    """The take on the keys that an object beside the face has of the same shapes, or None."""
    other, motion = bpy.data.objects.get(piece.name), take.key_motion
    theirs = existing.find(other, {}) if other is not None else {}
    shared = [(key, theirs[n]) for n, key in shapes.match(motion.keys).items() if n in theirs]
    if not shared:
        return None
    columns = [motion.keys.index(key) for key, _ in shared]
    names = [name for _, name in shared]
    return replace(take, key_motion=replace(motion, keys=names, weights=motion.weights[:, columns]))


def remove_all(ob) -> bool:
    """Takes the take from `ob` and from the objects beside it; False where there was none."""
    others = remove_others(ob)
    return remove.remove(ob) or others


def remove_others(ob) -> bool:
    """Takes the take of `ob` from the objects beside it, also renamed ones."""
    found = others_of(ob)
    for other in found:
        remove.remove(other)
    return bool(found)


def others_of(ob) -> list:
    """The objects that got their keys together with `ob`."""
    if not record.is_generated(ob):
        return []
    own = record.read(ob.data.shape_keys).id
    meshes = [other for other in bpy.data.objects if other.type == "MESH" and other != ob]
    records = [(other, record.read(other.data.shape_keys)) for other in meshes]
    return [other for other, taken in records if taken is not None and taken.belongs_to == own]
