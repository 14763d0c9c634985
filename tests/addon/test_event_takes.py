"""Takes with events: sliders, redo of a stretch, Esc, undo, copies, batches."""

import hashlib
import json

import bpy
import numpy as np
import pytest

from figures import (
    FPS,
    duplicate,
    everything,
    film,
    grid,
    link_from_library,
    select,
    stand_in,
    strip,
    tone,
)
from floor import Floor
from test_events import (
    CHANNEL,
    SECONDS,
    START,
    SYSTEM,
    change,
    editor_strips,
    put,
    speaking,  # noqa: F401 - a fixture
    weights_of,
)

FRAMES = range(START, START + int(SECONDS * FPS), 3)


def strip_rows(addon):
    """Everything that an artist sees of each text strip."""
    strips = addon("scene.sound.sequencer").all_strips(bpy.context.scene)
    texts = [s for s in strips if s.type == "TEXT"]
    ends = addon("scene.sound.sequencer").ends
    return [(s.name, s.text, s.channel, ends(s), s.blend_alpha, s.mute) for s in texts]


@pytest.fixture
def bare(addon, speaking):  # noqa: F811
    """The speaking head without keys of its own: basis keys, a happy emotion and one event."""
    ob = speaking
    ob.shape_key_clear()
    ob.anyface.mode, ob.anyface.emotion, ob.anyface.intensity = "basis", "happy", 0.8
    ob.anyface.blinks_per_minute = 40.0
    put(addon, "smile", START + FPS, START + 2 * FPS)
    return ob


def generate(ob):
    """Generates with the panel as it is. This sets every slider back to 1."""
    assert bpy.ops.anyface.generate() == {"FINISHED"}, ob.anyface.report


# Sliders.


@pytest.mark.parametrize(
    ("slider", "setting", "value", "mean_mm"),
    [
        ("articulation", "articulation", 0.4, 0.25),
        ("emotion", "intensity", 0.5, 0.25),
        ("closing", "blinks_per_minute", 0.0, 0.1),
    ],
)
def test_sliders_of_weights_come_near_to_new_runs(bare, slider, setting, value, mean_mm):
    ob = bare
    generate(ob)
    as_made = film(ob, FRAMES)
    setattr(ob.anyface_output, slider, value)
    changed = film(ob, FRAMES)
    setattr(ob.anyface_output, slider, 1.0)
    assert np.abs(film(ob, FRAMES) - as_made).max() < 1e-6
    now = getattr(ob.anyface, setting)
    setattr(ob.anyface, setting, value * now if slider != "closing" else value)
    generate(ob)
    anew = film(ob, FRAMES)
    mm = 1000.0 * np.linalg.norm(changed - anew, axis=2)
    still = 1000.0 * np.linalg.norm(as_made - anew, axis=2)
    # Only moving vertices count, as most of a head stays still.
    moving = still > 0.2
    assert moving.sum() > 100
    assert mm[moving].mean() < 0.25 * still[moving].mean(), (
        mm[moving].mean(),
        still[moving].mean(),
    )
    assert mm.mean() < mean_mm


def test_of_a_take_without_emotion_and_blinks_the_panel_says_why(addon, bare):
    ob = bare
    ob.anyface.emotion_source = "OFF"
    generate(ob)
    why = addon("scene.takes.adjust").why_not
    assert why(ob, "articulation") == ""
    assert "emotion off" in why(ob, "emotion") and "emotion off" in why(ob, "blinks")


def test_systems_say_which_sliders_they_have(addon):
    sliders_of = {system.name: system.sliders for system in addon("core.systems").known()}
    assert sliders_of == dict.fromkeys(sliders_of, addon("core.sliders").NAMES)
    why = addon("core.sliders").why_missing
    request = addon("core.take").Request(fps=24.0)
    assert set(why(request, {}, ()).values()) == {addon("core.sliders").NONE}
    assert "blinks" in why(request, {"articulation": None}, ("articulation", "blinks"))["blinks"]


# Redo of a stretch.


