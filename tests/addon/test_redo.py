"""Redo between two markers, and heard sounds as strips that the artist can correct."""

import bpy
import numpy as np
import pytest

from figures import FPS, curves, everything, film, grid, shape, stand_in, strip, tone

START, FIRST, LAST = 11, 20, 40
SECONDS = 2.0


@pytest.fixture
def stage(addon):
    """A `Stage` that replaces the engine."""
    return stand_in(addon)


def spoken(tmp_path, mode="basis"):
    """A face with a take of the strip Voice, and two markers."""
    strip(tone(tmp_path / "tone.wav", SECONDS), frame=START)
    ob = grid()
    ob.anyface.mode, ob.anyface_audio.strip = mode, "Voice"
    assert bpy.ops.anyface.generate() == {"FINISHED"}
    markers = bpy.context.scene.timeline_markers
    for frame in (FIRST, LAST):
        markers.new(f"F{frame}", frame=frame)
    for marker in markers:
        marker.select = True
    return ob


def keyframes(ob):
    """The exact frame and value of every keyframe, by data path."""
    rows = {}
    for curve in curves(ob.data.shape_keys.animation_data.action):
        points = np.empty(2 * len(curve.keyframe_points), dtype=np.float32)
        curve.keyframe_points.foreach_get("co", points)
        rows[curve.data_path] = points.reshape(-1, 2)
    return rows


def outside(points):
    return points[(points[:, 0] <= FIRST) | (points[:, 0] >= LAST)]


@pytest.mark.parametrize("mode", ["basis", "arkit"])
def test_every_keyframe_outside_stays_to_the_bit_and_those_inside_are_new(stage, tmp_path, mode):
    ob = spoken(tmp_path, mode)
    before, rest = keyframes(ob), film(ob, [*range(1, FIRST + 1), *range(LAST, 70)])
    middle = shape(ob, 30)
    ob.anyface.seed = 5
    assert bpy.ops.anyface.redo() == {"FINISHED"}
    after = keyframes(ob)
    for path, points in before.items():
        assert np.array_equal(outside(points), outside(after[path])), path
    assert np.array_equal(rest, film(ob, [*range(1, FIRST + 1), *range(LAST, 70)]))
    assert np.abs(shape(ob, 30) - middle).max() > 1e-4


def test_the_new_stretch_shows_the_motion_that_was_asked_for(addon, stage, tmp_path):
    ob = spoken(tmp_path)
    ob.anyface.seed = 5
    # Another seed gives other shapes, which the keys of the take cannot show.
    assert bpy.ops.anyface.redo() == {"FINISHED"}
    assert "more keys" in ob.anyface.report
    from figures import motion

    moved = motion(int(SECONDS * FPS), len(ob.data.vertices), stage.rank, stage.size, 5)
    rest = shape(ob, 1)
    for frame in (26, 30, 34):
        error = np.abs(shape(ob, frame) - rest - moved[frame - START]).max()
        assert error < 1.5e-4, frame


def test_the_same_settings_again_change_nothing_that_can_be_seen(stage, tmp_path):
    ob = spoken(tmp_path)
    before, keys = film(ob, range(1, 70)), len(ob.data.shape_keys.key_blocks)
    assert bpy.ops.anyface.redo() == {"FINISHED"}
    assert np.abs(film(ob, range(1, 70)) - before).max() < 2e-5
    assert len(ob.data.shape_keys.key_blocks) == keys
    assert "as they were" in ob.anyface.report


def test_redo_is_one_undo_step(stage, tmp_path):
    ob = spoken(tmp_path)
    ob.anyface.seed = 5
    bpy.ops.ed.undo_push(message="before")
    before = everything()
    assert bpy.ops.anyface.redo() == {"FINISHED"}
    bpy.ops.ed.undo_push(message="Redo")
    assert everything() != before
    bpy.ops.ed.undo()
    assert everything() == before


