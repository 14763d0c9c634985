"""`anyface rig`: the ARKit shapes of a face as shape keys, which are the artist's from then on."""

import argparse

import bpy

from ..core import finding, plan, shapes, space
from ..core.errors import AnyfaceError
from ..core.job import Progress
from ..core.take import NETWORK, FaceMesh, Rig, ShapesBy
from ..scene import bake, keys, outputs
from ..ui import running
from ..ui.settings import from_object
from .bake import named


def run(options: argparse.Namespace) -> dict:
    """Makes the keys on the object and on those beside it; returns what goes into the report."""
    ob = named(bpy.data.objects, options.object, "object")
    settings = from_object(ob)
    settings.mode, settings.axes = outputs.Arkit.name, options.axes or settings.axes
    settings.output.visemes = options.visemes
    outputs.of(settings.mode).check(ob, settings.output)
    face = bake.read_face(ob, settings)
    by = ShapesBy(options.by == "field", options.in_betweens)
    if by.in_betweens and not by.field:
        raise AnyfaceError("input", "--in-betweens: expected --by field, got shapes by the network")
    rig = make(face, running.engine(settings.system, options.weights), by)
    left_out = () if options.visemes else shapes.VISEMES
    kept = [row for row, name in enumerate(rig.names) if name not in left_out]
    names, vectors = [rig.names[row] for row in kept], rig.vectors[kept]
    for piece in [piece.name for piece in face.pieces] or [ob.name]:
        moved = plan.of_piece(face, vectors, piece)[1]
        keys.add(bpy.data.objects[piece], names, moved, everything=piece == ob.name)
    still = [name for name, vector in zip(names, vectors, strict=True) if not vector.any()]
    notes = {name: note for name, note in rig.notes.items() if name in names}
    text = f"{len(names)} shapes"
    text += f", {len(still)} move nothing ({', '.join(still)})" if still else ""
    return {"message": text, "shapes": names, "still": still, "notes": notes}


def make(face: FaceMesh, engine, by: ShapesBy = NETWORK) -> Rig:
    """The shapes of a face in object space."""
    seen = space.face_space(face.matrix_world, face.axes)
    with finding.naming(face):
        return plan.make_rig(face, seen, engine, Progress(), by)
