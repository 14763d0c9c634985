"""Every job ends with a message, whatever is raised, and wherever: a generated test.

Each job runs once to record the functions that it calls. Then it runs again for each function,
which now raises an error. A function raises only in the first job that calls it. With
`ANYFACE_EVERY_STEP=1` it raises in every job that calls it.
"""

import os
import shutil
from pathlib import Path
from types import SimpleNamespace

import bpy
import numpy as np
import pytest
from mathutils import Vector

import figures
from faults import ERRORS, TIMER, Fault, WholeStage, press, steps_of, without_blender
from figures import SETTINGS, animation_rows, everything, grid, motion, own_keys, stand_in, tone
from test_control_takes import Waves, rigged

START = 5
EVERY = bool(os.environ.get("ANYFACE_EVERY_STEP"))
# Functions that have raised in an earlier job.
tried = set()
# Name: module and class of the operator, and the output mode.
JOBS = {
    "basis": ("ui.generate", "ANYFACE_OT_generate", "basis"),
    "frames": ("ui.generate", "ANYFACE_OT_generate", "frames"),
    "cache": ("ui.generate", "ANYFACE_OT_generate", "cache"),
    "keys": ("ui.generate", "ANYFACE_OT_generate", "keys"),
    "arkit": ("ui.generate", "ANYFACE_OT_generate", "arkit"),
    "csv": ("ui.generate", "ANYFACE_OT_generate", "csv"),
    "scene": ("ui.scene_list", "ANYFACE_OT_generate_scene", "basis"),
    "redo basis": ("ui.sounds", "ANYFACE_OT_redo", "basis"),
    "redo frames": ("ui.sounds", "ANYFACE_OT_redo", "frames"),
    "redo cache": ("ui.sounds", "ANYFACE_OT_redo", "cache"),
    "redo csv": ("ui.sounds", "ANYFACE_OT_redo", "csv"),
    "find face": ("ui.landmarks", "ANYFACE_OT_find_face", "basis"),
    "expression keys": ("ui.expression_keys", "ANYFACE_OT_expression_keys", "basis"),
    "heat": ("ui.heat", "ANYFACE_OT_heat_map", "basis"),
    "live": ("ui.live", "ANYFACE_OT_live", "basis"),
    "listen": ("ui.listening", "ANYFACE_OT_listen", "basis"),
    "sounds": ("ui.sounds", "ANYFACE_OT_sounds_show", "basis"),
    "open mouth": ("ui.opening", "ANYFACE_OT_open_mouth", "basis"),
    "open eyes": ("ui.opening", "ANYFACE_OT_open_eyes", "basis"),
    "controls": ("ui.generate", "ANYFACE_OT_generate", "controls"),
    "redo controls": ("ui.sounds", "ANYFACE_OT_redo", "controls"),
    "find controls": ("ui.find_controls", "ANYFACE_OT_controls_find", "controls"),
}
OPTIONS = {"expression keys": {"by": "NETWORK"}}
NO_TAKE = (
    "find face", "expression keys", "live", "listen", "heat", "open mouth", "open eyes",
)  # fmt: skip