def redo(ob, first, last):
    """Presses *Redo* for the frames from `first` to `last`."""
    scene = bpy.context.scene
    scene.use_preview_range = True
    scene.frame_preview_start, scene.frame_preview_end = first, last
    assert bpy.ops.anyface.redo() == {"FINISHED"}, ob.anyface.report


def listed(ob):
    """A list made by hand: each eye's blink drives one key by half, the jaw drives two keys."""
    for name in ("Blink", "Open", "OpenMore"):
        ob.shape_key_add(name=name).points[0].co.z += 0.01
    rows = (("eyeBlinkLeft", "Blink", 0.5), ("eyeBlinkRight", "Blink", 0.5),
            ("jawOpen", "Open", 1.0), ("jawOpen", "OpenMore", 0.25))  # fmt: skip
    ob.anyface_output.mapping.clear()
    for shape, key, factor in rows:
        assert bpy.ops.anyface.mapping_add(shape=shape, key=key) == {"FINISHED"}
        ob.anyface_output.mapping[-1].factor = factor


def test_a_stretch_of_keys_with_shares_is_made_as_the_take_was(addon, speaking):  # noqa: F811
    ob = speaking
    listed(ob)
    put(addon, "blink", START + 30, START + 36)
    generate(ob)
    before = weights_of(ob)
    assert max(before["Blink"].values()) > 0.4 and max(before["Open"].values()) > 0.05
    for frame, value in before["Open"].items():
        assert before["OpenMore"][frame] == pytest.approx(0.25 * value, abs=1e-5)
    redo(ob, START + 10, START + 50)
    again = weights_of(ob)
    assert "as they were" in ob.anyface.report
    for name in before:
        assert change(before, again, name, list(before[name])) < 1e-5, name
    # The new motion keeps the shares of the list.
    put(addon, "jaw drop", START + 20, START + 40)
    redo(ob, START + 10, START + 50)
    dropped = weights_of(ob)
    inside = range(START + 25, START + 35)
    assert change(before, dropped, "Open", inside) > 0.2
    for frame in inside:
        share = dropped["OpenMore"][frame]
        assert share == pytest.approx(0.25 * dropped["Open"][frame], abs=1e-5)
    outside = [*range(START, START + 10), *range(START + 51, START + 70)]
    assert change(before, dropped, "Open", outside) == 0.0


@pytest.mark.parametrize("mode", ["basis", "arkit", "cache", "csv"])
def test_an_event_that_moved_is_redone_in_every_output(addon, bare, tmp_path, mode):
    ob = bare
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "a.blend"))
    ob = bpy.data.objects["Head"]
    ob.anyface.mode = mode
    ob.anyface_output.csv_file = str(tmp_path / "table.csv")
    generate(ob)
    put(addon, "jaw drop!", START + 50, START + 62)

    def numbers():
        if mode == "csv":
            lines = (tmp_path / "table.csv").read_text().splitlines()[1:]
            rows = [[float(x) for x in line.split(",")[2:]] for line in lines]
            return np.array([rows[frame - START] for frame in (*OUTSIDE, *INSIDE)])[:, None]
        return film(ob, (*OUTSIDE, *INSIDE))

    before = numbers()
    redo(ob, START + 46, START + 66)
    after = numbers()
    # Curve segments that were cut keep their shape except for rounding.
    rounding = 2e-6 if mode in ("basis", "arkit") else 0.0
    assert np.abs(after[: len(OUTSIDE)] - before[: len(OUTSIDE)]).max() <= rounding
    assert np.abs(after[len(OUTSIDE) :] - before[len(OUTSIDE) :]).max() > 0.005


OUTSIDE = (START + 5, START + 30, START + 46, START + 66, START + 70)
INSIDE = (START + 55, START + 58)


# Esc, crashes, undo.


