"""`anyface rig`: makes ARKit shapes as shape keys, which then belong to the artist."""

import argparse

import bpy

from ..core import shapes
from ..core.errors import AnyfaceError
from ..core.job import Progress
from ..core.take import ShapesBy
from ..scene import bake, outputs
from ..scene.shape_keys import expression_keys
from ..ui import running
from ..ui.settings import from_object
from .bake import named


def run(options: argparse.Namespace) -> dict:
    """Makes the keys on the object and the parts that move with it; returns the report's fields."""
    ob = named(bpy.data.objects, options.object, "object")
    settings = from_object(ob)
    settings.mode, settings.axes = outputs.Arkit.name, options.axes or settings.axes
    settings.output.visemes = options.visemes
    outputs.of(settings.mode).check(ob, settings.output)
    face = bake.read_face(ob, settings)
    by = ShapesBy(options.by == "field", options.in_betweens)
    if by.in_betweens and not by.field:
        raise AnyfaceError("input", "--in-betweens: expected --by field, got shapes by the network")
    engine = running.engine(settings.system, options.weights)
    rig = expression_keys.Making(face, engine, by).work(Progress())
    left_out = () if options.visemes else shapes.VISEMES
    names, vectors = expression_keys.add(ob, face, rig, left_out)
    still = [name for name, vector in zip(names, vectors, strict=True) if not vector.any()]
    notes = {name: note for name, note in rig.notes.items() if name in names}
    text = f"{len(names)} shapes"
    text += f", {len(still)} move nothing ({', '.join(still)})" if still else ""
    return {"message": text, "shapes": names, "still": still, "notes": notes}
