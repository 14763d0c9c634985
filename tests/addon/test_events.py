"""Events are text strips of a channel that say what the face does besides speaking.

The shape weights that the system makes must reach named keys unchanged.
"""

import json
from itertools import pairwise

import bmesh
import bpy
import numpy as np
import pytest

from figures import FPS, babble, curves, everything, grid, stand_in, strip, tone
from test_heads import HEAD, import_head

START, SECONDS, CHANNEL = 11, 3.0, 5
SYSTEM = "cafe-talk"


def editor_strips():
    editor = bpy.context.scene.sequence_editor_create()
    return editor.strips if hasattr(editor, "strips") else editor.sequences


def put(addon, text, first, last, channel=CHANNEL):
    """Adds a text strip as an artist would."""
    text_strip = addon("scene.sound.sequencer").new_text(
        bpy.context.scene, text or "E", channel, first, last
    )
    text_strip.text = text
    return text_strip


def read_events(addon, channel=CHANNEL, duration_s=SECONDS):
    """Reads the events of the channel. The sound begins at frame `START`."""
    bpy.context.scene.render.fps = FPS
    settings = addon("scene.bake").Settings(system=SYSTEM, event_channel=channel)
    return addon("scene.event_strips").read(bpy.context.scene, None, settings, START, duration_s)


@pytest.fixture
def known(addon):
    """The library's units."""
    return addon("core.systems").units()


# Expressions.


@pytest.mark.parametrize(
    ("text", "units"),
    [
        ("12,6L", ("12", "6L")),
        ("AU45 L", ("45L",)),
        ("au01 + AU02", ("1", "2")),
        ("12 6 right", ("12", "6R")),
        ("Smile", ("6", "12")),
        ("left wink", ("6L", "45L")),
        ("wink RIGHT", ("6R", "45R")),
        ("surprised  blink", ("1", "2", "45")),
        ("right jaw drop", ("26",)),
    ],
)
def test_units_and_words_are_understood(addon, text, units):
    understood = addon("core.events").expression(text)
    assert (understood.units, understood.hint) == (units, "")
    assert not understood.over_speech
    assert addon("core.events").expression(f"{text} !").over_speech


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "says nothing"),
        ("  !", "says nothing"),
        ("the blue car", "expected units such as 12,6L"),
        ("tetchy", 'nearest that is understood: "ashamed"'),
        ("99", "expected some of 1, 2, 4"),
        ("12,99L", "got 99L"),
        ("улыбка", "is not understood"),
    ],
)
def test_what_is_not_understood_gets_a_hint(addon, text, said):
    understood = addon("core.events").expression(text)
    assert understood.units == () and said in understood.hint


def test_the_menu_names_units_that_the_library_has(addon, known):
    menu = addon("core.events").menu()
    assert len(menu) == 32 and {"smile", "wink", "jaw drop"} <= set(menu)
    for word in menu:
        understood = addon("core.events").expression(word)
        assert understood.units and understood.strength == 1.0
        assert {unit.rstrip("LR") for unit in understood.units} <= set(known)


@pytest.mark.parametrize(
    ("text", "units"),
    [
        ("winks with the right eye", {"45R"}),
        ("a big grin", {"12"}),
        ("she raises her eyebrows", {"1", "2"}),
    ],
)
def test_texts_beside_the_menu_are_read_by_the_library(addon, text, units):
    understood = addon("core.events").expression(text)
    assert units <= set(understood.units), understood
    assert understood.hint == "" and 0.0 < understood.strength <= 2.0


def test_texts_that_say_nothing_to_a_face_get_a_hint(addon):
    for text in ("the blue car", "12345 apples"):
        understood = addon("core.events").expression(text)
        assert understood.units == () and "is not understood" in understood.hint


def test_a_folder_of_models_that_cannot_read_says_why(addon, tmp_path):
    model = tmp_path / "text_units"
    model.mkdir()
    (model / "config.json").write_text("{}")
    (model / "model.safetensors").write_bytes(b"")
    read = addon("core.events").expression
    understood = read("a big grin", tmp_path)
    assert understood.units == () and "safetensors" in understood.hint
    assert read("a big grin").units
    # The words of the menu need no model.
    assert read("smile", tmp_path).units == read("smile").units == ("6", "12")