def test_remove_takes_the_keys_of_a_stretch_along(stage, tmp_path):
    ob = spoken(tmp_path)
    ob.anyface.seed = 5
    assert bpy.ops.anyface.redo() == {"FINISHED"}
    assert bpy.ops.anyface.remove() == {"FINISHED"}
    assert ob.data.shape_keys is None


def test_a_stretch_follows_the_strength_and_the_shift_of_the_take(addon, stage, tmp_path):
    ob = spoken(tmp_path)
    addon("scene.takes.adjust").adjust(ob, strength=0.5, shift=3.0)
    before = film(ob, range(1, 70))
    assert bpy.ops.anyface.redo() == {"FINISHED"}
    assert np.abs(film(ob, range(1, 70)) - before).max() < 2e-5


def test_the_stretch_is_the_preview_range_or_what_markers_enclose(addon, stage, tmp_path):
    spoken(tmp_path)
    scene, between = bpy.context.scene, addon("scene.takes.redo").between
    assert between(scene) == (FIRST, LAST)
    for marker in scene.timeline_markers:
        marker.select = False
    scene.frame_set(25)
    assert between(scene) == (FIRST, LAST)
    scene.use_preview_range = True
    scene.frame_preview_start, scene.frame_preview_end = 15, 18
    assert between(scene) == (15, 18)
    scene.use_preview_range = False
    scene.timeline_markers.clear()
    with pytest.raises(addon("core.errors").AnyfaceError, match="preview range"):
        between(scene)


def test_a_stretch_beside_the_sound_is_refused_in_words(stage, tmp_path):
    ob = spoken(tmp_path)
    scene, before = bpy.context.scene, keyframes(ob)
    scene.use_preview_range = True
    scene.frame_preview_end, scene.frame_preview_start = 240, 200
    with pytest.raises(RuntimeError, match="where the sound is"):
        bpy.ops.anyface.redo()
    assert all(np.array_equal(points, keyframes(ob)[path]) for path, points in before.items())


def test_without_a_take_redo_says_what_is_missing(stage, tmp_path):
    strip(tone(tmp_path / "tone.wav", SECONDS), frame=START)
    grid().anyface_audio.strip = "Voice"
    assert not bpy.ops.anyface.redo.poll()


def marks():
    editor = bpy.context.scene.sequence_editor
    every = editor.strips_all if hasattr(editor, "strips_all") else editor.sequences_all
    text_strips = [s for s in every if s.type == "TEXT"]
    return sorted(text_strips, key=lambda s: s.frame_final_start)


def requested_closures(stage):
    closures = stage.calls[-1][-1].fields.get("closures")
    return None if closures is None else np.round(closures, 4).tolist()


def test_what_is_heard_is_shown_as_muted_strips_above_the_sound(stage, tmp_path):
    spoken(tmp_path)
    assert requested_closures(stage) is None
    assert bpy.ops.anyface.sounds_show() == {"FINISHED"}
    strips = marks()
    assert [(s.frame_final_start, s.frame_final_end) for s in strips] == [(18, 20), (35, 36)]
    assert all(s.mute and s.text == "MBP" and s.channel > 1 for s in strips)
    assert bpy.ops.anyface.sounds_show() == {"FINISHED"}
    assert len(marks()) == 2


def test_strips_that_stay_keep_their_exact_times(stage, tmp_path):
    spoken(tmp_path)
    bpy.ops.anyface.sounds_show()
    assert bpy.ops.anyface.redo() == {"FINISHED"}
    assert requested_closures(stage) == [[0.30, 0.38], [1.02, 1.06]]


