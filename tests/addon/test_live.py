"""*Live*: a face follows its sound without a take, and nothing is left behind."""

import wave

import bpy
import numpy as np
import pytest

from figures import own_keys, select, shape, write_wav

KEY = "Anyface Live"


@pytest.fixture
def talker(tmp_path):
    """The sample head with two seconds of a voice that swells five times a second."""
    bpy.ops.anyface.add_sample_head()
    ob = bpy.context.object
    at = np.arange(32000) / 16000
    buzz = sum(np.sin(2 * np.pi * 140 * k * at) / k for k in range(1, 15))
    write_wav(tmp_path / "voice.wav", 0.2 * buzz * (0.5 - 0.5 * np.cos(10 * np.pi * at)), 16000)
    ob.anyface.source, ob.anyface.sound_file = "FILE", str(tmp_path / "voice.wav")
    ob.anyface.start_frame = 1
    bpy.context.scene.render.fps = 24
    return ob


def moved(ob, frame):
    """The largest change of a coordinate from rest, in a frame."""
    bpy.context.scene.frame_set(frame)
    rest = np.empty(len(ob.data.vertices) * 3, dtype=np.float32)
    ob.data.shape_keys.reference_key.points.foreach_get("co", rest)
    return np.abs(shape(ob, frame) - rest.reshape(-1, 3)).max()


def test_it_follows_in_any_order_and_nothing_stays(talker):
    before = shape(talker, 1)
    assert talker.data.shape_keys is None
    assert bpy.ops.anyface.live() == {"FINISHED"}
    shapes = {frame: shape(talker, frame) for frame in (1, 14, 20, 26, 33)}
    assert max(np.abs(shapes[frame] - before).max() for frame in shapes) > 0.002
    # Going back shows the same face again. The stream starts anew and has warmed up by then.
    again = shape(talker, 20)
    assert np.abs(again - shapes[20]).max() < 0.1 * np.abs(shapes[20] - before).max()
    assert np.abs(shape(talker, 400) - before).max() < 1e-6, "the sound is over"
    assert bpy.ops.anyface.live() == {"FINISHED"}
    assert talker.data.shape_keys is None
    assert np.array_equal(shape(talker, 20), before)


def test_the_mouth_moves_while_the_voice_is_heard(talker, tmp_path):
    """The sound is a second of silence, then the voice."""
    with wave.open(talker.anyface.sound_file) as voice:
        samples = np.frombuffer(voice.readframes(voice.getnframes()), "<i2") / 32768
    write_wav(tmp_path / "late.wav", np.concatenate([np.zeros(16000), samples]), 16000)
    talker.anyface.sound_file = str(tmp_path / "late.wav")
    rest = shape(talker, 1)
    bpy.ops.anyface.live()
    silent, spoken = (
        max(np.abs(shape(talker, frame) - rest).max() for frame in frames)
        for frames in (range(6, 20, 3), range(30, 54, 3))
    )
    assert spoken > 0.002 and silent < 0.25 * spoken, (silent, spoken)


def test_the_emotion_may_change_meanwhile(talker):
    talker.anyface.emotion, talker.anyface.intensity = "happy", 0.0
    bpy.ops.anyface.live()
    plain = shape(talker, 20)
    talker.anyface.intensity = 1.0
    shape(talker, 30)
    assert np.abs(shape(talker, 44) - plain).max() > 0.003


def now(ob):
    """Positions `[V, 3]` as Blender shows them, without going to another frame."""
    bpy.context.view_layer.update()
    mesh = ob.evaluated_get(bpy.context.evaluated_depsgraph_get()).data
    points = np.empty(len(mesh.vertices) * 3, dtype=np.float32)
    mesh.vertices.foreach_get("co", points)
    return points.reshape(-1, 3)


