"""*Expression Keys*: adds ARKit's shapes as the artist's keys, from a network or a head's field."""

from bpy.props import EnumProperty
from bpy.types import Operator

from ..core import shapes
from ..core.take import NETWORK, ShapesBy
from ..scene import bake, outputs
from ..scene.shape_keys import expression_keys
from . import running
from .operators import InThread
from .settings import from_object

WAYS = {
    "NETWORK": NETWORK,
    "FIELD": ShapesBy(field=True),
    "BENT": ShapesBy(field=True, in_betweens=True),
}


class ANYFACE_OT_expression_keys(InThread, Operator):
    """Add the 52 ARKit shapes as shape keys that you pose and animate by hand; sliders of this \
object move its parts too"""

    bl_idname = "anyface.expression_keys"
    bl_label = "Expression Keys"

    cancelled = ""
    by: EnumProperty(
        name="By",
        description="The method that makes the shapes",
        items=[
            ("NETWORK", "By Network", "Nearest to true shapes, on any face"),
            ("FIELD", "By Field", "As FaceTalk's head moves, where one is like the face"),
            ("BENT", "By Field, Bent", "The same, with keys that bend each shape halfway"),
        ],
    )

    def read(self, context, ob):
        """Reads the face; raises if it already has keys with these names."""
        settings = from_object(ob)
        settings.mode = outputs.Arkit.name
        outputs.of(settings.mode).check(ob, settings.output)
        face = bake.read_face(ob, settings)
        return expression_keys.Making(face, running.engine(settings.system), WAYS[self.by])

    def finish(self, ob, making, rig):
        """Adds the keys."""
        if making.by.in_betweens:
            rig = expression_keys.bent(rig)
        names, _ = expression_keys.add(ob, making.face, rig, shapes.VISEMES)
        expression_keys.drive(ob, making.face)
        return f"{ob.name} has {len(names)} expression keys"