# Strips.


def test_a_strip_is_an_event_by_text_place_length_and_opacity(addon):
    first = put(addon, "12,6L", START + FPS, START + 2 * FPS)
    first.blend_alpha = 0.5
    put(addon, "jaw drop!", START, START + 6)
    put(addon, "smile", START, START + FPS, channel=CHANNEL + 1)
    read = read_events(addon)
    assert read.notes == []
    jaw, smile = read.events
    assert (smile.start_s, smile.end_s, smile.units) == (1.0, 2.0, ("12", "6L"))
    assert smile.strength == 0.5 and not smile.over_speech
    assert jaw.over_speech and (jaw.start_s, jaw.end_s) == (0.0, 6 / FPS)
    # The event follows when its strip is moved or trimmed.
    addon("scene.sound.sequencer").place(first, START + 30, START + 36)
    moved = read_events(addon).events[1]
    assert (moved.start_s, moved.end_s) == (30 / FPS, 36 / FPS)


def test_keyframes_of_the_opacity_are_pieces_of_the_event(addon):
    text_strip = put(addon, "smile", START + 10, START + 20)
    for frame, alpha in ((START + 10, 0.0), (START + 20, 1.0)):
        text_strip.blend_alpha = alpha
        text_strip.keyframe_insert("blend_alpha", frame=frame)
    events = read_events(addon).events
    strengths = [event.strength for event in events]
    assert len(events) > 3 and strengths == sorted(strengths) and strengths[0] > 0.0
    assert all(event.units == ("6", "12") for event in events)
    for before, behind in pairwise(events):
        assert before.end_s == pytest.approx(behind.start_s)
    assert events[-1].end_s == pytest.approx(20 / FPS)


def test_bad_strips_are_named_and_the_rest_is_made(addon):
    put(addon, "the blue car", START, START + 5).name = "Car"
    put(addon, "smile", START - 9, START - 2).name = "Early"
    put(addon, "smile", START + 100, START + 110).name = "Late"
    put(addon, "", START + 6, START + 9).name = "Empty"
    put(addon, "wink", START + 60, START + 90).name = "Half"
    read = read_events(addon)
    (half,) = read.events
    # Only the part of a strip within the sound becomes an event.
    assert (half.start_s, half.end_s) == (60 / FPS, SECONDS)
    for name in ("Car", "Early", "Late", "Empty"):
        assert any(name in note for note in read.notes), name
    assert not any("Half" in note for note in read.notes)
    assert "outside the sound" in next(note for note in read.notes if "Early" in note)


def test_other_systems_and_no_channel_have_no_events(addon):
    put(addon, "smile", START, START + 9)
    read, of = addon("scene.event_strips").read, addon("scene.bake").Settings
    for settings in (of(system="freetalk", event_channel=CHANNEL), of(system=SYSTEM)):
        assert read(bpy.context.scene, None, settings, START, SECONDS).events == []


def test_a_strip_that_names_a_character_is_its_own_where_several_share_a_channel(addon):
    anna, ben = grid("Anna"), grid("Ben")
    for ob in (anna, ben):
        ob.anyface_audio.event_channel = CHANNEL
    put(addon, "smile", 1, 9).name = "Anna_smile"
    put(addon, "wink", 9, 20)
    text_strip = addon("scene.event_strips").add(bpy.context.scene, ben, CHANNEL, "frown", 30)
    assert text_strip.name.startswith("Ben ")
    strips_of = addon("scene.event_strips").strips_of
    theirs = {ob.name: strips_of(bpy.context.scene, CHANNEL, ob) for ob in (anna, ben)}
    assert [s.text for s in theirs["Anna"]] == ["smile", "wink"]
    assert [s.text for s in theirs["Ben"]] == ["wink", "frown"]


# Operators.


