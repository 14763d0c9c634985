"""Operates the panel with mouse and keyboard in a real Blender window.

`ANYFACE_BLENDER` names the executable. Its folder must hold the script `enter`, which
packaging/chroot.sh makes. `ANYFACE_PHOTOGRAPHS` names a folder for the pictures.
"""

import os
import shutil
from pathlib import Path

import numpy as np
import pytest

from conftest import zip_path
from figures import write_wav
from screen import HEAD_AND_SIDEBAR, Screen, install_in
from test_heads import HEAD, voice  # noqa: F401 - a fixture

SCENE = """
for ob in list(bpy.data.objects):
    bpy.data.objects.remove(ob)
window, area, region, _ = area_of('VIEW_3D')
with bpy.context.temp_override(window=window, area=area, region=region):
    bpy.ops.wm.obj_import(filepath={head!r}, use_split_objects=False, use_split_groups=False)
    ob = bpy.context.object
    ob.name = "Head"
    bpy.ops.object.shade_smooth()
    area.spaces[0].show_region_ui = True
    bpy.ops.view3d.view_axis(type='FRONT')
    bpy.ops.view3d.view_selected()
scene = bpy.context.scene
editor = scene.sequence_editor_create()
strips = editor.strips if hasattr(editor, "strips") else editor.sequences
strips.new_sound("Voice", {voice!r}, 1, 1)
ob.anyface.strip = "Voice"
ob.anyface.error_mm = 0.5
bpy.ops.wm.save_as_mainfile(filepath={shot!r})
bpy.ops.ed.undo_push(message="scene")
answer = len(ob.data.vertices)
"""
TAB = "_, _, _, side = area_of('VIEW_3D')\nside.active_panel_category = 'Anyface'"
# Blender draws what a script has changed only after this.
REDRAW = "area_of('VIEW_3D')[1].tag_redraw()"
MORE = "bpy.context.window_manager.anyface_more = {}"


@pytest.fixture(scope="module")
def photographs(tmp_path_factory):
    """The folder for the pictures."""
    folder = os.environ.get("ANYFACE_PHOTOGRAPHS")
    return Path(folder) if folder else tmp_path_factory.mktemp("photographs")


@pytest.fixture(scope="module")
def screen(tmp_path_factory, voice):  # noqa: F811
    """A Blender window that shows a head, a strip and the panel."""
    path = os.environ.get("ANYFACE_BLENDER")
    enter = Path(path).with_name("enter") if path else None
    if enter is None or not enter.exists():
        pytest.skip("no Blender with a display here")
    folder = tmp_path_factory.mktemp("window")
    install_in(Path(path), zip_path(), folder)
    screen = Screen(enter, Path(path), folder)
    shutil.copy(HEAD, folder / "head.obj")
    shutil.copy(voice[0], folder / "voice.wav")
    text = SCENE.format(
        head=str(folder / "head.obj"), voice=str(folder / "voice.wav"), shot=str(folder / "s.blend")
    )
    assert screen.ask(text) > 8000
    screen.hand("mousemove", 400, 400, "click", "1", "key", "Escape")
    screen.ask(TAB)
    yield screen
    screen.close()


def test_a_performance_is_made_undone_redone_saved_reloaded_and_removed(screen, photographs):
    screen.photograph(photographs / "1_before.png")
    screen.press("anyface.generate")
    screen.wait("keys() and not running()")
    screen.ask("bpy.context.scene.frame_set(50)")
    screen.hand("sleep", "0.5")
    screen.photograph(photographs / "2_generated.png")
    count = screen.ask("answer = keys()")
    assert count > 2
    screen.hand("mousemove", 400, 400, "key", "ctrl+z")
    screen.wait("not keys()")
    screen.hand("key", "ctrl+shift+z")
    screen.wait(f"keys() == {count}")
    screen.photograph(photographs / "3_redone.png")
    screen.hand("key", "ctrl+s")
    screen.wait("not bpy.data.is_dirty")
    screen.ask("bpy.ops.wm.revert_mainfile()")
    screen.wait(f"keys() == {count}")
    screen.ask(TAB)
    screen.press("anyface.remove")
    screen.wait("not keys()")
    screen.photograph(photographs / "4_removed.png")


def test_all_of_the_first_screen_is_in_sight_and_more_opens_with_a_click(screen, photographs):
    open_more = "answer = bpy.context.window_manager.anyface_more"
    x, y = screen.find("anyface.generate")
    # `find` gives the upper edge of the button. *More* is below the button.
    for below in range(34, 90, 6):
        screen.hand("mousemove", x, y + below, "sleep", "0.1", "click", "1", "sleep", "0.3")
        if screen.ask(open_more):
            break
    assert screen.ask(open_more)
    assert screen.find("anyface.find_face")[1] > y + below
    screen.photograph(photographs / "pages/output.png", HEAD_AND_SIDEBAR)
    screen.hand("mousemove", x, y + below, "sleep", "0.1", "click", "1", "sleep", "0.3")
    assert not screen.ask(open_more)


