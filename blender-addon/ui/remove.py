"""The operator *Remove*."""

from bpy.types import Operator

from ..scene import outputs
from ..scene.takes import together
from .operators import Acting
from .target import target


class ANYFACE_OT_remove(Acting, Operator):
    """Remove the generated keys and curves, and nothing else"""

    bl_idname = "anyface.remove"
    bl_label = "Remove"

    @classmethod
    def why_not(cls, context):
        return "" if outputs.has_take(target(context)) else "There is no take"

    def act(self, ob):
        """Removes the take of the character that the panel shows."""
        together.remove_all(ob)
        for output in outputs.ALL:
            output.remove(ob)
        ob.anyface.report, ob.anyface.report_is_error = "", False
        ob.anyface.report_mends = ob.anyface.report_details = ""
        ob.anyface.last_frame = 0
