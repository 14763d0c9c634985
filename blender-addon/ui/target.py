"""Which object and which sequencer the panel is about."""


def target(context):
    """The character that the panel shows: the picked one, else the active object; None where that
    is no mesh."""
    shown = context.scene.anyface.character or context.object
    return shown if shown is not None and shown.type == "MESH" else None


def sequencer_scene(context):
    """The scene whose strips are heard: from 5.0 on a workspace may show another one."""
    return getattr(context, "sequencer_scene", None) or context.scene
