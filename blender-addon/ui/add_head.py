"""The common base of the operators that add a head."""

from bpy_extras import object_utils

from ..core.native_head import Heads

_HEADS: list[Heads] = []


def heads() -> Heads:
    """The head model; the first call loads the library."""
    if not _HEADS:
        _HEADS.append(Heads())
    return _HEADS[0]


class AddHead(object_utils.AddObjectHelper):
    """Adds a head at the 3D cursor, as the active object."""

    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context):
        """False in edit mode, where the head would become part of another mesh."""
        if context.mode != "OBJECT":
            cls.poll_message_set("Leave this mode first (Object Mode)")
        return context.mode == "OBJECT"

    def add(self, context, data):
        """Adds a mesh as a new object; returns it."""
        if self.align == "VIEW" and context.region_data is None:
            # A script has no view to align the head with.
            self.align = "WORLD"
        return object_utils.object_data_add(context, data, operator=self)
