"""*Choose a Sound File…* adds a strip that is not muted, and the face speaks it."""

import bpy
import pytest

from figures import FPS, curves, everything, grid, stand_in, strip, tone

SECONDS = 1.0


@pytest.fixture(autouse=True)
def stage(addon, tmp_path):
    """A `Stage` that replaces the engine. Skips the test if this Blender has no sound."""
    try:
        strip(tone(tmp_path / "probe.wav"))
    except RuntimeError:
        pytest.skip("this Blender has no sound")
    bpy.context.scene.sequence_editor_clear()
    return stand_in(addon)


@pytest.fixture
def sound(tmp_path):
    """A sound file of one second."""
    return tone(tmp_path / "voice.wav", SECONDS)


def strips(addon, scene=None):
    return addon("scene.sound.sequencer").sound_strips(scene or bpy.context.scene)


def choose(sound):
    assert bpy.ops.anyface.choose_sound(filepath=sound) == {"FINISHED"}


def test_a_scene_without_sequencer_gets_a_strip_that_is_heard(addon, stage, sound):
    ob, scene = grid(), bpy.context.scene
    assert scene.sequence_editor is None
    scene.frame_set(31)
    choose(sound)
    (heard,) = strips(addon)
    assert addon("scene.sound.sequencer").ends(heard) == (31, 31 + round(SECONDS * FPS))
    assert bpy.path.abspath(heard.sound.filepath) == sound and not heard.mute
    assert (heard.channel, heard.name) == (1, "voice")
    assert (ob.anyface.source, ob.anyface.strip) == ("STRIP", heard.name)
    assert bpy.ops.anyface.generate() == {"FINISHED"}
    assert stage.calls[-1][4].duration_s == pytest.approx(SECONDS, abs=1 / FPS)
    # When the strip moves, the next take moves with it.
    heard.frame_start += 10
    assert bpy.ops.anyface.generate() == {"FINISHED"}
    curve, *_ = curves(ob.data.shape_keys.animation_data.action)
    assert curve.range()[1] >= 41 + SECONDS * FPS - 1


def test_the_lowest_channel_that_is_free_and_heard_there_is_taken(addon, sound, tmp_path):
    ob, other = grid(), tone(tmp_path / "music.wav", 4.0)
    strip(other, "Music", 1, 1)
    strip(other, "Later", 200, 2)
    editor = bpy.context.scene.sequence_editor
    editor.channels[2].mute = True
    choose(sound)
    (voice,) = [one for one in strips(addon) if one.name == "voice"]
    assert voice.channel == 3 and ob.anyface.strip == "voice"
    editor.channels[2].mute = False
    bpy.context.scene.frame_set(50)
    choose(sound)
    assert sorted(one.channel for one in strips(addon)) == [1, 2, 2, 3]
    assert ob.anyface.strip == "voice.001"


def test_a_strip_that_stands_there_already_is_taken_and_heard(addon, sound):
    ob = grid()
    choose(sound)
    strips(addon)[0].mute = True
    ob.anyface.strip = ""
    choose(sound)
    (only,) = strips(addon)
    assert ob.anyface.strip == only.name and not only.mute
    second = grid("Second")
    choose(sound)
    assert len(strips(addon)) == 1 and second.anyface.strip == only.name
    bpy.context.scene.frame_set(7)
    choose(sound)
    assert len(strips(addon)) == 2


def test_each_scene_has_strips_of_its_own(addon, sound):
    first = bpy.context.scene
    grid()
    choose(sound)
    second = bpy.data.scenes.new("Second")
    bpy.context.window.scene = second
    ob = grid("Other")
    assert bpy.context.scene == second
    choose(sound)
    assert len(strips(addon, first)) == len(strips(addon, second)) == 1
    assert ob.anyface.strip == "voice"
    assert bpy.ops.anyface.generate() == {"FINISHED"}


def test_undo_takes_the_strip_away(addon, sound):
    grid()
    bpy.ops.ed.undo_push(message="Before")
    before = everything()
    assert bpy.ops.anyface.choose_sound("EXEC_DEFAULT", True, filepath=sound) == {"FINISHED"}
    assert len(strips(addon)) == 1
    assert bpy.ops.ed.undo() == {"FINISHED"}
    assert strips(addon) == [] and everything() == before
    assert bpy.context.object.anyface.strip == ""


def test_what_blender_cannot_play_is_spoken_all_the_same(addon, stage, tmp_path):
    ob, odd = grid(), tmp_path / "odd.wav"
    odd.write_bytes(b"no sound that Blender knows")
    bpy.context.scene.frame_set(12)
    choose(str(odd))
    assert (ob.anyface.source, ob.anyface.sound_file) == ("FILE", str(odd))
    assert ob.anyface.start_frame == 12 and strips(addon) == []
    assert "odd" not in {one.name.partition(".")[0] for one in bpy.data.sounds}


def test_a_full_sequencer_says_so(addon, sound, monkeypatch):
    grid()
    choose(sound)
    monkeypatch.setattr(addon("scene.sound.sequencer"), "MAX_CHANNELS", 1)
    bpy.context.scene.frame_set(5)
    with pytest.raises(RuntimeError, match="no channel of the sequencer is free at frame 5"):
        choose(sound)
    assert len(strips(addon)) == 1
