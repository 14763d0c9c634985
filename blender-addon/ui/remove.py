"""Remove."""

from bpy.types import Operator

from ..core.errors import AnyfaceError
from ..scene import record, together
from .settings import target


class ANYFACE_OT_remove(Operator):
    """Remove the generated keys and curves, and nothing else"""

    bl_idname = "anyface.remove"
    bl_label = "Remove"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context):
        return record.is_generated(target(context))

    def execute(self, context):
        """Removes the take of the character that the panel shows."""
        ob = target(context)
        try:
            together.remove_all(ob)
        except AnyfaceError as error:
            self.report({"ERROR"}, f"Anyface: {error}")
            return {"CANCELLED"}
        ob.anyface.report, ob.anyface.report_is_error = "", False
        return {"FINISHED"}


CLASSES = (ANYFACE_OT_remove,)