def test_esc_at_any_stage_leaves_strips_keys_and_actions(addon, bare):
    ob, scene = bare, bpy.context.scene
    generate(ob)
    put(addon, "wink", START + 40, START + 50)
    rows = film(ob, FRAMES)
    before, strips = everything(), strip_rows(addon)
    settings = addon("ui.settings").from_object(ob, scene)
    engine = addon("ui.running").engine(settings.system, "")
    job, Cancelled = addon("core.job"), addon("core.errors").Cancelled
    stages = set()

    class Stopping(job.Progress):
        """Cancels at the stage of this name."""

        def __init__(self, stage):
            super().__init__()
            self.stage = stage

        def check(self, stage, fraction=0.0):
            stages.add(stage)
            if stage == self.stage:
                self.cancel()
            super().check(stage, fraction)

    for stage in ("sound", "write"):
        snapshot = addon("scene.bake").read(ob, scene, settings, engine)
        with pytest.raises(Cancelled):
            snapshot.work(Stopping(stage))
    assert {"sound", "write"} <= stages
    # Cancel within the library itself.
    snapshot = addon("scene.bake").read(ob, scene, settings, engine)
    progress = job.Progress()
    progress.cancel()
    with pytest.raises(Cancelled):
        voice, request = snapshot.source.load(engine.decode), snapshot.request
        addon("core.perform").perform(snapshot.face, voice, request, engine.animate, progress)
    # The take is made but not written: its landing is closed before the first step.
    take = snapshot.work(job.Progress())
    addon("scene.bake").landing(ob, snapshot, take).close()
    assert everything() == before and strip_rows(addon) == strips
    assert np.array_equal(film(ob, FRAMES), rows)
    assert bpy.ops.anyface.generate() == {"FINISHED"}
    assert strip_rows(addon) == strips


def test_a_run_with_events_is_one_undo_step_and_strips_stay(addon, bare):
    bpy.ops.ed.undo_push(message="before")
    before, strips = everything(), strip_rows(addon)
    generate(bare)
    bpy.ops.ed.undo_push(message="Generate")
    assert everything() != before
    bpy.ops.ed.undo()
    assert everything() == before and strip_rows(addon) == strips
    bpy.ops.ed.redo()
    assert bpy.data.objects["Head"].data.shape_keys is not None
    assert strip_rows(addon) == strips


def test_moving_a_strip_is_undone_and_the_take_follows_it(addon, speaking):  # noqa: F811
    ob = speaking
    event = put(addon, "brow raise", START + 10, START + 22)
    bpy.ops.ed.undo_push(message="strip")
    generate(ob)
    first = weights_of(ob)
    bpy.ops.ed.undo_push(message="Generate")
    event = next(
        s for s in addon("scene.sound.sequencer").all_strips(bpy.context.scene) if s == event
    )
    addon("scene.sound.sequencer").place(event, START + 40, START + 52)
    bpy.ops.ed.undo_push(message="move")
    bpy.ops.ed.undo()
    assert strip_rows(addon)[0][3] == (START + 10, START + 22)
    ob = bpy.data.objects["Head"]
    select(ob)
    generate(ob)
    again = weights_of(ob)
    assert max(change(first, again, name, list(first[name])) for name in first) < 1e-5


# Several characters.


def test_a_linked_copy_and_a_full_copy_hear_the_same_strips(addon, tmp_path):
    stage = stand_in(addon)
    strip(tone(tmp_path / "tone.wav", SECONDS), frame=START)
    ob = grid("Anna")
    ob.anyface.system, ob.anyface_audio.event_channel = SYSTEM, CHANNEL
    put(addon, "smile", START + 4, START + 12)
    put(addon, "frown", START + 30, START + 40).name = "Anna frown"
    for linked in (False, True):
        (copy,) = duplicate(ob, linked=linked)
        select(copy)
        assert bpy.ops.anyface.generate() == {"FINISHED"}
        # A strip that names Anna stays hers alone, because her copies have other names.
        names = [event.name for event in stage.calls[-1][-1].events]
        expected = addon("scene.event_strips").strips_of(bpy.context.scene, CHANNEL, copy)
        assert names == [s.name for s in expected] == ["smile"]
    select(ob)
    assert bpy.ops.anyface.generate() == {"FINISHED"}
    assert [e.name for e in stage.calls[-1][-1].events] == ["smile", "Anna frown"]


