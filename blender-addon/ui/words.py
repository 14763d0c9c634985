"""Words for the artist in place of the library's, and long text broken into lines."""

import textwrap

import bpy

# Widths in pixels at an interface scale of 1: a letter, an icon, and the margins of a panel with a
# box in it.
_LETTER_PX, _ICON_PX, _EDGE_PX = 6.3, 20, 44
# Lines have at least this many letters. A panel too narrow for them is being closed.
_LEAST_LETTERS = 20
# The library's stages in an artist's words.
_STAGES = {
    "sound": "reading the sound",
    "speech": "listening to the voice",
    "motion": "performing",
    "landmarks": "finding the face",
    "operators": "preparing the mesh",
    "weights": "preparing the mesh",
    "deform": "moving the mesh",
    "compress": "making shape keys of it",
    "sliders": "keeping it adjustable",
    "controls": "trying the rig",
    "rig": "making the keys",
    "solve": "posing the keys",
    "write": "writing",
}


# Names and help of controls for which the library's own words do not suit an artist.
_CONTROLS = {
    "variety": (
        "Variety",
        "How much takes of different seeds differ; lips that close stay closed",
    ),
    "steps": (
        "Quality Steps",
        "More steps are slower and hardly better; 0 uses the model's own number",
    ),
    "learned": (
        "Fine Detail",
        "Folds and bulges learned from other faces; 0 moves the skin evenly",
    ),
    "emotion_from": (
        "Emotion Follows",
        "Voice: the emotion that you chose, or else the one in the voice; Emotion: always the one "
        "that you chose, even neutral; Off: no emotion",
    ),
    "decoder": (
        "Method",
        "Static computes once how this face moves; paper computes it for every frame and is slow",
    ),
}


# Controls for people who know how the model works.
_RESEARCH = {
    "steps", "noise", "decoder", "guidance", "calibrate", "coarse_guidance", "speech_guidance",
    "template", "field", "field_reach",
}  # fmt: skip


def is_research(control) -> bool:
    """Whether a control (`core.systems.Control`) is for research alone."""
    return control.name in _RESEARCH


def of_stage(name: str) -> str:
    """The stage in words: "starting" before the first, "working" for one that has no words."""
    return _STAGES.get(name, "working") if name else "starting"


def of_control(control) -> tuple[str, str]:
    """The name and the help of a control (`core.systems.Control`)."""
    return _CONTROLS.get(control.name, (control.label, control.help.rstrip(".")))


def draw(layout, text: str, width: int, icon: str = "NONE") -> None:
    """Draws `text` as labels below each other; `width` is the region's, in pixels."""
    # Without a window the scale is 0.
    scale = bpy.context.preferences.system.ui_scale or 1.0
    for line in textwrap.wrap(text, letters(width / scale, icon != "NONE")):
        layout.label(text=line, icon=icon)
        icon = "NONE" if icon == "NONE" else "BLANK1"


def letters(width: float, with_icon: bool) -> int:
    """How many letters fit on a line in a region of `width` unscaled pixels."""
    room = width - _EDGE_PX - (_ICON_PX if with_icon else 0)
    return max(_LEAST_LETTERS, int(room / _LETTER_PX))
