"""Which object and which sequencer the panel is about."""


def target(context):
    """The character that the panel shows: the picked one, else the active mesh object."""
    picked = context.scene.anyface.character
    if picked is not None:
        return picked
    active = context.object
    return active if active is not None and active.type == "MESH" else None


def sequencer_scene(context):
    """The scene whose strips are heard: from 5.0 on a workspace may show another one."""
    return getattr(context, "sequencer_scene", None) or context.scene