class Set:
    """A face that is set up for a job. The next job uses it again if a job was cancelled."""

    def __init__(self, addon, monkeypatch, tmp_path, name):
        self.addon, self.name, self.folder = addon, name, tmp_path
        module, self.operator, self.mode = JOBS[name]
        self.module = addon(module)
        monkeypatch.setattr(addon("ui.operators"), "bpy", _Through())
        is_rigged = self.mode == "controls"
        stand_in(addon, (WavingStage if is_rigged else WholeStage)(addon("core.take")))
        bpy.context.scene.render.fps = 24
        ob = rigged(tmp_path) if is_rigged else grid()
        teeth = grid("Teeth_low", 5, 0.05)
        ob.anyface.source, ob.anyface.start_frame = "FILE", START
        ob.anyface.sound_file = tone(tmp_path / "tone.wav", 1.0)
        if not is_rigged:
            part = ob.anyface_face.parts.add()
            part.object, part.name, part.role = teeth, teeth.name, "jaw"
        if self.mode == "keys":
            _spread(own_keys(ob, "jawOpen", "mouthFunnel"), len(teeth.data.vertices))
        elif self.mode not in ("frames", "csv", "controls"):
            own_keys(ob, "Smile")
        ob.anyface.mode = self.mode
        empty = bpy.data.objects.new("Turns", None)
        bpy.context.scene.collection.objects.link(empty)
        ob.anyface_life_settings.head, ob.anyface_life_settings.head_object = "OBJECT", empty
        bpy.context.view_layer.objects.active = ob
        bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "shot.blend"))
        scene = bpy.context.scene
        if name not in NO_TAKE and name != "find controls":
            assert bpy.ops.anyface.generate() == {"FINISHED"}, "an earlier take is there"
        if name == "scene":
            row = scene.anyface_list.add()
            row.character = self.ob
        scene.use_preview_range = True
        scene.frame_preview_start, scene.frame_preview_end = START + 5, START + 15
        bpy.context.scene.frame_set(1)

    @property
    def ob(self):
        """The face, looked up anew because undo may have replaced it."""
        return bpy.data.objects["Head"]

    def press(self):
        """Runs the job. Returns how it ended, its messages, and how many timers still run."""
        operator = getattr(self.module, self.operator)
        button = without_blender(operator, **OPTIONS.get(self.name, {}))
        word, manager = press(button, self.ob)
        return word, button.messages, manager.timers

    def state(self):
        """All of the scene, the settings that a job writes, and the files."""
        files = sorted(
            (str(path.relative_to(self.folder)), path.read_bytes())
            for path in Path(self.folder).rglob("*")
            if path.is_file() and path.suffix != ".blend" and "cache" not in path.parts[-3:-1]
        )
        turns = [str(block.items()) for block in (bpy.data.objects["Turns"],)]
        delta = tuple(bpy.data.objects["Turns"].delta_rotation_euler)
        modifiers = [(m.type, m.name) for ob in bpy.data.objects for m in ob.modifiers]
        live = self.addon("scene.live")._followers
        scenes = [sorted(set(scene.keys()) - SETTINGS) for scene in bpy.data.scenes]
        moved = [row for ob in bpy.data.objects for row in _motion_of(ob)]
        return everything(), files, turns, delta, modifiers, len(live), scenes, moved


def _motion_of(ob) -> list:
    """The animation of an object, and the pose of its bones."""
    bones = ob.pose.bones if ob.type == "ARMATURE" else ()
    poses = [str([round(x, 5) for row in bone.matrix_basis for x in row]) for bone in bones]
    return [ob.name, *animation_rows(ob.animation_data), *poses]


class WavingStage(Waves, WholeStage):
    """A stage whose motion bones can follow."""


def _spread(shape_keys, others: int) -> None:
    """Gives the keys the shapes of two frames of a stage's motion."""
    rest, *blocks = shape_keys.key_blocks
    count = len(rest.points)
    moved = motion(24, count + others)[:, :count]
    for number, block in enumerate(blocks):
        for vertex, by in enumerate(moved[8 * number + 4]):
            block.points[vertex].co = rest.points[vertex].co + Vector(by)


class _Through:
    """Stands in for `bpy` with a window."""

    app = SimpleNamespace(background=False)

    def __getattr__(self, name):
        return getattr(bpy, name)


