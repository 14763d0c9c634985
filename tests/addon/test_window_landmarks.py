"""Finds the face and drags landmarks with the mouse in a real window (see test_window)."""

import numpy as np
import pytest

from screen import HEAD_AND_SIDEBAR
from test_heads import voice  # noqa: F401 - a fixture
from test_window import MORE, photographs, screen  # noqa: F401 - fixtures

# Answers the pixel of a landmark in the 3D view, from the top left of the screen; the positions of
# all landmarks in metres; the numbers of those placed by hand; the mean confidence.
LOOK = """
from bpy_extras.view3d_utils import location_3d_to_region_2d
from mathutils import Vector
import importlib
landmarks = importlib.import_module("bl_ext.user_default.anyface.scene.face.landmarks")
window, area, region, _ = area_of('VIEW_3D')
ob = bpy.data.objects["Head"]
stored = landmarks.load(ob)
at = location_3d_to_region_2d(
    region, area.spaces[0].region_3d, ob.matrix_world @ Vector(stored.positions[{number}])
)
pixel = (round(region.x + at.x), round(window.height - region.y - at.y))
answer = (pixel, stored.positions.tolist(), sorted(stored.fixed), stored.sure)
"""
STORED = "'anyface_landmarks' in bpy.data.objects['Head'] and not running()"


def look(screen, number=48):  # noqa: F811
    """Pixel of a landmark, positions of all, numbers of those placed by hand, mean confidence."""
    return screen.ask(LOOK.format(number=number))


def test_a_landmark_is_dragged_with_the_mouse_and_undone(screen, photographs):  # noqa: F811
    screen.ask(MORE.format(True))
    screen.hand("sleep", "0.5")
    screen.press("anyface.find_face")
    screen.wait(STORED)
    (x, y), before, fixed, sure = look(screen)
    assert fixed == [] and sure > 0.5
    screen.press("anyface.edit_landmarks")
    screen.hand("mousemove", x, y, "sleep", "0.3")
    screen.photograph(photographs / "7_landmarks.png")
    screen.hand("mousedown", "1", "sleep", "0.2")
    for step in (5, 10, 15, 20):
        screen.hand("mousemove", x - step, y, "sleep", "0.1")
    screen.hand("mouseup", "1", "sleep", "0.2")
    screen.wait("not running()")
    screen.hand("sleep", "0.5")
    (dragged_x, _), after, fixed, _ = look(screen)
    screen.photograph(photographs / "pages/landmarks.png", HEAD_AND_SIDEBAR)
    assert fixed == [48] and dragged_x == pytest.approx(x - 20, abs=2)
    away = np.linalg.norm(np.array(after) - np.array(before), axis=1)
    assert away[60] > 0.3 * away[48] > 10 * away[17]
    screen.hand("key", "Escape", "sleep", "0.3", "key", "ctrl+z", "sleep", "0.5")
    assert look(screen)[2] == []
    screen.hand("key", "ctrl+shift+z", "sleep", "0.5")
    assert look(screen)[2] == [48]


def test_five_clicks_make_a_face_and_undo_takes_it_away(screen, photographs):  # noqa: F811
    screen.ask(MORE.format(True))
    screen.hand("sleep", "0.5")
    screen.press("anyface.find_face")
    screen.wait(STORED)
    numbers = [36, 45, 30, 48, 54]
    pixels = [look(screen, number)[0] for number in numbers]
    _, before, _, _ = look(screen)
    screen.ask("del bpy.data.objects['Head']['anyface_landmarks']; answer = 0")
    screen.ask("bpy.ops.ed.undo_push(message='Forget'); answer = 0")
    screen.press("anyface.place_points")
    for x, y in [pixels[0], *pixels[1:3]]:
        screen.hand("mousemove", x, y, "sleep", "0.2", "click", "1", "sleep", "0.2")
    screen.hand("key", "BackSpace", "sleep", "0.2")
    screen.photograph(photographs / "9_two_points.png")
    for x, y in pixels[2:]:
        screen.hand("mousemove", x, y, "sleep", "0.2", "click", "1", "sleep", "0.2")
    screen.wait(STORED)
    screen.hand("sleep", "0.5")
    _, after, fixed, _ = look(screen)
    screen.photograph(photographs / "10_five_points.png")
    assert fixed == sorted(numbers)
    away = np.linalg.norm(np.array(after) - np.array(before), axis=1)
    # A pixel is about a millimetre. The search finds the other landmarks as well as before.
    assert away[numbers].max() < 0.006 and away.mean() < 0.01
    screen.hand("key", "ctrl+z", "sleep", "0.5")
    screen.wait("'anyface_landmarks' not in bpy.data.objects['Head']")