def test_strips_may_be_moved_renamed_deleted_and_added(stage, tmp_path):
    spoken(tmp_path)
    bpy.ops.anyface.sounds_show()
    first, second = marks()
    first.frame_start += 6
    assert bpy.ops.anyface.redo() == {"FINISHED"}
    moved = [round((24 - START) / FPS, 4), round((26 - START) / FPS, 4)]
    assert requested_closures(stage) == [moved, [1.02, 1.06]]
    second.text = "f"
    assert bpy.ops.anyface.redo() == {"FINISHED"}
    assert requested_closures(stage) == [moved]
    editor = bpy.context.scene.sequence_editor
    (editor.strips if hasattr(editor, "strips") else editor.sequences).remove(first)
    assert bpy.ops.anyface.redo() == {"FINISHED"}
    assert requested_closures(stage) == []


def with_words(tmp_path):
    """A face with strips of words and closures. The first closure lies in the first word, `bob`."""
    ob = spoken(tmp_path)
    bpy.context.scene.anyface.text = "bob said hello"
    assert bpy.ops.anyface.sounds_show() == {"FINISHED"}
    top = max(s.channel for s in marks())
    words = [s for s in marks() if s.channel == top]
    return ob, words, [s for s in marks() if s.channel != top]


def test_words_of_the_text_stand_above_the_closures(stage, tmp_path):
    _, words, closures = with_words(tmp_path)
    assert stage.calls[-1][-1].fields["text"] == ""
    assert [s.text for s in words] == ["bob", "said", "hello"]
    assert [s.text for s in closures] == ["MBP", "MBP"] and all(s.mute for s in words)
    assert bpy.ops.anyface.redo() == {"FINISHED"}
    assert requested_closures(stage) == [[0.30, 0.38], [1.02, 1.06]]
    assert stage.calls[-1][-1].fields["text"] == "bob said hello"


def test_a_text_belongs_to_its_sound(stage, tmp_path):
    ob, _, _ = with_words(tmp_path)
    strip(tone(tmp_path / "other.wav", SECONDS), name="Other", channel=9)
    ob.anyface.strip = "Other"
    assert bpy.context.scene.anyface.text == ""
    ob.anyface.strip = "Voice"
    assert bpy.context.scene.anyface.text == "bob said hello"


def test_closures_go_with_their_word_and_redo_is_about_its_stretch(stage, tmp_path):
    ob, (bob, *_), (first, second) = with_words(tmp_path)
    bpy.context.scene.timeline_markers.clear()
    before = keyframes(ob)
    bob.frame_start += 6
    assert bpy.ops.anyface.redo() == {"FINISHED"}
    by_s = 6 / FPS
    assert requested_closures(stage) == [
        [round(0.30 + by_s, 4), round(0.38 + by_s, 4)],
        [1.02, 1.06],
    ]
    assert first.frame_final_start == 18 + 6 and second.frame_final_start == 35
    start, end = START + (0.25 - 0.2) * FPS, START + (0.5 + by_s + 0.2) * FPS
    for path, points in keyframes(ob).items():
        far = (before[path][:, 0] < start - 1) | (before[path][:, 0] > end + 1)
        assert far.any() and np.array_equal(before[path][far], points[far])
    # The closure that moved with its word stays there, and nothing counts as moved any more.
    assert bpy.ops.anyface.generate() == {"FINISHED"}
    assert requested_closures(stage)[1] == [1.02, 1.06]
    with pytest.raises(RuntimeError, match="no stretch to redo"):
        bpy.ops.anyface.redo()


def test_a_closure_that_was_moved_itself_stays_where_it_is(stage, tmp_path):
    _, (bob, *_), (first, _second) = with_words(tmp_path)
    first.frame_start += 2
    bob.frame_start += 6
    assert bpy.ops.anyface.redo() == {"FINISHED"}
    assert requested_closures(stage)[0] == [
        round((20 - START) / FPS, 4),
        round((22 - START) / FPS, 4),
    ]