@pytest.mark.parametrize("name", JOBS)
def test_every_job_ends_with_a_message(addon, installed, monkeypatch, tmp_path, name):
    folder = tmp_path / "shots"

    def fresh():
        # Windows cannot delete a file that the scene holds open, so empty the scene first.
        bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir()
        return Set(addon, monkeypatch, folder, name)

    ready_set = fresh()
    with Fault(installed) as fault:
        word, messages, timers = ready_set.press()
    assert (word, timers) == ("FINISHED", 0), messages
    steps = steps_of(fault.calls, installed)
    steps = [step for step in steps if EVERY or step[0] not in tried]
    tried.update(code for code, _ in steps)
    ready_set, failures = fresh(), []
    before = ready_set.state()
    for number, (code, calls) in enumerate(steps):
        error = ERRORS[number % len(ERRORS)]()
        at = calls if number % 2 else 1
        where = f"{Path(code.co_filename).name}:{code.co_name} {at}/{calls} {type(error).__name__}"
        print(where)
        try:
            with Fault(installed, code, at, error):
                word, messages, timers = ready_set.press()
        except BaseException as raised:
            failures.append(f"{where}: raised {type(raised).__name__}: {raised}")
            word, messages, timers = "RAISED", [], 0
        if addon("ui.running").is_running() or timers:
            failures.append(f"{where}: still runs")
            addon("ui.running").finish()
        after = ready_set.state()
        if word == "CANCELLED" and (
            not messages or not messages[-1][1].strip() or "Trace" in messages[-1][1]
        ):
            failures.append(f"{where}: told {messages}")
        if word == "CANCELLED" and after != before:
            failures.append(f"{where}: {_difference(before, after)}")
        if word != "CANCELLED" or after != before:
            # The error did not matter or came after the result. Go on with a fresh face.
            ready_set = fresh()
            before = ready_set.state()
    word, messages, timers = ready_set.press()
    if (word, timers) != ("FINISHED", 0):
        failures.append(f"the next job: {word}, {messages}")
    print(f"{name}: {len(steps)} steps")
    assert not failures, "\n".join(failures)


def _difference(before, after) -> str:
    differences = []
    for was, is_now in zip(before, after, strict=True):
        if was != is_now and isinstance(was, list):
            differences.append(f"gone {[x for x in was if x not in is_now][:4]}")
            differences.append(f"new {[x for x in is_now if x not in was][:4]}")
        elif was != is_now:
            differences.append(f"{was} → {is_now}")
    return "; ".join(str(text)[:300] for text in differences)


@pytest.fixture
def ready(addon, monkeypatch, tmp_path):
    """A face with an earlier take, about to get another."""
    return Set(addon, monkeypatch, tmp_path, "basis")


def break_writing(addon, monkeypatch, error=MemoryError):
    """Makes a take fail at its curves, when its keys exist already."""
    play = addon("scene.takes.keys").play

    def broken(ob, take_record):
        yield from play(ob, take_record)
        raise error()

    monkeypatch.setattr(addon("scene.takes.keys"), "play", broken)


@pytest.mark.parametrize("mode", ["EDIT", "SCULPT"])
def test_a_face_in_another_mode_is_as_it_was_and_in_that_mode(addon, monkeypatch, ready, mode):
    before = ready.state()
    with bpy.context.temp_override(active_object=ready.ob, object=ready.ob):
        bpy.ops.object.mode_set(mode=mode)
    break_writing(addon, monkeypatch)
    word, messages, _ = ready.press()
    assert word == "CANCELLED" and "memory is full" in messages[-1][1]
    assert ready.ob.mode == mode
    with bpy.context.temp_override(active_object=ready.ob, object=ready.ob):
        bpy.ops.object.mode_set(mode="OBJECT")
    assert ready.state() == before


def test_what_the_artist_did_while_it_was_written_is_no_way_out(addon, monkeypatch, ready):
    before = ready.state()
    play = addon("scene.takes.keys").play

    def broken(ob, take_record):
        yield from play(ob, take_record)
        bpy.data.objects["Turns"].location.x = 1.0
        bpy.ops.ed.undo_push(message="Move")
        raise ValueError("late")

    monkeypatch.setattr(addon("scene.takes.keys"), "play", broken)
    assert ready.press()[0] == "CANCELLED"
    assert ready.state() == before


