"""Runs the real `blender` executable with `--command`. `ANYFACE_BLENDER` is its path."""

import json
import math
import os
import re
import shutil
import subprocess

import pytest

from conftest import zip_path
from test_heads import HEAD, voice  # noqa: F401 - a fixture

SHOT = """
import bpy
bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
bpy.ops.wm.obj_import(filepath={head!r}, use_split_objects=False, use_split_groups=False)
bpy.context.object.name = "Head"
scene = bpy.context.scene
scene.render.fps = 24
editor = scene.sequence_editor_create()
strips = editor.strips if hasattr(editor, "strips") else editor.sequences
strips.new_sound("Voice", {voice!r}, 1, 21)
bpy.ops.wm.save_as_mainfile(filepath={shot!r})
"""
LOOK = """
import bpy
shape_keys = bpy.data.objects["Head"].data.shape_keys
print("KEYS", [block.name for block in shape_keys.key_blocks][:2])
action = shape_keys.animation_data.action
print("RANGE", *action.frame_range)
"""


RENDER = """
import bpy, array
bpy.ops.wm.read_homefile(use_factory_startup=True)
bpy.ops.preferences.addon_enable(module="bl_ext.user_default.anyface")
scene = bpy.context.scene
render = scene.render
render.engine, scene.cycles.samples, render.filepath = "CYCLES", 1, {picture!r}
scene.cycles.use_denoising = False
render.resolution_x = render.resolution_y = 16
editor = scene.sequence_editor_create()
strips = editor.strips if hasattr(editor, "strips") else editor.sequences
strips.new_sound("Voice", {voice!r}, 1, 21)
bpy.ops.wm.obj_import(filepath={head!r}, use_split_objects=False, use_split_groups=False)
head = bpy.context.object
head.hide_render = True
head.anyface.system, head.anyface.source, head.anyface.strip = "cafe-talk", "STRIP", "Voice"

def rendered():
    bpy.ops.render.render(write_still=True)
    image = bpy.data.images.load(render.filepath)
    pixels = array.array("f", image.pixels[:])
    bpy.data.images.remove(image)
    return pixels

before = rendered()
assert max(before[::4]) > 0.1
assert bpy.ops.anyface.event_add(expression="smile") == {{"FINISHED"}}
after_event = rendered()
assert bpy.ops.anyface.sounds_read(filepath={sounds!r}) == {{"FINISHED"}}
after_sounds = rendered()
texts = sum(strip.type == "TEXT" for strip in strips)
print("TEXTS", texts, "SAME", before == after_event, before == after_sounds)
"""


@pytest.fixture(scope="module")
def blender(tmp_path_factory):
    """`blender(…)` runs the executable with its own folder of user files."""
    path = os.environ.get("ANYFACE_BLENDER") or shutil.which("blender")
    if path is None:
        pytest.skip("no blender executable here")
    text = subprocess.run([path, "--version"], capture_output=True, text=True, check=True).stdout
    version = tuple(int(word) for word in re.search(r"Blender (\d+)\.(\d+)", text).groups())
    if version < (4, 2):
        pytest.skip(f"this blender is too old for extensions: {version}")
    folder = tmp_path_factory.mktemp("blender")
    environment = {**os.environ, "BLENDER_USER_RESOURCES": str(folder)}

    def run(*words):
        command = [path, "-b", *(str(word) for word in words)]
        return subprocess.run(command, env=environment, capture_output=True, text=True, check=False)

    zipped = folder / "anyface.zip"
    shutil.copy(zip_path(), zipped)
    words = ("install-file", "-r", "user_default", "-e", zipped)
    done = run("--command", "extension", *words)
    assert done.returncode == 0, done.stdout + done.stderr
    run.folder = folder
    return run


def test_the_command_bakes_a_strip(blender, voice):  # noqa: F811
    folder = blender.folder
    sound, head = folder / "voice.wav", folder / "head.obj"
    shutil.copy(voice[0], sound)
    shutil.copy(HEAD, head)
    shot, out = folder / "shot.blend", folder / "out.blend"
    script = folder / "shot.py"
    script.write_text(SHOT.format(head=str(head), voice=str(sound), shot=str(shot)))
    done = blender("--python-exit-code", "1", "--python", script)
    assert done.returncode == 0, done.stdout + done.stderr
    bake = ("--command", "anyface", "bake", "--object", "Head", "--strip")
    done = blender(shot, *bake, "Voice", "--save", out)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "shape keys" in done.stdout
    done = blender(out, "--python-exit-code", "1", "--python-expr", LOOK)
    assert "KEYS ['Basis', 'Anyface.jaw']" in done.stdout, done.stdout + done.stderr
    first, last = (float(word) for word in re.search(r"RANGE (\S+) (\S+)", done.stdout).groups())
    # Motion begins 0.15 s before the strip; its keys stand on whole frames.
    assert first == math.floor(21 - 0.15 * 24) and last > 60
    done = blender(shot, *bake, "Nothing", "--save", folder / "none.blend")
    assert done.returncode == 4 and "got 'Nothing'" in done.stderr
    assert not (folder / "none.blend").exists()


def test_the_command_does_a_batch(blender, voice):  # noqa: F811
    folder = blender.folder
    sound, head = folder / "words.wav", folder / "face.obj"
    shutil.copy(voice[0], sound)
    shutil.copy(HEAD, head)
    shot, script = folder / "scene.blend", folder / "scene.py"
    script.write_text(SHOT.format(head=str(head), voice=str(sound), shot=str(shot)))
    assert blender("--python", script).returncode == 0
    rows = [
        {"save": "one.blend", "strip": "Voice"},
        {"save": "two.blend", "strip": "Nothing"},
    ]
    jobs = folder / "jobs.json"
    defaults = {"file": "scene.blend", "object": "Head"}
    jobs.write_text(json.dumps({"defaults": defaults, "shots": rows}))
    done = blender("--command", "anyface", "batch", jobs)
    assert done.returncode == 12, done.stdout + done.stderr
    assert (folder / "one.blend").exists() and not (folder / "two.blend").exists()
    outcomes = [
        json.loads((folder / f"jobs.reports/{name}.json").read_text()) for name in ("one", "two")
    ]
    assert outcomes[0]["faces"][0]["largest_mm"] > 1.0 and outcomes[1]["exit_code"] == 4


def test_strips_of_events_and_sounds_leave_the_render_as_it_was(blender, voice):  # noqa: F811
    folder = blender.folder
    sound, head, closures = folder / "spoken.wav", folder / "face.obj", folder / "closures.txt"
    shutil.copy(voice[0], sound)
    shutil.copy(HEAD, head)
    closures.write_text("0.1 0.2 p\n0.4 0.5 b\n")
    names = {"picture": folder / "picture.png", "voice": sound, "head": head, "sounds": closures}
    script = folder / "render.py"
    script.write_text(RENDER.format(**{name: str(path) for name, path in names.items()}))
    done = blender("--python-exit-code", "1", "--python", script)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "TEXTS 3 SAME True True" in done.stdout, done.stdout + done.stderr
