"""Several strips as one take, and what the panel says about a sound."""

import bpy
import numpy as np
import pytest

from figures import FPS, grid, stand_in, strip, write_wav

RATE = 16000


@pytest.fixture
def stage(addon):
    """A stage in the engine's place."""
    return stand_in(addon)


def level(path, value, seconds=1.0):
    """Writes a sound that holds one value."""
    write_wav(path, np.full(int(seconds * RATE), value), RATE)
    return str(path)


def first_strip(tmp_path):
    """A strip of value 0.25 at frame 11."""
    try:
        return strip(level(tmp_path / "a.wav", 0.25), "One", 11, 1)
    except RuntimeError as error:
        # Blender's Python module 4.2 has no sound.
        pytest.skip(str(error).strip())


def two(tmp_path):
    """A strip of value 0.25 at frame 11, one of 0.5 two seconds later, one on another channel."""
    first = first_strip(tmp_path)
    second = strip(level(tmp_path / "b.wav", 0.5), "Two", 11 + 2 * FPS, 1)
    other = strip(level(tmp_path / "c.wav", 0.9), "Music", 1, 2)
    return first, second, other


def heard(addon, stage, names=(), channel=0):
    """The frame at which the take begins, its sound, and its notes."""
    strips = addon("scene.sound.strips")
    scene = bpy.context.scene
    source = strips.as_one(scene, strips.chosen(scene, list(names), channel), stage.decode)
    return source.start_frame, source.load(stage.decode), source.notes


def test_the_strips_of_a_channel_are_one_take_with_the_pause_between_them(addon, stage, tmp_path):
    two(tmp_path)
    start, sound, notes = heard(addon, stage, channel=1)
    assert start == 11 and notes == []
    assert sound.duration_s == pytest.approx(3.0, abs=1e-3)
    at = [sound.samples[int(second * RATE)] for second in (0.5, 1.5, 2.5)]
    assert at == pytest.approx([0.25, 0.0, 0.5], abs=1e-3)


def test_chosen_strips_that_overlap_add_up(addon, stage, tmp_path):
    two(tmp_path)
    start, sound, _ = heard(addon, stage, names=["Music", "One"])
    assert start == 1
    at = [sound.samples[int(second * RATE)] for second in (0.2, 0.7, 1.2)]
    assert at == pytest.approx([0.9, 1.15, 0.25], abs=1e-3)


def test_trim_counts_for_every_strip(addon, stage, tmp_path):
    first, second, _ = two(tmp_path)
    first.frame_offset_start, second.frame_offset_end = 12, 12
    start, sound, _ = heard(addon, stage, channel=1)
    assert start == 23
    assert sound.duration_s == pytest.approx(2.0, abs=1e-3)


def test_packed_strips_are_heard_together(addon, stage, tmp_path):
    first, second, _ = two(tmp_path)
    for one in (first, second):
        one.sound.pack()
    for name in ("a.wav", "b.wav"):
        (tmp_path / name).unlink()
    assert heard(addon, stage, channel=1)[1].samples.max() == pytest.approx(0.5, abs=1e-3)


def test_muted_strips_are_left_out_and_named(addon, stage, tmp_path):
    first, second, _ = two(tmp_path)
    first.mute = True
    start, _, notes = heard(addon, stage, channel=1)
    assert start == 11 + 2 * FPS and notes == ["muted and left out: One"]
    second.mute = True
    with pytest.raises(addon("core.errors").AnyfaceError, match=r"muted \(One, Two\): unmute"):
        heard(addon, stage, channel=1)


def test_an_empty_channel_says_where_sound_is(addon, stage, tmp_path):
    two(tmp_path)
    with pytest.raises(addon("core.errors").AnyfaceError, match=r"channel 7.* on 1, 2"):
        heard(addon, stage, channel=7)


def test_sounds_of_different_rates_keep_their_place(addon):
    source, take = addon("core.source"), addon("core.take")
    slow = take.Sound(np.full(8000, 0.5, dtype=np.float32), 8000.0, "slow")
    resampled = source.resampled(slow, 16000.0)
    assert len(resampled) == 16000 and resampled == pytest.approx(np.full(16000, 0.5))


def test_selected_strips_are_kept_by_name_and_speak(addon, stage, tmp_path):
    ob = grid()
    first, second, music = two(tmp_path)
    first.select, second.select, music.select = True, True, False
    assert bpy.ops.anyface.use_selected_strips() == {"FINISHED"}
    first.select = second.select = False
    assert ob.anyface.source == "CHOSEN"
    second.mute = True
    assert bpy.ops.anyface.generate() == {"FINISHED"}
    assert "(muted and left out: Two)" in ob.anyface.report
    assert stage.calls[0][4].duration_s == pytest.approx(1.0, abs=1e-3)


def test_the_panel_shows_where_the_sound_begins_and_ends(addon, stage, tmp_path):
    ob = grid()
    bpy.context.scene.render.fps = FPS
    lines = addon("ui.audio").lines
    ob.anyface.source, ob.anyface.sound_file = "FILE", level(tmp_path / "a.wav", 0.1, seconds=2.0)
    ob.anyface.start_frame = 5
    assert lines(ob, bpy.context.scene) == [("frames 5 to 52, 2.00 s", "SOUND")]
    ob.anyface.sound_file = str(tmp_path / "gone.wav")
    assert lines(ob, bpy.context.scene) == []
    first, _, _ = two(tmp_path)
    ob.anyface.source, ob.anyface_audio.channel = "CHANNEL", 1
    assert lines(ob, bpy.context.scene) == [("2 strips, frames 11 to 82, 3.00 s", "SOUND")]
    first.mute = True
    assert lines(ob, bpy.context.scene)[1] == ("Muted, left out: One", "MUTE_IPO_ON")
    ob.anyface.source, ob.anyface.strip = "STRIP", "Gone"
    text, icon = lines(ob, bpy.context.scene)[0]
    assert "got 'Gone'" in text and icon == "ERROR"


def test_the_only_strip_speaks_without_being_chosen(addon, stage, tmp_path):
    ob = grid()
    first_strip(tmp_path)
    ob.anyface.source = "STRIP"
    assert addon("ui.audio").lines(ob, bpy.context.scene)[0][0].startswith("One, frames 11")
    assert bpy.ops.anyface.generate() == {"FINISHED"}
    strip(level(tmp_path / "b.wav", 0.5), "Two", 99)
    with pytest.raises(RuntimeError, match="no sound: choose a strip or a sound file"):
        bpy.ops.anyface.generate()


def test_the_length_that_is_estimated_is_that_of_the_chosen_source(addon, stage, tmp_path):
    ob = grid()
    two(tmp_path)
    seconds = addon("ui.audio").seconds
    ob.anyface.sound_file = level(tmp_path / "file.wav", 0.1, seconds=2.0)
    lengths = {"FILE": 2.0, "CHANNEL": 3.0, "STRIP": None, "CHOSEN": None}
    for source, length in lengths.items():
        ob.anyface.source = source
        assert seconds(ob, bpy.context.scene) == (length and pytest.approx(length))
