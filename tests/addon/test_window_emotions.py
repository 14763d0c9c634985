"""Mixtures and pictures of emotions in a real Blender window."""

from screen import Screen
from test_heads import voice  # noqa: F401 - a fixture
from test_window import MORE, REDRAW, photographs, screen  # noqa: F401 - fixtures
from test_window_page import OPEN

# Position of the small button at the end of a line, as a share of the sidebar's width.
RIGHT = 0.84
FACE = "bpy.data.objects['Head'].anyface"
PICTURES = """
import importlib
pictures = importlib.import_module("bl_ext.user_default.anyface.ui.pictures")
ob = bpy.data.objects["Head"]
icons = [icon for *_, icon, _ in pictures.items(ob.anyface, bpy.context)]
answer = len(set(icons) - {0})
"""
SHOWN = (
    "__import__('bl_ext.user_default.anyface.ui.pictures', fromlist='of')"
    ".of(bpy.data.objects['Head'])"
)

# Removes the pictures of the faces, which would push the plot out of sight.
PICTURES_AWAY = "importlib.import_module('bl_ext.user_default.anyface.ui.pictures')._shown.clear()"
PLOT = """
import importlib
plot = importlib.import_module("bl_ext.user_default.anyface.ui.emotion_plot")
answer = [name for name in plot._previews if name.startswith("take ")]
"""


def test_emotions_are_mixed_and_drawn(screen: Screen, photographs):  # noqa: F811
    screen.hand("mousemove", 1000, 500, "sleep", "1")
    screen.photograph(photographs / "emotion_1_one.png")
    screen.hand("mousemove", *screen.find("anyface.emotion_add", RIGHT), "click", 1)
    screen.wait(f"len({FACE}.mixture) == 1")
    screen.hand("mousemove", 400, 400, "key", "ctrl+z")
    screen.wait(f"len({FACE}.mixture) == 0")
    screen.hand("key", "ctrl+shift+z")
    screen.wait(f"len({FACE}.mixture) == 1")
    screen.ask(f"{FACE}.emotion = 'sad'\n{REDRAW}")
    screen.hand("sleep", "0.5")
    screen.photograph(photographs / "emotion_2_two.png")
    screen.ask(OPEN.format(labels=("Emotion",), suffix="_emotion"))
    screen.ask(MORE.format(True) + f"\n{REDRAW}")
    screen.hand("sleep", "0.5")
    assert screen.ask(PICTURES) == 0
    screen.press("anyface.draw_emotions")
    screen.wait(SHOWN)
    assert screen.ask(PICTURES) == 15
    screen.hand("sleep", "1")
    screen.photograph(photographs / "emotion_3_drawn.png")
    x, y = screen.find("anyface.draw_emotions")
    # The picture is below the button. A click on it shows all pictures.
    screen.hand("mousemove", x + 40, y + 80, "sleep", "0.2", "click", 1, "sleep", "1.5")
    screen.photograph(photographs / "emotion_4_choice.png")
    screen.hand("key", "Escape")
    screen.hand("mousemove", 400, 400, "sleep", "0.2")
    screen.ask(MORE.format(False))


def test_what_was_heard_is_drawn_once_a_take(screen: Screen, photographs):  # noqa: F811
    screen.ask(f"{FACE}.emotion_source = 'VOICE'\n{REDRAW}")
    screen.ask(OPEN.format(labels=("Emotion",), suffix="_heard") + PICTURES_AWAY)
    screen.press("anyface.generate")
    screen.wait("keys() and not running()")
    screen.ask(MORE.format(True) + f"\n{REDRAW}")
    screen.hand("mousemove", 400, 400, "sleep", "1")
    assert len(screen.ask(PLOT)) == 1
    screen.photograph(photographs / "emotion_5_heard.png")
    screen.press("anyface.generate")
    screen.hand("sleep", "0.5")
    screen.wait("keys() and not running()")
    screen.hand("sleep", "1")
    assert len(screen.ask(PLOT)) == 2
    screen.ask(MORE.format(False))