def test_add_at_playhead_writes_strips_beside_each_other(addon):
    ob, scene = grid(), bpy.context.scene
    scene.render.fps = FPS
    ob.anyface.system = SYSTEM
    scene.frame_set(20)
    assert bpy.ops.anyface.event_add(expression="smile", side="LEFT") == {"FINISHED"}
    channel = ob.anyface_audio.event_channel
    (strips,) = addon("scene.event_strips").strips_of(scene, channel)
    assert (strips.text, strips.mute, strips.blend_alpha) == ("left smile", True, 1.0)
    first, last = addon("scene.sound.sequencer").ends(strips)
    assert first == 20 and last > 30
    with pytest.raises(RuntimeError, match="move the playhead"):
        bpy.ops.anyface.event_add(expression="wink")
    # The new strip ends where the next one begins.
    scene.frame_set(14)
    bpy.ops.anyface.event_add(expression="UNITS", units="9,10", side="RIGHT", strength=0.4)
    both = addon("scene.event_strips").strips_of(scene, channel)
    assert [s.text for s in both] == ["9R,10R", "left smile"]
    assert addon("scene.sound.sequencer").ends(both[0]) == (14, 20)
    assert both[0].blend_alpha == pytest.approx(0.4)
    with pytest.raises(RuntimeError, match="expected some of"):
        bpy.ops.anyface.event_add(expression="UNITS", units="99")
    ob.anyface.system = "freetalk"
    assert not bpy.ops.anyface.event_add.poll()


def test_adding_an_event_is_one_undo_step(addon):
    ob = grid()
    ob.anyface.system = SYSTEM
    bpy.ops.ed.undo_push(message="before")
    before = everything()
    bpy.ops.anyface.event_add(expression="wink")
    bpy.ops.ed.undo_push(message="Add Event")
    bpy.ops.ed.undo()
    assert everything() == before
    assert addon("scene.sound.sequencer").all_strips(bpy.context.scene) == []


def test_events_of_each_character_reach_its_request_and_a_copy_brings_them(addon, tmp_path):
    stage = stand_in(addon)
    strip(tone(tmp_path / "tone.wav", SECONDS), frame=START)
    ob = grid()
    ob.anyface.system, ob.anyface_audio.event_channel = SYSTEM, CHANNEL
    put(addon, "smile", START + FPS, START + 2 * FPS)
    put(addon, "wink", START, START + FPS, channel=CHANNEL + 1)
    assert bpy.ops.anyface.generate() == {"FINISHED"}
    assert [event.units for event in stage.calls[-1][-1].events] == [("6", "12")]
    bpy.ops.object.select_all(action="DESELECT")
    ob.select_set(True)
    bpy.context.view_layer.objects.active = ob
    bpy.ops.object.duplicate()
    copy = bpy.context.object
    assert copy != ob
    assert copy.anyface_audio.event_channel == CHANNEL
    copy.anyface_audio.event_channel = CHANNEL + 1
    assert bpy.ops.anyface.generate() == {"FINISHED"}
    assert [event.units for event in stage.calls[-1][-1].events] == [("6L", "45L")]
    assert ob.anyface_audio.event_channel == CHANNEL


def test_a_run_that_fails_leaves_strips_and_keys(addon, monkeypatch, tmp_path):
    stage = stand_in(addon)
    strip(tone(tmp_path / "tone.wav", SECONDS), frame=START)
    ob = grid()
    ob.anyface.system, ob.anyface_audio.event_channel = SYSTEM, CHANNEL
    put(addon, "smile", START + FPS, START + 2 * FPS)
    assert bpy.ops.anyface.generate() == {"FINISHED"}
    before, events = weights_of(ob), read_events(addon).events
    errors = addon("core.errors")

    def stop(*_):
        raise errors.AnyfaceError("internal", "cancelled")

    monkeypatch.setattr(type(stage), "animate", stop)
    with pytest.raises(RuntimeError):
        bpy.ops.anyface.generate()
    assert read_events(addon).events == events
    assert weights_of(ob) == before


def _keys(ob):
    """Frame and value of every keyframe of a face, by shape key."""
    out = {}
    for curve in curves(ob.data.shape_keys.animation_data.action):
        points = np.empty(2 * len(curve.keyframe_points), dtype=np.float32)
        curve.keyframe_points.foreach_get("co", points)
        out[curve.data_path.split('"')[1]] = points.reshape(-1, 2)
    return out


# The system itself.


