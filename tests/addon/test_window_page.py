"""Follows docs/blender.md in a real window, from the sample head to a file for an engine.

The tests press the buttons that the page names, in its order. The pictures go to the folder
`ANYFACE_PHOTOGRAPHS`.
"""

import json
import shutil
import struct
from pathlib import Path

import pytest

from conftest import ROOT
from screen import HEAD_AND_SIDEBAR, PREFERENCES, WITH_CHANNELS
from test_heads import voice  # noqa: F401 - a fixture
from test_window import MORE, REDRAW, photographs, screen  # noqa: F401 - fixtures

PACKAGE = "bl_ext.user_default.anyface"
# Opens these panels and closes the others, as clicks on their headers would. Each panel gets a new
# `bl_idname`, because the option counts only until a panel is first drawn.
OPEN = """
import importlib
addon = importlib.import_module('bl_ext.user_default.anyface')
for cls in [cls for cls in addon._CLASSES if issubclass(cls, bpy.types.Panel)]:
    options = set(getattr(cls, 'bl_options', set()))
    if 'HIDE_HEADER' in options or cls.bl_label == 'Anyface':
        continue
    bpy.utils.unregister_class(cls)
    cls.bl_options = options - {{'DEFAULT_CLOSED'}} if cls.bl_label in {labels!r} else (
        options | {{'DEFAULT_CLOSED'}})
    cls.bl_idname = cls.__name__ + '{suffix}'
    bpy.utils.register_class(cls)
"""
# Opens the sequencer below the 3D view. `VIEW_ALL` then brings all strips into sight.
SEQUENCER = """
window, area, region, _ = area_of('VIEW_3D')
with bpy.context.temp_override(window=window, area=area, region=region):
    bpy.ops.screen.area_split(direction='HORIZONTAL', factor=0.3)
views = [a for a in window.screen.areas if a.type == 'VIEW_3D']
min(views, key=lambda a: a.y).type = 'SEQUENCE_EDITOR'
"""
VIEW_ALL = """
window = bpy.context.window_manager.windows[0]
area = next(a for a in window.screen.areas if a.type == 'SEQUENCE_EDITOR')
region = next(r for r in area.regions if r.type == 'WINDOW')
with bpy.context.temp_override(window=window, area=area, region=region):
    bpy.ops.sequencer.select_all(action='SELECT')
    bpy.ops.sequencer.view_selected()
"""
ADD_HEAD = """
window, area, region, side = area_of('VIEW_3D')
for ob in list(bpy.data.objects):
    bpy.data.objects.remove(ob)
for strip in list(bpy.context.scene.sequence_editor.sequences):
    bpy.context.scene.sequence_editor.sequences.remove(strip)
with bpy.context.temp_override(window=window, area=area, region=region):
    bpy.ops.anyface.add_sample_head('INVOKE_DEFAULT')
    bpy.ops.view3d.view_axis(type='FRONT')
    bpy.ops.view3d.view_selected()
bpy.context.object.name = 'Head'
bpy.context.scene.anyface.synced = False
bpy.context.scene.sync_mode = 'NONE'
answer = bpy.context.object.type
"""
MENU = """
drawn = []
class Layout:
    def operator(self, name, **_):
        drawn.append(name)
        return self
    menu = operator
    def separator(self, **_):
        pass
for draw in bpy.types.VIEW3D_MT_mesh_add._dyn_ui_initialize():
    try:
        draw(type('Menu', (), {'layout': Layout()})(), bpy.context)
    except Exception:
        pass
answer = drawn
"""
HEAD = "bpy.data.objects['Head']"
REPORT = f"answer = {HEAD}.anyface.report"
TEXTS = "[s for s in bpy.context.scene.sequence_editor.sequences_all if s.type == 'TEXT']"
PLAYED = "[c.evaluate(f) for c in bpy.data.objects['Head'].data.shape_keys.animation_data.action.fcurves for f in {frames}]"  # noqa: E501


def show(screen, *labels, suffix=""):  # noqa: F811
    """Opens panels under *More*."""
    screen.ask(OPEN.format(labels=labels, suffix=suffix) + MORE.format(True) + "\n" + REDRAW)
    screen.hand("sleep", "0.7")


def test_a_first_talking_head(screen, photographs):  # noqa: F811
    assert "ANYFACE_MT_sample_heads" in screen.ask(MENU)
    assert screen.ask(ADD_HEAD) == "MESH"
    screen.hand("sleep", "0.5")
    assert not screen.ask("answer = bpy.ops.anyface.generate.poll()"), "no sound yet"
    # Choose a Sound File… opens the file browser. The test closes it and passes a path instead.
    screen.press("anyface.choose_sound")
    window_count = "len(bpy.context.window_manager.windows)"
    screen.wait(f"{window_count} > 1 or any(a.type == 'FILE_BROWSER' for w in "
                "bpy.context.window_manager.windows for a in w.screen.areas)", 20)  # fmt: skip
    screen.hand("key", "Escape", "sleep", "0.5")
    path = str(screen.folder / "voice.wav")
    screen.ask(f"bpy.ops.anyface.choose_sound(filepath={path!r})\n{REDRAW}")
    assert screen.ask(f"answer = {HEAD}.anyface.strip") == "voice"
    screen.hand("sleep", "0.5")
    screen.press("anyface.generate")
    screen.wait("keys() and not running()")
    report = screen.ask(REPORT)
    assert "shape keys" in report and "Sync to Audio" in report
    assert screen.ask("answer = bpy.context.scene.sync_mode") == "AUDIO_SYNC"
    screen.ask("bpy.context.scene.frame_set(50)")
    screen.hand("sleep", "1.5")
    screen.photograph(photographs / "pages/generated.png", HEAD_AND_SIDEBAR)


