"""Turns *Live* on, plays, and turns it off again in a real Blender window."""

from itertools import pairwise

import pytest

from screen import Screen
from test_heads import voice  # noqa: F401 - a fixture
from test_window import REDRAW, photographs, screen  # noqa: F401 - fixtures

# Position of the small button at the right end of its row, as a share of the sidebar's width.
RIGHT = 0.77
IS_LIVE = "any('Anyface Live' in keys.key_blocks for keys in bpy.data.shape_keys)"
# Notes the scene frame and the time of every frame change.
WATCH = """
import time
frames = bpy.app.driver_namespace.setdefault("frames", [])
def note(scene, *_):
    frames.append((scene.frame_current, time.perf_counter()))
bpy.app.handlers.frame_change_post.append(note)
answer = True
"""
MOVED = """
import numpy as np
head = bpy.data.objects["Head"].data.shape_keys
def points(block):
    out = np.empty(3 * len(block.data), dtype=np.float32)
    block.data.foreach_get("co", out)
    return out
answer = float(np.abs(points(head.key_blocks["Anyface Live"]) - points(head.reference_key)).max())
"""


def test_the_face_follows_what_plays(screen: Screen, photographs):  # noqa: F811
    screen.hand("mousemove", *screen.find("anyface.live", RIGHT), "click", 1)
    screen.wait(IS_LIVE)
    screen.ask(WATCH)
    screen.ask("bpy.ops.screen.animation_play()\nanswer = True")
    screen.wait("len(bpy.app.driver_namespace['frames']) > 40")
    screen.photograph(photographs / "live.png")
    screen.ask("bpy.ops.screen.animation_cancel(restore_frame=False)\nanswer = True")
    screen.ask("bpy.context.scene.frame_set(24)\nanswer = True")
    assert screen.ask(MOVED) > 1e-3
    frames = screen.ask("answer = bpy.app.driver_namespace['frames']")
    played = [b[1] - a[1] for a, b in pairwise(frames) if b[0] > a[0]]
    assert played
    print("median time from frame to frame:", sorted(played)[len(played) // 2])
    screen.ask(REDRAW + "\nanswer = True")
    screen.hand("mousemove", *screen.find("anyface.live", RIGHT), "click", 1)
    screen.wait(f"not {IS_LIVE}")


@pytest.fixture(autouse=True)
def _as_before(screen: Screen):  # noqa: F811
    yield
    screen.ask("bpy.app.handlers.frame_change_post.pop()\nanswer = True")
