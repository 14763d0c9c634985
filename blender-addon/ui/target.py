"""Which object and which sequencer the panel is about."""


def target(context):
    """The character that the panel shows: the picked one, else the active object; None where that
    is no mesh."""
    picked = context.scene.anyface.character
    shown = picked if is_there(picked) else context.object
    return shown if shown is not None and shown.type == "MESH" else None


def is_there(ob) -> bool:
    """False for None and for a deleted object, which a pointer alone keeps in the file."""
    return ob is not None and len(ob.users_scene) > 0


def sequencer_scene(context):
    """The scene whose strips are heard: from 5.0 on a workspace may show another one."""
    return getattr(context, "sequencer_scene", None) or context.scene
