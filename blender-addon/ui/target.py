"""Which object and which sequencer the panel is about."""


def target(context):
    """The character that the panel shows: the picked one, else the active object; None where that
    is no mesh."""
    picked = context.scene.anyface.character
    shown = picked if is_there(picked) else context.object
    return shown if shown is not None and shown.type == "MESH" else None


class OfFace:
    """An operator that works on the character; stands before `Operator`."""

    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context):
        """False, with what is missing, where the panel shows no character."""
        if target(context) is None:
            cls.poll_message_set("Pick a face mesh")
            return False
        return True


def is_there(ob) -> bool:
    """False for None and for a deleted object, which a pointer alone keeps in the file."""
    return ob is not None and len(ob.users_scene) > 0


def sequencer_scene(context):
    """The scene whose strips are heard: from 5.0 on a workspace may show another one."""
    return getattr(context, "sequencer_scene", None) or context.scene