def library(addon, tmp_path):
    """A head with an event channel, linked from a file of its own into an empty one."""
    ob = grid("Head")
    ob.anyface.system, ob.anyface_audio.event_channel = SYSTEM, CHANNEL
    ob = link_from_library("Head", tmp_path)
    strip(tone(tmp_path / "tone.wav", SECONDS), frame=START)
    put(addon, "smile", START + 4, START + 12)
    return ob


def test_linked_characters_say_what_to_do_and_change_nothing(addon, tmp_path):
    stand_in(addon)
    ob = library(addon, tmp_path)
    bpy.context.scene.anyface.character = ob
    before, strips = everything(), strip_rows(addon)
    with pytest.raises(RuntimeError, match="local"):
        bpy.ops.anyface.event_add(expression="wink")
    with pytest.raises(RuntimeError, match="local"):
        bpy.ops.anyface.generate()
    assert everything() == before and strip_rows(addon) == strips


def test_an_override_keeps_a_channel_of_its_own_through_a_file(addon, tmp_path):
    stage = stand_in(addon)
    ob = library(addon, tmp_path).override_create(remap_local_usages=True)
    ob.data = ob.data.copy()
    select(ob)
    assert ob.anyface_audio.event_channel == CHANNEL
    ob.anyface_audio.event_channel, ob.anyface_audio.event_markers = CHANNEL + 1, True
    put(addon, "wink", START + 20, START + 30, channel=CHANNEL + 1)
    path = str(tmp_path / "shot.blend")
    bpy.ops.wm.save_as_mainfile(filepath=path)
    bpy.ops.wm.open_mainfile(filepath=path)
    ob = next(o for o in bpy.data.objects if o.override_library is not None)
    select(ob)
    audio = ob.anyface_audio
    assert (audio.event_channel, audio.event_markers) == (CHANNEL + 1, True)
    assert bpy.ops.anyface.generate() == {"FINISHED"}
    assert [e.units for e in stage.calls[-1][-1].events] == [("6L", "45L")]


def test_every_face_of_a_scene_list_gets_its_own_events(addon, tmp_path):
    stage = stand_in(addon)
    strip(tone(tmp_path / "tone.wav", SECONDS), frame=START)
    faces = [grid(name) for name in ("Anna", "Ben")]
    for ob in faces:
        ob.anyface.system, ob.anyface_audio.event_channel = SYSTEM, CHANNEL
        ob.anyface_audio.strip = "Voice"
    put(addon, "smile", START, START + 9).name = "Anna smile"
    put(addon, "wink", START + 9, START + 20).name = "Ben wink"
    put(addon, "frown", START + 30, START + 40)
    for ob in faces:
        select(ob)
        assert bpy.ops.anyface.generate() == {"FINISHED"}
    heard = [[event.name for event in call[-1].events] for call in stage.calls[-2:]]
    assert heard == [["Anna smile", "frown"], ["Ben wink", "frown"]]


# Files, the command, batches.


def test_events_of_a_file_count_instead_of_strips_and_markers(addon, tmp_path):
    stage = stand_in(addon)
    ob = grid()
    ob.anyface.system, ob.anyface_audio.event_channel = SYSTEM, CHANNEL
    put(addon, "smile", 1, 9)
    rows = [
        {"start_s": 0.2, "end_s": 0.6, "units": ["12", "45L"], "strength": 0.5},
        {"start_s": 0.5, "end_s": 1.0, "units": "a big grin", "over_speech": True},
    ]
    path, sound = tmp_path / "E.json", tone(tmp_path / "a.wav")
    words = ["bake", "--object", "Head", "--audio", sound, "--save", str(tmp_path / "o.blend")]
    main = addon("command").main
    path.write_text(json.dumps({"events": rows}))
    assert main([*words, "--events", str(path)]) == 0
    first, second = stage.calls[-1][-1].events
    assert (first.start_s, first.units, first.strength) == (0.2, ("12", "45L"), 0.5)
    assert "12" in second.units and second.over_speech
    assert main(words) == 0
    assert [event.units for event in stage.calls[-1][-1].events] == [("6", "12")]
    # A system without events refuses them instead of silently dropping them.
    assert main([*words, "--events", str(path), "--system", "freetalk"]) == 3