def test_a_slider_is_dragged_and_undone_in_one_step(screen, photographs):
    screen.press("anyface.generate")
    screen.wait("keys() and not running()")
    screen.ask(MORE.format(True))
    screen.hand("sleep", "0.5")
    value = "bpy.data.objects['Head'].anyface_output.articulation"
    screen.scroll(5)
    x, y = screen.find_slider("anyface_output.articulation")
    screen.hand("mousemove", x, y, "sleep", "0.2", "mousedown", "1")
    for _ in range(6):
        screen.hand("mousemove_relative", "--", "-6", "0", "sleep", "0.05")
    screen.hand("mouseup", "1", "sleep", "0.3")
    screen.wait(f"{value} != 1.0", 20)
    screen.photograph(photographs / "8_slider.png")
    screen.hand("mousemove", 400, 400, "key", "ctrl+z")
    screen.wait(f"{value} == 1.0", 20)
    assert screen.ask("answer = bool(keys())")
    screen.scroll(4)
    screen.ask(MORE.format(False))
    screen.hand("sleep", "0.5")
    screen.press("anyface.remove")
    screen.wait("not keys()")


BREAK = """
import importlib
keys_module = importlib.import_module("bl_ext.user_default.anyface.scene.takes.keys")
whole = keys_module.play
def broken(ob, take_record):
    yield from whole(ob, take_record)
    raise MemoryError
keys_module.play, keys_module.whole = broken, whole
"""
MEND = """
import importlib
keys_module = importlib.import_module("bl_ext.user_default.anyface.scene.takes.keys")
keys_module.play = keys_module.whole
"""
PRINT = """
keys_of = bpy.data.objects["Head"].data.shape_keys
curves_of = keys_of.animation_data.action
answer = [len(keys_of.key_blocks), keys_of["anyface"], curves_of.name, list(curves_of.frame_range)]
answer += [sorted(bpy.context.scene.keys()), len(bpy.data.actions), len(bpy.data.meshes)]
"""


def test_a_take_that_breaks_while_it_is_written_leaves_the_earlier_one(screen):
    screen.press("anyface.generate")
    screen.wait("keys() and not running()")
    before = screen.ask(PRINT)
    screen.ask(BREAK)
    screen.press("anyface.generate")
    screen.wait("'memory is full' in bpy.data.objects['Head'].anyface.report and not running()")
    assert screen.ask(PRINT) == before
    screen.ask(MEND)
    screen.press("anyface.generate")
    screen.wait("'memory' not in bpy.data.objects['Head'].anyface.report and not running()")
    assert screen.ask(PRINT)[1] != before[1]
    screen.press("anyface.remove")
    screen.wait("not keys()")


def test_escape_stops_a_running_job_and_leaves_nothing(screen, photographs, voice):  # noqa: F811
    # Ten minutes of sound take long enough to stop the job while it runs.
    _, samples, rate = voice
    write_wav(screen.folder / "long.wav", np.resize(samples, 600 * rate), rate)
    screen.ask(
        "settings = bpy.data.objects['Head'].anyface\n"
        f"settings.source, settings.sound_file = 'FILE', {str(screen.folder / 'long.wav')!r}\n"
        + REDRAW
    )
    screen.hand("sleep", "0.5")
    screen.press("anyface.generate")
    screen.wait("running()", 20)
    screen.photograph(photographs / "5_running.png")
    screen.hand("mousemove", 400, 400, "key", "Escape")
    screen.wait("not running()", 20)
    assert not screen.ask("answer = bool(keys())")
    screen.photograph(photographs / "6_cancelled.png")


def test_the_add_on_is_disabled_and_enabled_again_while_a_job_runs(screen, photographs):
    name = "'bl_ext.user_default.anyface'"
    screen.press("anyface.generate")
    screen.wait("running()", 20)
    screen.ask(f"bpy.ops.preferences.addon_disable(module={name})")
    assert not screen.ask("answer = hasattr(bpy.types.Object, 'anyface')")
    screen.hand("mousemove", 400, 400, "sleep", "0.3", "mousemove", 420, 420, "key", "Escape")
    screen.photograph(photographs / "7_disabled.png")
    screen.ask(f"bpy.ops.preferences.addon_enable(module={name})")
    screen.ask(TAB)
    assert not screen.ask("answer = bool(keys()) or running()")
    screen.ask(f"bpy.data.objects['Head'].anyface.source = 'STRIP'\n{REDRAW}")
    screen.hand("sleep", "0.5")
    screen.press("anyface.generate")
    screen.wait("keys() and not running()")
    screen.photograph(photographs / "8_enabled_again.png")
