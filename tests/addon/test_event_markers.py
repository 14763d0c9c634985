"""Timeline markers as events: the name of a marker says what the face does."""

import bpy
import pytest

from figures import FPS, everything, grid, stand_in, strip, tone
from test_events import CHANNEL, SECONDS, START, SYSTEM, put


def mark(name, frame):
    """Adds a marker as an artist would."""
    return bpy.context.scene.timeline_markers.new(name, frame=frame)


def read(addon, ob=None, marker_s=0.5, duration_s=SECONDS, **more):
    """Reads the events of markers, and of strips if `more` names a channel."""
    bpy.context.scene.render.fps = FPS
    settings_by_name = {"system": SYSTEM, "event_markers": True, "marker_s": marker_s} | more
    settings = addon("scene.bake").Settings(**settings_by_name)
    return addon("scene.event_strips").read(bpy.context.scene, ob, settings, START, duration_s)


def spans(events):
    """The units of each event, with its first and last frame."""
    at = [(START + e.start_s * FPS, START + e.end_s * FPS) for e in events]
    return [(e.units, round(a), round(b)) for e, (a, b) in zip(events, at, strict=True)]


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("smile", ("smile", 1.0, False)),
        ("smile:0.5", ("smile", 0.5, False)),
        ("12,6L : .25", ("12,6L", 0.25, False)),
        ("jaw drop!:1.5", ("jaw drop", 1.5, True)),
        ("jaw drop:1.5!", ("jaw drop", 1.5, True)),
    ],
)
def test_a_number_behind_an_expression_is_its_strength(addon, text, said):
    read = addon("core.events").expression(text)
    assert (read.said, read.strength, read.over_speech) == said


def test_an_end_names_what_it_ends(addon):
    ended = addon("core.events").ended_by
    begun = ["smile", "wink", "Jaw  drop!"]
    assert [ended(name, begun) for name in ("end", "END smile", "end: jaw drop")] == [2, 0, 2]
    assert [ended(name, begun) for name in ("ending", "end frown", "smile")] == [None] * 3
    assert ended("end", []) is None


def test_a_marker_lasts_as_long_as_is_said_or_until_its_end(addon):
    mark("smile:0.5", START + 2)
    mark("wink", START + 10)
    mark("end smile", START + 40)
    mark("frown", START + 50)
    mark("end", START + 54)
    result = read(addon)
    assert result.notes == []
    assert spans(result.events) == [
        (("6", "12"), START + 2, START + 40),
        (("6L", "45L"), START + 10, START + 22),
        (("4",), START + 50, START + 54),
    ]
    assert [event.strength for event in result.events] == [0.5, 1.0, 1.0]
    # When a marker moves, its event moves with it.
    bpy.context.scene.timeline_markers["wink"].frame = START + 20
    assert spans(read(addon).events)[1] == (("6L", "45L"), START + 20, START + 32)


def test_an_end_ends_one_event_and_no_second_one(addon):
    for name, at in (("smile", 0), ("wink", 4), ("end", 8), ("end", 20), ("end", 30)):
        mark(name, START + at)
    result = read(addon)
    assert [(a - START, b - START) for _, a, b in spans(result.events)] == [(0, 20), (4, 8)]
    (note,) = result.notes
    assert "end" in note and "is not understood" in note


def test_markers_say_nothing_unless_they_are_asked(addon):
    mark("smile", START)
    assert read(addon, event_markers=False).events == []
    assert read(addon, system="freetalk").events == []


def test_markers_of_cameras_and_blenders_own_names_are_none(addon):
    camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    mark("smile", START).camera = camera
    for name in ("F_20", "Marker", "Marker.001", "F_07"):
        mark(name, START + 3)
    mark("wink", START + 4)
    result = read(addon)
    assert result.notes == [] and [e.units for e in result.events] == [("6L", "45L")]


def test_bad_markers_are_named_and_the_rest_is_made(addon):
    mark("the blue car", START + 1)
    mark("smile", START - 40)
    mark("wink", START + FPS)
    result = read(addon)
    assert [e.units for e in result.events] == [("6L", "45L")]
    assert any("the blue car" in note and "understood" in note for note in result.notes)
    assert any("smile" in note and "outside the sound" in note for note in result.notes)


def test_a_marker_that_names_a_character_is_its_own(addon):
    anna, ben = grid("Anna"), grid("Ben")
    for ob in (anna, ben):
        ob.anyface_audio.event_markers = True
    mark("Anna: smile", START)
    mark("ben wink:0.5", START + 5)
    mark("frown", START + 10)
    assert [e.units for e in read(addon, anna).events] == [("6", "12"), ("4",)]
    theirs = read(addon, ben).events
    assert [(e.units, e.strength) for e in theirs] == [(("6L", "45L"), 0.5), (("4",), 1.0)]


def test_strips_and_markers_are_listed_together(addon):
    ob, scene = grid(), bpy.context.scene
    scene.render.fps = FPS
    ob.anyface_audio.event_channel, ob.anyface_audio.event_markers = CHANNEL, True
    ob.anyface_audio.marker_s = 1.0
    put(addon, "wink", START + 6, START + 12)
    mark("the blue car", START + 8)
    mark("smile", START)
    rows = addon("scene.event_strips").rows(scene, ob, ob.anyface_audio, (START, SECONDS))
    assert [(row.expression.said, row.first - START, row.last - START) for row in rows] == [
        ("smile", 0, FPS),
        ("wink", 6, 12),
        ("the blue car", 8, 8 + FPS),
    ]
    assert [row.strip is None for row in rows] == [True, False, True]
    assert [bool(row.wrong) for row in rows] == [False, False, True]


def test_markers_reach_the_request_and_go_with_copies_and_undo(addon, tmp_path):
    stage = stand_in(addon)
    strip(tone(tmp_path / "tone.wav", SECONDS), frame=START)
    ob = grid()
    ob.anyface.system, ob.anyface_audio.event_markers = SYSTEM, True
    bpy.ops.ed.undo_push(message="before")
    before = everything()
    mark("smile", START + FPS)
    bpy.ops.ed.undo_push(message="Marker")
    assert bpy.ops.anyface.generate() == {"FINISHED"}
    assert [event.units for event in stage.calls[-1][-1].events] == [("6", "12")]
    ob = bpy.data.objects["Head"]
    bpy.ops.object.select_all(action="DESELECT")
    ob.select_set(True)
    bpy.context.view_layer.objects.active = ob
    bpy.ops.object.duplicate()
    copy = bpy.context.object
    assert copy != ob and copy.anyface_audio.event_markers
    assert bpy.ops.anyface.generate() == {"FINISHED"}
    assert [event.name for event in stage.calls[-1][-1].events] == ["smile"]
    bpy.ops.ed.undo_push(message="Generate")
    while bpy.ops.ed.undo.poll() and len(bpy.context.scene.timeline_markers):
        bpy.ops.ed.undo()
    assert everything() == before and not len(bpy.context.scene.timeline_markers)


def test_a_take_that_comes_back_brings_how_it_listened(addon, tmp_path):
    stand_in(addon)
    strip(tone(tmp_path / "tone.wav", SECONDS), frame=START)
    ob = grid()
    ob.anyface.system = SYSTEM
    ob.anyface_audio.event_markers, ob.anyface_audio.marker_s = True, 1.5
    assert bpy.ops.anyface.generate() == {"FINISHED"}
    ob.anyface_audio.event_markers, ob.anyface_audio.marker_s = False, 0.4
    addon("scene.takes.panel_settings").bring_back(ob)
    assert ob.anyface_audio.event_markers and ob.anyface_audio.marker_s == 1.5