@pytest.mark.parametrize(
    ("content", "said"),
    [
        ("7", "event 1: .*expected seconds"),
        ('[{"start_s": 0, "end_s": 1}]', "event 1: .*units"),
        ('[{"start_s": 1, "end_s": 1, "units": ["12"]}]', "event 1: .*rising"),
        ('[{"start_s": NaN, "end_s": 1, "units": ["12"]}]', "JSON list .*line 1"),
        ('[{"start_s": 0, "end_s": 1, "units": ["12"], "strength": 2.5}]', "event 1: .*got 2.5"),
        ('[{"start_s": 0, "end_s": 1, "units": ["12"], "strength": NaN}]', "JSON list .*line 1"),
        ('[{"start_s": 0, "end_s": 1, "units": ["99"]}]', "event 1: .*got 99"),
        ('[{"start_s": 0, "end_s": 1, "units": "the blue car"}]', "event 1: .*not understood"),
        ("[", "JSON list .*line 1"),
    ],
)
def test_a_bad_file_of_events_is_refused_by_row(addon, tmp_path, content, said):
    path = tmp_path / "E.json"
    path.write_text(content)
    with pytest.raises(addon("core.errors").AnyfaceError, match=said):
        addon("core.events").of_file(str(path))


def test_a_batch_takes_strips_markers_and_files_of_events_along(addon, tmp_path, installed):
    floor = Floor(tmp_path, installed)
    ob, scene = bpy.data.objects["Head"], bpy.context.scene
    ob.anyface.system, ob.anyface_audio.event_channel = SYSTEM, CHANNEL
    ob.anyface_audio.event_markers = True
    put(addon, "the blue car", 4, 20).name = "Car"
    scene.timeline_markers.new("the red bus", frame=10)
    bpy.ops.wm.save_mainfile()
    digest = hashlib.sha256((tmp_path / "shot.blend").read_bytes()).hexdigest()
    (tmp_path / "E.json").write_text('[{"start_s": 0, "end_s": 1, "units": ["12"]}]')
    (tmp_path / "bad.json").write_text('[{"start_s": 0, "end_s": 1, "units": ["99"]}]')
    rows = [
        {"name": "strips", "save": "out/a.blend"},
        {"name": "file", "save": "out/b.blend", "events": "E.json"},
        {"name": "bad", "save": "out/c.blend", "events": "bad.json"},
    ]
    defaults = {"file": "shot.blend", "object": "Head", "audio": "voice.wav"}
    floor.jobs.write_text(json.dumps({"defaults": defaults, "shots": rows}))
    (floor.marks / "crash").touch()
    code, text = floor.run("--retries", 1)
    assert code == 12, text
    said = floor.report("strips")["message"]
    assert "the event Car was left out" in said and "the event the red bus was left out" in said
    assert "left out" not in floor.report("file")["message"]
    assert "event 1" in floor.report("bad")["message"] and "99" in floor.report("bad")["message"]
    # One worker crashed and its shot was retried. The shot's own file has not changed.
    assert hashlib.sha256((tmp_path / "shot.blend").read_bytes()).hexdigest() == digest
    # After its event file changes, a shot is done again, but no other shot is.
    (tmp_path / "E.json").write_text('[{"start_s": 0, "end_s": 0.5, "units": ["12"]}]')
    floor.run()
    assert floor.ended()["file"] == 2 and floor.ended()["strips"] == 1


def test_a_take_of_events_waits_beside_another(addon, bare):
    ob = bare
    generate(ob)
    smiling = film(ob, FRAMES)
    ob.anyface_output.new_take = True
    for text_strip in list(editor_strips()):
        if text_strip.type == "TEXT":
            editor_strips().remove(text_strip)
    generate(ob)
    plain = film(ob, FRAMES)
    assert np.abs(plain - smiling).max() > 1e-3
    takes = addon("scene.takes.take_list")
    first = next(row.id for row in takes.rows(ob) if row.name == "Take 1")
    takes.switch(ob, first)
    assert np.abs(film(ob, FRAMES) - smiling).max() < 1e-6
