"""Text that is longer than a panel is wide."""

import textwrap

import bpy

# Pixels, at a user interface of usual size: of a letter, of an icon, and of what a panel and a box
# in it keep free beside the text.
_LETTER_PX, _ICON_PX, _EDGE_PX = 6.3, 20, 44
# A panel narrower than this many letters is being folded away.
_LEAST_LETTERS = 20
# What the library's stages do, for an artist.
_STAGES = {
    "sound": "reading the sound",
    "speech": "listening to the voice",
    "motion": "performing",
    "landmarks": "finding the face",
    "operators": "getting to know the mesh",
    "weights": "getting to know the mesh",
    "deform": "moving the mesh",
    "compress": "making few keys of it",
    "sliders": "trying its sliders",
    "controls": "trying the rig",
    "rig": "making shapes",
    "solve": "fitting the keys",
    "write": "writing",
}


def of_stage(name: str) -> str:
    """What is being done; "starting" before the first stage."""
    return _STAGES.get(name, name) or "starting"


def draw(layout, text: str, width: int, icon: str = "NONE") -> None:
    """Draws `text` as labels below each other; `width` is the region's, in pixels."""
    # Without a window the scale is 0.
    scale = bpy.context.preferences.system.ui_scale or 1.0
    for line in textwrap.wrap(text, letters(width / scale, icon != "NONE")):
        layout.label(text=line, icon=icon)
        icon = "NONE" if icon == "NONE" else "BLANK1"


def letters(width: float, with_icon: bool) -> int:
    """How many letters stand beside each other in a region of `width` unscaled pixels."""
    room = width - _EDGE_PX - (_ICON_PX if with_icon else 0)
    return max(_LEAST_LETTERS, int(room / _LETTER_PX))
