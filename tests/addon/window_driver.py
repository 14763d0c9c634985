"""Runs inside a Blender with a window and answers the test's questions, one file at a time.

The test starts it with `--python` and passes the folder for the files after `--`. A question is a
script `ask.py` that sets `answer`. The answer appears in `answer.json`. A timer looks for
questions, so that Blender's own loop runs in between, as it does for a user.
"""

import importlib
import json
import os
import sys
import time
import traceback
from pathlib import Path

import bpy

FOLDER = Path(sys.argv[sys.argv.index("--") + 1])
PERIOD_S = 0.02

# The longest pause between two calls of `poll`, and when the last call ended, both in seconds.
stillness = {"longest_s": 0.0, "last_s": time.monotonic()}


def area_of(kind):
    """The window, its first area of this kind, and the area's main and side regions."""
    window = bpy.context.window_manager.windows[0]
    area = next(area for area in window.screen.areas if area.type == kind)
    by_kind = {region.type: region for region in area.regions}
    return window, area, by_kind["WINDOW"], by_kind["UI"]


def keys():
    """How many shape keys the head has."""
    shape_keys = bpy.data.objects["Head"].data.shape_keys
    return len(shape_keys.key_blocks) if shape_keys else 0


def running():
    """Whether a job runs."""
    return importlib.import_module("bl_ext.user_default.anyface.ui.running").is_running()


SCOPE = {
    "bpy": bpy,
    "area_of": area_of,
    "keys": keys,
    "running": running,
    "stillness": stillness,
}


def poll():
    """Answers a question if there is one."""
    now = time.monotonic()
    stillness["longest_s"] = max(stillness["longest_s"], now - stillness["last_s"])
    question = FOLDER / "ask.py"
    if question.exists():
        text = question.read_text()
        question.unlink()
        scope = {**SCOPE, "answer": None}
        try:
            exec(text, scope)
            reply = {"answer": scope["answer"]}
        except Exception:
            reply = {"error": traceback.format_exc()}
        half = FOLDER / "answer.part"
        half.write_text(json.dumps(reply))
        os.replace(half, FOLDER / "answer.json")
    stillness["last_s"] = time.monotonic()
    return PERIOD_S


# The splash screen would cover the sidebar. On a busy machine it opens after the first clicks.
bpy.context.preferences.view.show_splash = False
bpy.app.timers.register(poll, persistent=True)
