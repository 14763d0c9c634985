"""Remove."""

from bpy.types import Operator

from ..core.errors import AnyfaceError
from ..scene import outputs, together
from .target import target


class ANYFACE_OT_remove(Operator):
    """Remove the generated keys and curves, and nothing else"""

    bl_idname = "anyface.remove"
    bl_label = "Remove"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context):
        return outputs.has_take(target(context))

    def execute(self, context):
        """Removes the take of the character that the panel shows."""
        ob = target(context)
        try:
            together.remove_all(ob)
            for output in outputs.ALL:
                output.remove(ob)
        except AnyfaceError as error:
            self.report({"ERROR"}, f"Anyface: {error}")
            return {"CANCELLED"}
        ob.anyface.report, ob.anyface.report_is_error = "", False
        return {"FINISHED"}


CLASSES = (ANYFACE_OT_remove,)
