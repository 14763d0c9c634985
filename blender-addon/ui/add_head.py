"""What the operators that add a head share."""

from bpy_extras import object_utils

from ..core.native_head import Heads

_HEADS: list[Heads] = []


def heads() -> Heads:
    """The model; the library is loaded with the first head."""
    if not _HEADS:
        _HEADS.append(Heads())
    return _HEADS[0]


class AddHead(object_utils.AddObjectHelper):
    """Adds a head at the 3D cursor, as the active object."""

    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context):
        """In edit mode it would become part of another mesh."""
        if context.mode != "OBJECT":
            cls.poll_message_set("Leave this mode first (Object Mode)")
        return context.mode == "OBJECT"

    def add(self, context, data):
        """The new object of a mesh."""
        if self.align == "VIEW" and context.region_data is None:
            # Scripts have no view to turn it to.
            self.align = "WORLD"
        return object_utils.object_data_add(context, data, operator=self)