def test_of_a_word_that_was_copied_closures_stay(stage, tmp_path):
    _, (bob, *_), _ = with_words(tmp_path)
    editor = bpy.context.scene.sequence_editor
    strips = editor.strips if hasattr(editor, "strips") else editor.sequences
    place = {"name": "copy", "type": "TEXT", "channel": bob.channel + 1, "frame_start": 45}
    longer = {"length": 6} if bpy.app.version >= (5, 0, 0) else {"frame_end": 51}
    copy = strips.new_effect(**place, **longer)
    for key, value in bob.items():
        copy[key] = value
    assert bpy.ops.anyface.redo() == {"FINISHED"}
    assert requested_closures(stage) == [[0.30, 0.38], [1.02, 1.06]]


def test_generate_uses_the_strips_too(stage, tmp_path):
    spoken(tmp_path)
    bpy.ops.anyface.sounds_show()
    assert bpy.ops.anyface.generate() == {"FINISHED"}
    assert requested_closures(stage) == [[0.30, 0.38], [1.02, 1.06]]


def test_sounds_of_a_file_replace_those_that_were_heard(stage, tmp_path):
    spoken(tmp_path)
    bpy.ops.anyface.sounds_show()
    assert bpy.ops.anyface.sounds_read(filepath=str(tmp_path / "a.TextGrid")) == {"FINISHED"}
    assert len(marks()) == 1
    assert bpy.ops.anyface.redo() == {"FINISHED"}
    assert requested_closures(stage) == [[0.5, 0.75]]


def test_without_strips_there_is_nothing_to_write(stage, tmp_path):
    spoken(tmp_path)
    with pytest.raises(RuntimeError, match="press Show Sounds first"):
        bpy.ops.anyface.sounds_write(filepath=str(tmp_path / "a.tsv"))
    assert not (tmp_path / "a.tsv").exists()


@pytest.mark.parametrize("kind", [".TextGrid", ".tsv", ".json", ".pgo", ".dat", ".txt"])
def test_strips_are_written_as_files_of_other_tools_and_read_back(addon, tmp_path, kind):
    bpy.context.scene.render.fps = FPS
    ob = grid()
    ob.anyface.source, ob.anyface.start_frame = "FILE", START
    ob.anyface.sound_file = tone(tmp_path / "tone.wav", SECONDS)
    scene, engine = bpy.context.scene, addon("ui.running").engine("")
    source = addon("scene.bake").find_sound(
        scene, addon("ui.settings").from_object(ob, scene), engine
    )
    addon("scene.sound.sounds").show(scene, source, np.array([[0.25, 0.5], [1.0, 1.25]]))
    assert bpy.ops.anyface.sounds_write(filepath=str(tmp_path / "shot.v1"), kind=kind)
    written = tmp_path / f"shot.v1{kind}"
    text = written.read_text()
    assert text and (kind != ".TextGrid" or "xmax = 2\n" in text)
    first, _ = marks()
    first.text, first.frame_start = "f", first.frame_start + 1
    assert bpy.ops.anyface.sounds_read(filepath=str(written)) == {"FINISHED"}
    closures = addon("scene.sound.sounds").read(scene, source)
    assert len(closures) == 2 and np.allclose(
        [row[:2] for row in closures], [[0.25, 0.5], [1.0, 1.25]]
    )


def test_a_file_names_its_kind_itself_and_overlapping_strips_follow_each_other(addon, tmp_path):
    apart = addon("scene.sound.sounds").apart
    rows = [(0.1, 0.3, "p"), (0.2, 0.4, "m"), (0.25, 0.35, "b"), (0.5, 0.6, "")]
    assert apart(rows) == [(0.1, 0.3, "p"), (0.3, 0.4, "m"), (0.5, 0.6, "MBP")]
    engine = addon("ui.running").engine("")
    engine.write_sounds(str(tmp_path / "a.tsv"), apart(rows), 1.0, 24.0)
    assert (tmp_path / "a.tsv").read_text().splitlines()[-1].startswith("1.000")
    with pytest.raises(addon("core.errors").AnyfaceError):
        engine.write_sounds(str(tmp_path / "nowhere" / "a.tsv"), rows[:1], 1.0, 24.0)