@pytest.fixture
def speaking(addon, tmp_path):
    """The default head with a tone to speak, and ARKit keys that move only one vertex each."""
    rate = 16000
    at = np.arange(int(SECONDS * rate)) / rate
    voice = np.sin(2 * np.pi * 140.0 * at) * np.sin(2 * np.pi * 2.1 * at) ** 2
    from figures import write_wav

    write_wav(tmp_path / "voice.wav", 0.5 * voice, rate)
    strip(tmp_path / "voice.wav", frame=START)
    ob = import_head()
    ob.shape_key_add(name="Basis")
    for name in addon("core.shapes").ARKIT:
        ob.shape_key_add(name=name).points[0].co.z += 0.01
    ob.anyface.system, ob.anyface.mode = SYSTEM, "keys"
    ob.anyface.curves = "EVERY"
    ob.anyface_audio.event_channel = CHANNEL
    return ob


def weights_of(ob):
    """Curves of a take as weights by frame, `{name: {frame: value}}`."""
    return {name: dict(points.tolist()) for name, points in _keys(ob).items()}


def change(before, after, name, frames):
    """The largest change of a curve at some frames."""
    at = [f for f in frames if f in before[name] and f in after[name]]
    assert at
    return max(abs(after[name][f] - before[name][f]) for f in at)


def test_weights_reach_the_artists_keys_as_they_are(addon, speaking, tmp_path):
    """The keys move one vertex each, so no solve on the mesh could find these weights."""
    ob = speaking
    assert bpy.ops.anyface.generate() == {"FINISHED"}, ob.anyface.report
    keys = weights_of(ob)
    ob.anyface.mode = "csv"
    ob.anyface_output.csv_file = str(tmp_path / "table.csv")
    assert bpy.ops.anyface.generate() == {"FINISHED"}, ob.anyface.report
    header, *rows = [line.split(",") for line in (tmp_path / "table.csv").read_text().splitlines()]
    moved = 0.0
    for name in addon("core.shapes").ARKIT:
        column = header.index(name[0].upper() + name[1:])
        for number, row in enumerate(rows):
            weight = keys[name].get(float(START + number), 0.0)
            assert weight == pytest.approx(float(row[column]), abs=1e-5), (name, number)
            moved = max(moved, weight)
    assert moved > 0.05


def test_an_event_moves_its_slot_and_nothing_far_from_it_and_goes_with_its_strip(addon, speaking):
    ob = speaking
    assert bpy.ops.anyface.generate() == {"FINISHED"}, ob.anyface.report
    without = weights_of(ob)
    text_strip = put(addon, "brow raise", START + FPS, START + int(1.6 * FPS))
    assert bpy.ops.anyface.generate() == {"FINISHED"}, ob.anyface.report
    with_it = weights_of(ob)
    inside = range(START + FPS, START + int(1.6 * FPS))
    far = [*range(START, START + FPS - 12), *range(START + int(1.6 * FPS) + 12, START + 3 * FPS)]
    brows = [name for name in without if name.startswith(("browInner", "browOuter"))]
    slot = max(change(without, with_it, name, inside) for name in brows)
    beside = max(change(without, with_it, name, far) for name in without)
    assert slot > 0.3 and beside < 0.02
    addon("scene.sound.sequencer").place(text_strip, START + 2 * FPS, START + int(2.6 * FPS))
    assert bpy.ops.anyface.generate() == {"FINISHED"}, ob.anyface.report
    moved = weights_of(ob)
    behind, before = range(START + 2 * FPS, START + 62), range(START, START + 2 * FPS - 12)
    assert max(change(without, moved, name, behind) for name in brows) > 0.3
    assert max(change(without, moved, name, before) for name in brows) < 0.02
    text_strip.text = "the blue car"
    assert bpy.ops.anyface.generate() == {"FINISHED"}, ob.anyface.report
    assert "brow raise was left out" in ob.anyface.report