def test_the_emotion_shows_while_nothing_plays(talker):
    talker.anyface.emotion, talker.anyface.intensity = "happy", 0.0
    bpy.ops.anyface.live()
    bpy.context.scene.frame_set(20)
    plain = now(talker)
    talker.anyface.intensity = 1.0
    happy = now(talker)
    assert np.abs(happy - plain).max() > 0.002
    assert np.array_equal(now(talker), happy), "nothing else has changed"
    talker.anyface.emotion = "angry"
    assert np.abs(now(talker) - happy).max() > 0.002
    bpy.ops.anyface.emotion_add()
    mixed = now(talker)
    bpy.ops.anyface.emotion_remove(number=0)
    assert np.abs(now(talker) - mixed).max() > 0.001
    talker.anyface.intensity = 0.0
    assert np.abs(now(talker) - plain).max() < 0.0005


def test_keys_of_the_artist_stay_and_the_chosen_one_stays_chosen(talker):
    own_keys(talker, "Smile", "Frown")
    talker.active_shape_key_index = 1
    bpy.ops.anyface.live()
    assert talker.data.shape_keys.key_blocks[KEY].value == 1.0
    bpy.ops.anyface.live()
    assert [b.name for b in talker.data.shape_keys.key_blocks] == ["Basis", "Smile", "Frown"]
    assert talker.active_shape_key_index == 1


def test_saving_ends_it_and_the_file_holds_nothing(talker, tmp_path, addon):
    bpy.ops.anyface.live()
    path = str(tmp_path / "shot.blend")
    bpy.ops.wm.save_as_mainfile(filepath=path)
    assert talker.data.shape_keys is None and not addon("scene.live").is_on(talker)
    bpy.ops.anyface.live()
    bpy.ops.wm.open_mainfile(filepath=path)
    assert not addon("scene.live")._followers
    assert all(ob.data.shape_keys is None for ob in bpy.data.objects if ob.type == "MESH")


def test_two_characters_follow_and_a_copy_is_left_clean(talker, addon):
    bpy.ops.anyface.live()
    select(talker)
    bpy.ops.object.duplicate()
    copy = bpy.context.object
    assert copy != talker and KEY in copy.data.shape_keys.key_blocks
    copy.anyface.emotion, copy.anyface.intensity = "angry", 1.0
    bpy.context.scene.anyface.character = None
    bpy.context.view_layer.objects.active = copy
    assert bpy.ops.anyface.live() == {"FINISHED"}
    shape(talker, 20)
    assert np.abs(shape(copy, 34) - shape(talker, 34)).max() > 0.002
    assert bpy.ops.anyface.live() == {"FINISHED"}
    assert copy.data.shape_keys is None and addon("scene.live").is_on(talker)
    addon("scene.live").end(talker)
    assert talker.data.shape_keys is None


def test_an_undo_in_the_middle_ends_it(talker, addon):
    bpy.ops.ed.undo_push(message="before")
    bpy.ops.anyface.live()
    bpy.context.scene.frame_set(20)
    bpy.ops.ed.undo_push(message="something with the key in it")
    bpy.ops.ed.undo()
    bpy.ops.ed.redo()
    assert not addon("scene.live")._followers
    assert all(ob.data.shape_keys is None for ob in bpy.data.objects if ob.type == "MESH")


def test_a_take_is_generated_while_it_follows(talker):
    bpy.ops.anyface.live()
    assert bpy.ops.anyface.generate() == {"FINISHED"}
    names = [block.name for block in talker.data.shape_keys.key_blocks]
    assert KEY not in names and len(names) > 5
    assert not bpy.ops.anyface.live.poll()


def test_a_mesh_that_changes_ends_it_in_words(talker, addon):
    bpy.ops.anyface.live()
    talker.shape_key_clear()
    bpy.context.scene.frame_set(20)
    assert not addon("scene.live").is_on(talker)
    assert "key" in talker.anyface.report and talker.anyface.report_is_error


def test_a_system_that_needs_the_whole_sound_says_so(talker):
    talker.anyface.system = "cafe-talk"
    with pytest.raises(RuntimeError, match="needs the whole sound"):
        bpy.ops.anyface.live()
    assert talker.data.shape_keys is None


def test_emoface_follows_too(talker):
    talker.anyface.system = "emoface"
    bpy.ops.anyface.live()
    bpy.context.scene.frame_set(1)
    assert max(moved(talker, frame) for frame in range(10, 40, 6)) > 0.002