def test_without_undo_the_artist_is_told_what_stays(addon, monkeypatch, ready):
    edit = bpy.context.preferences.edit
    monkeypatch.setattr(edit, "use_global_undo", False)
    break_writing(addon, monkeypatch)
    word, messages, _ = ready.press()
    assert word == "CANCELLED" and "Global Undo is off" in messages[-1][1]
    assert not addon("ui.running").is_running()


def test_a_face_that_is_deleted_while_it_is_written(addon, monkeypatch, ready):
    play = addon("scene.takes.keys").play

    def broken(ob, take_record):
        bpy.data.objects.remove(ob)
        yield from play(ob, take_record)

    monkeypatch.setattr(addon("scene.takes.keys"), "play", broken)
    word, messages, _ = ready.press()
    assert word == "CANCELLED" and "deleted or undone" in messages[-1][1]
    assert not addon("ui.running").is_running()


def test_a_system_that_gives_no_thread(addon, monkeypatch, ready):
    before = ready.state()

    def refuse(_thread):
        raise RuntimeError("can't start new thread")

    with monkeypatch.context() as broken:
        broken.setattr(addon("core.job").threading.Thread, "start", refuse)
        word, messages, timers = ready.press()
    assert (word, timers) == ("CANCELLED", 0) and "can't start new thread" in messages[-1][1]
    assert not addon("ui.running").is_running() and ready.state() == before
    assert ready.press()[0] == "FINISHED"


def test_a_script_is_told_and_finds_the_scene_as_it_was(addon, monkeypatch, ready):
    before = ready.state()
    with monkeypatch.context() as broken:
        break_writing(addon, broken, SystemExit)
        with pytest.raises(RuntimeError, match="stopped by itself"):
            bpy.ops.anyface.generate()
    assert ready.state() == before
    assert bpy.ops.anyface.generate() == {"FINISHED"}


def test_dragging_points_ends_whatever_is_raised(addon, installed, monkeypatch, tmp_path):
    ready_set = Set(addon, monkeypatch, tmp_path, "find face")
    assert ready_set.press()[0] == "FINISHED"
    module, in_view = addon("ui.landmarks"), addon("ui.in_view")
    for each in (module, in_view):
        monkeypatch.setattr(each, "bpy", _Through())
    before, failures = ready_set.state(), []
    view = (None, None, (0.0, 0.0))
    monkeypatch.setattr(in_view, "view_under", lambda context, event: view)
    monkeypatch.setattr(module, "on_screen", lambda *_: np.zeros((68, 2)))

    def drag():
        """Presses and releases a point, then waits until the other points have followed."""
        operator = without_blender(module.ANYFACE_OT_edit_landmarks)
        context = figures.window(ready_set.ob)
        context.region_data = object()
        context.workspace = type("Workspace", (), {"status_text_set": lambda self, text: None})()
        result = operator.invoke(context, TIMER)
        for kind, value in (("LEFTMOUSE", "PRESS"), ("LEFTMOUSE", "RELEASE")):
            if result == {"RUNNING_MODAL"}:
                result = operator.modal(context, SimpleNamespace(type=kind, value=value))
        for _ in range(2000):
            if result != {"RUNNING_MODAL"} or not addon("ui.running").is_running():
                break
            result = operator.modal(context, TIMER)
        if result == {"RUNNING_MODAL"}:
            result = operator.modal(context, SimpleNamespace(type="RET", value="PRESS"))
        return result, operator.messages, context.window_manager.timers

    with Fault(installed) as fault:
        result, messages, timers = drag()
    assert (result, messages, timers) == ({"FINISHED"}, [], 0)
    for number, (code, _) in enumerate(steps_of(fault.calls, installed)):
        error = ERRORS[number % len(ERRORS)]()
        where = f"{code.co_name} {type(error).__name__}"
        with Fault(installed, code, 1, error):
            result, messages, timers = drag()
        still = timers or addon("ui.running").is_running()
        if still or (result != {"FINISHED"} and not messages):
            failures.append(f"{where}: {result} {messages} {timers}")
    assert drag()[0] == {"FINISHED"} and not failures, failures
    assert ready_set.state()[0] == before[0]