def test_shapes_that_move_and_no_key_shows_are_named(addon, tmp_path):
    strip(babble(tmp_path / "voice.wav", 1.0), frame=START)
    ob = import_head()
    ob.shape_key_add(name="Basis")
    ob.shape_key_add(name="eyeBlinkLeft").points[0].co.z += 0.01
    ob.anyface.system, ob.anyface.mode = SYSTEM, "keys"
    weights = addon("core.take").ShapeWeights
    motion = weights(["jawOpen", "mouthFunnel", "cheekPuff"], np.array([[0.5, 0.2, 0.01]] * 3))
    assert motion.missing(["jawOpen"]) == ["mouthFunnel"]
    share = np.hypot(0.2, 0.01) / np.hypot(0.5, 0.2)
    assert motion.left_out(["jawOpen"]) == pytest.approx(share, 1e-2)
    assert bpy.ops.anyface.generate() == {"FINISHED"}, ob.anyface.report
    assert "no key shows" in ob.anyface.report and "eyeBlinkRight" in ob.anyface.report


def test_what_a_face_cannot_show_is_told_by_the_name_of_the_strip(addon):
    name_strips = addon("core.native_events")._named
    requested_events = [
        addon("core.events").Event(0.0, 1.0, ("12",), name=name) for name in ("A", "Brows")
    ]
    note = "event 2 (0.5 to 1 s): this face cannot show unit 1, inner brow raiser"
    assert (
        name_strips(note, requested_events)
        == "the event Brows: this face cannot show unit 1, inner brow raiser"
    )
    assert name_strips("something else", requested_events) == "something else"


def test_what_hides_a_lip_stands_in_the_report(addon, tmp_path):
    strip(babble(tmp_path / "voice.wav", 1.0), frame=START)
    ob = import_head()
    ob.anyface.system = SYSTEM
    assert bpy.ops.anyface.generate() == {"FINISHED"}, ob.anyface.report
    assert "lies before" not in ob.anyface.report
    marks = json.loads((HEAD.parent / "landmarks.json").read_text())["landmarks"]
    right, left, lip, chin = (marks[n]["position"] for n in (48, 54, 66, 8))
    front = marks[57]["position"][2] + 0.02
    bottom = 0.5 * (lip[1] + chin[1])
    corners = [(right[0], lip[1]), (left[0], lip[1]), (left[0], bottom), (right[0], bottom)]
    edited = bmesh.new()
    edited.from_mesh(ob.data)
    edited.faces.new([edited.verts.new((x, y, front)) for x, y in corners])
    bpy.ops.anyface.remove()
    edited.to_mesh(ob.data)
    edited.free()
    assert bpy.ops.anyface.generate() == {"FINISHED"}, ob.anyface.report
    assert "something lies before the lower lip" in ob.anyface.report


def test_notes_of_a_thousand_strips_are_few(addon):
    for number in range(1000):
        text, first = "smile" if number % 2 else "the blue car", START + number
        put(addon, text, first, first + 1)
    read = read_events(addon, duration_s=1000.0 / FPS)
    assert len(read.events) == 500
    # Nobody reads a report of five hundred notes, so it is cut short.
    assert len(read.notes) == 7 and read.notes[-1] == "and 494 more of this kind"


def test_every_output_of_a_bare_mesh_speaks_with_events(addon, tmp_path):
    strip(tone(tmp_path / "tone.wav", 1.0), frame=START)
    ob = import_head()
    ob.anyface.system, ob.anyface_audio.event_channel = SYSTEM, CHANNEL
    put(addon, "jaw drop", START + 5, START + 20)
    for mode in ("basis", "arkit"):
        ob.anyface.mode = mode
        assert bpy.ops.anyface.generate() == {"FINISHED"}, ob.anyface.report
        assert "moves by up to" in ob.anyface.report_details
        # Basis keys have sliders for articulation and emotion, named keys have groups of shapes.
        sliders = set(addon("scene.takes.adjust").names_of(ob)) & {"articulation", "emotion"}
        assert len(sliders) == (2 if mode == "basis" else 0)
    assert len(weights_of(ob)) == 52
    assert "event" not in ob.anyface.report
    # Redo of a stretch uses the weights of the system too.
    ob.anyface.seed = 3
    scene = bpy.context.scene
    scene.use_preview_range = True
    scene.frame_preview_start, scene.frame_preview_end = START + 5, START + 18
    assert bpy.ops.anyface.redo() == {"FINISHED"}, ob.anyface.report
