"""Writes one take on all the objects of a face, and removes it from all of them again."""

import bpy

from ...core.job import BEGUN
from ...core.take import Piece, Take
from .. import identity, outputs
from ..face import pieces
from ..life import turns
from ..shape_keys import record
from . import keys, remove


def landing(ob, parts: list[Piece], take: Take, start_frame: float, scene_fps: float, before=None):
    """Puts `take` on `ob` and on the moving objects beside it, in steps; yields between them.

    It removes an earlier take, unless `take` is a table, which changes no mesh. It checks all
    objects first, and writes nothing if one of them cannot be written. If the generator is closed
    before it yields `BEGUN`, nothing has changed. It calls `before` after all checks and
    preparations, just before it writes.
    """
    output = outputs.of_take(take)
    if output.in_files:
        yield from _landing_files(ob, output, take, start_frame, scene_fps, before)
        return
    (_, face_take), *others = output.split(take, parts) if len(parts) > 1 else [(None, take)]
    for piece, part in others:
        other = pieces.object_of(pieces.Part(piece.name), ob)
        output.check_object(other)
        if part is not None:
            keys.check(other, part)
    keys.check(ob, face_take)
    moving = [(ob, face_take)]
    moving += [(bpy.data.objects[p.name], part) for p, part in others if part is not None]
    prepared = []
    try:
        for other, part in moving:
            prepared_curves = yield from keys.prepare(other, part, start_frame, scene_fps)
            prepared.append(prepared_curves)
        if before is not None:
            before()
        yield from _write(moving, start_frame, scene_fps, prepared)
    finally:
        for prepared_curves in prepared:
            if prepared_curves is not None:
                prepared_curves.drop()


def _landing_files(ob, output, take: Take, start_frame: float, scene_fps: float, before):
    """Does what `landing` does, for takes in files or on a rig."""
    output.check_files(take)
    yield from output.prepare_files(take, start_frame, scene_fps)
    try:
        if before is not None:
            before()
        if output.on_mesh:
            remove_others(ob)
            keys.remove_earlier(ob)
        output.write_files(ob, take, start_frame, scene_fps)
    finally:
        output.drop_files(take)


def _write(moving: list[tuple], start_frame: float, scene_fps: float, prepared: list):
    """Writes the takes of a face and of the parts that move with it, from prepared curves."""
    (ob, face_take), *others = moving
    remove_others(ob)
    first = yield from keys.writing(ob, face_take, start_frame, scene_fps, prepared[0])
    for (other, part), prepared_curves in zip(others, prepared[1:], strict=True):
        yield BEGUN
        take_record = yield from keys.writing(other, part, start_frame, scene_fps, prepared_curves)
        take_record.belongs_to = first.id
        record.write(other.data.shape_keys, take_record)
        identity.join(ob, other)


def remove_all(ob) -> bool:
    """Removes the take from `ob` and from the objects beside it; False if there was none."""
    others = remove_others(ob)
    turns.release(ob)
    return remove.remove(ob) or others


def remove_others(ob) -> bool:
    """Removes the take of `ob` from the objects beside it, even from renamed ones."""
    others = others_of(ob)
    for other in others:
        remove.remove(other)
    return bool(others)


def others_of(ob) -> list:
    """The objects that got their keys together with `ob`."""
    if not record.is_generated(ob):
        return []
    take_id = record.read(ob.data.shape_keys).id
    meshes = [other for other in identity.parts_of(ob) if other.type == "MESH"]
    records = [(other, record.read(other.data.shape_keys)) for other in meshes]
    return [
        other
        for other, take_record in records
        if take_record is not None and take_record.belongs_to == take_id
    ]