def test_sounds_are_shown_mended_redone_and_written(screen, photographs):  # noqa: F811
    # The strips of the sounds appear above the strip of the voice.
    assert screen.ask(f"answer = {HEAD}.anyface.source") == "STRIP"
    show(screen, "Mend", suffix="_a")
    screen.ask(SEQUENCER)
    screen.hand("sleep", "0.5")
    screen.scroll(5)
    screen.press("anyface.sounds_show")
    screen.wait(f"{TEXTS} and not running()", 60)
    outside = PLAYED.format(frames=[2, 15, 60, 80])
    before = screen.ask(f"answer = {outside}")
    screen.ask(
        "scene = bpy.context.scene\nscene.use_preview_range = True\n"
        "scene.frame_preview_end, scene.frame_preview_start = 45, 25\n"
        f"{TEXTS}[0].frame_start += 4\n{HEAD}.anyface.seed = 3\n" + VIEW_ALL + REDRAW
    )
    screen.hand("sleep", "3")
    screen.photograph(photographs / "pages/mend.png", WITH_CHANNELS)
    screen.press("anyface.redo")
    screen.wait(f"'redone' in {HEAD}.anyface.report and not running()", 60)
    after = screen.ask(f"answer = {outside}")
    # Cutting a curve at the ends of the redone stretch changes it only by rounding:
    # Blender keeps handles as single floats and solves a cubic for each frame.
    assert after[: len(before)] == pytest.approx(before, abs=1e-5)
    written = screen.folder / "shot.TextGrid"
    screen.ask(f"bpy.ops.anyface.sounds_write(filepath={str(written)!r})")
    assert '"MBP"' in written.read_text()
    screen.scroll(4)
    screen.photograph(photographs / "4_redone.png")


def test_models_of_ones_own_are_named_in_the_panel_and_the_preferences(screen, photographs):  # noqa: F811
    folder = screen.folder / "models"
    for model in ("shared/ear", "shared/face_modes", "freetalk/stm_paper"):
        shutil.copytree(ROOT / "weights" / model, folder / Path(model).name)
    screen.ask(f"bpy.context.scene.anyface.model_folder = {str(folder)!r}")
    show(screen, "Models", suffix="_b")
    screen.scroll(5)
    screen.photograph(photographs / "pages/models.png", HEAD_AND_SIDEBAR)
    screen.ask("bpy.context.scene.anyface.model_folder = ''")
    screen.ask(
        f"bpy.ops.preferences.addon_enable(module={PACKAGE!r})\n"
        "bpy.ops.screen.userpref_show()\n"
        "bpy.context.preferences.active_section = 'ADDONS'\n"
        "bpy.context.window_manager.addon_search = 'Anyface'\n"
        "import addon_utils\n"
        f"bpy.ops.preferences.addon_expand(module={PACKAGE!r})\n"
    )
    screen.hand("sleep", "3.0")
    screen.photograph(photographs / "pages/preferences.png", PREFERENCES)
    screen.ask(
        "window = bpy.context.window_manager.windows[-1]\n"
        "with bpy.context.temp_override(window=window):\n    bpy.ops.wm.window_close()\n"
    )
    screen.hand("sleep", "0.5")


def test_what_was_made_is_exported_as_the_page_says(screen):  # noqa: F811
    for suffix, code in (
        ("glb", "bpy.ops.export_scene.gltf(filepath={path!r}, export_animations=True)"),
        ("fbx", "bpy.ops.export_scene.fbx(filepath={path!r}, bake_anim_use_nla_strips=False, "
                "bake_anim_use_all_actions=False)"),
    ):  # fmt: skip
        path = screen.folder / f"talk.{suffix}"
        screen.ask("bpy.ops.preferences.addon_enable(module='io_scene_%s')" % (
            "gltf2" if suffix == "glb" else "fbx"))  # fmt: skip
        screen.ask(code.format(path=str(path)))
        assert path.stat().st_size > 100_000
    content = (screen.folder / "talk.glb").read_bytes()
    (length,) = struct.unpack_from("<I", content, 12)
    scene = json.loads(content[20 : 20 + length])
    targets = scene["meshes"][0]["primitives"][0]["targets"]
    (animation,) = scene["animations"]
    assert len(targets) > 2 and animation["channels"][0]["target"]["path"] == "weights"
