"""Text that is longer than a panel is wide."""

import textwrap

# A letter is about eight pixels wide; a panel narrower than this many letters is being folded away.
_LETTER_PX, _LEAST_LETTERS = 8, 20


def draw(layout, text: str, width: int, icon: str = "NONE") -> None:
    """Draws `text` as labels below each other; `width` is the region's, in pixels."""
    for line in textwrap.wrap(text, max(_LEAST_LETTERS, width // _LETTER_PX)):
        layout.label(text=line, icon=icon)
        icon = "NONE" if icon == "NONE" else "BLANK1"
