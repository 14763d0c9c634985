"""Remove."""

from bpy.types import Operator

from ..core.errors import AnyfaceError
from ..scene import cache, csv_file, record, together
from .target import target


def has_take(ob) -> bool:
    """True where `ob` (or None) carries something generated: keys, a cache, a table."""
    if ob is None or ob.type != "MESH":
        return False
    return record.is_generated(ob) or cache.find(ob) is not None or csv_file.find(ob) is not None


class ANYFACE_OT_remove(Operator):
    """Remove the generated keys and curves, and nothing else"""

    bl_idname = "anyface.remove"
    bl_label = "Remove"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context):
        return has_take(target(context))

    def execute(self, context):
        """Removes the take of the character that the panel shows."""
        ob = target(context)
        try:
            together.remove_all(ob)
            cache.remove(ob)
            csv_file.remove(ob)
        except AnyfaceError as error:
            self.report({"ERROR"}, f"Anyface: {error}")
            return {"CANCELLED"}
        ob.anyface.report, ob.anyface.report_is_error = "", False
        return {"FINISHED"}


CLASSES = (ANYFACE_OT_remove,)
