"""Speech and emotion as two layers of a take, and emotion taken from another recording."""

import bpy
import numpy as np
import pytest

from figures import FPS, film, shape, strip, tone, write_wav
from test_heads import LANDMARKS, import_head

SYSTEM, START, SECONDS = "emoface", 11, 2.0
FRAMES = range(START, START + int(SECONDS * FPS), 4)


def voice(path, hertz, sway):
    """A rough imitation of a voice: a buzz in syllables whose pitch sways."""
    rate = 16000
    time = np.arange(int(SECONDS * rate)) / rate
    turns = 2 * np.pi * np.cumsum(hertz * 2.0 ** (sway * np.sin(5.0 * time))) / rate
    buzz = sum(np.sin(k * turns) / k for k in range(1, 12))
    write_wav(path, 0.25 * buzz * (0.2 + np.abs(np.sin(9.0 * time))), rate)
    return str(path)


@pytest.fixture
def speaking(addon, tmp_path):
    """The default head with the system EmoFace, about to speak the strip Calm."""
    ob = import_head()
    bpy.context.view_layer.objects.active = ob
    strip(voice(tmp_path / "calm.wav", 110.0, 0.02), "Calm", START)
    strip(voice(tmp_path / "wild.wav", 320.0, 0.5), "Wild", START, channel=2)
    ob.anyface.strip, ob.anyface.system, ob.anyface.mode = "Calm", SYSTEM, "basis"
    # These tests compare layers more finely than curves with few keys are accurate.
    ob.anyface.curves = "EVERY"
    return ob


def generate(ob):
    assert bpy.ops.anyface.generate() == {"FINISHED"}, ob.anyface.report


def masked_keys(ob):
    """The keys of the emotion layer, which a vertex group masks."""
    return [block for block in ob.data.shape_keys.key_blocks if block.vertex_group]


def test_layers_add_up_to_the_take_without_layers(speaking):
    ob = speaking
    ob.anyface.layered = False
    generate(ob)
    whole = film(ob, FRAMES)
    assert not masked_keys(ob) and not ob.vertex_groups
    ob.anyface.layered = True
    generate(ob)
    assert masked_keys(ob) and [group.name for group in ob.vertex_groups] == ["Emotion Mask"]
    apart_mm = 1000.0 * np.linalg.norm(film(ob, FRAMES) - whole, axis=2)
    assert apart_mm.max() < 2.5 * ob.anyface.error_mm


def test_paint_takes_emotion_away_without_a_new_run(speaking):
    ob = speaking
    generate(ob)
    as_made = film(ob, FRAMES)
    ob.anyface_output.emotion = 0.0
    said = film(ob, FRAMES)
    ob.anyface_output.emotion = 1.0
    assert 1000.0 * np.linalg.norm(as_made - said, axis=2).max() > 0.3
    middle = np.median([v.co.y for v in ob.data.vertices])
    half = [v.index for v in ob.data.vertices if v.co.y > middle]
    ob.vertex_groups["Emotion Mask"].add(half, 0.0, "REPLACE")
    ob.data.update()
    painted = film(ob, FRAMES)
    others = np.setdiff1d(np.arange(len(ob.data.vertices)), half)
    assert np.abs(painted[:, half] - said[:, half]).max() < 2e-5
    assert np.abs(painted[:, others] - as_made[:, others]).max() < 2e-5


def test_a_painted_mask_serves_the_next_take_and_stays_when_that_goes(addon, speaking):
    ob = speaking
    generate(ob)
    ob.vertex_groups["Emotion Mask"].add([0, 1, 2], 0.25, "REPLACE")
    generate(ob)
    assert [group.name for group in ob.vertex_groups] == ["Emotion Mask"]
    assert bpy.ops.anyface.remove() == {"FINISHED"}
    assert ob.data.shape_keys is None
    assert ob.vertex_groups["Emotion Mask"].weight(1) == 0.25
    ob.vertex_groups.remove(ob.vertex_groups[0])
    generate(ob)
    assert bpy.ops.anyface.remove() == {"FINISHED"}
    assert not ob.vertex_groups


def test_another_strip_gives_the_emotion(addon, speaking):
    ob = speaking
    generate(ob)
    own_film = film(ob, FRAMES)
    ob.anyface_audio.emotion_strip = "Wild"
    generate(ob)
    other = film(ob, FRAMES)
    felt_mm = 1000.0 * np.linalg.norm(other - own_film, axis=2)
    assert felt_mm.max() > 0.3
    # The speech layer is the same.
    ob.anyface_output.emotion = 0.0
    said = film(ob, FRAMES)
    ob.anyface_audio.emotion_strip = ""
    generate(ob)
    ob.anyface_output.emotion = 0.0
    said_mm = 1000.0 * np.linalg.norm(film(ob, FRAMES) - said, axis=2)
    assert said_mm.max() < 0.01
    # A system that hears no emotion ignores the emotion strip.
    ob.anyface_audio.emotion_strip, ob.anyface.system = "Wild", "freetalk"
    generate(ob)


@pytest.mark.parametrize(("seconds", "said"), [(0.5, "0.50 s"), (None, "Nobody")])
def test_a_emotion_that_cannot_be_heard_is_told_and_nothing_is_lost(
    addon, speaking, tmp_path, seconds, said
):
    ob = speaking
    generate(ob)
    before = film(ob, FRAMES)
    if seconds is None:
        ob.anyface_audio.emotion_strip = "Nobody"
    else:
        strip(tone(tmp_path / "short.wav", seconds=seconds), "Short", START, channel=3)
        ob.anyface_audio.emotion_strip = "Short"
    with pytest.raises(RuntimeError, match=said):
        bpy.ops.anyface.generate()
    assert np.array_equal(film(ob, FRAMES), before)
    assert ob.data.shape_keys.animation_data.action is not None


def test_a_take_starts_from_the_pose_of_the_current_frame(addon, speaking):
    ob, scene = speaking, bpy.context.scene
    generate(ob)
    frames = [START, *FRAMES[1:]]
    poses = dict(zip(frames, film(ob, frames), strict=True))
    apart_mm = lambda a, b: 1000.0 * np.linalg.norm(a - b, axis=1).max()  # noqa: E731
    far, end = max((apart_mm(pose, poses[START]), frame) for frame, pose in poses.items())
    ob.anyface.starts_from_pose = True
    scene.frame_set(end)
    generate(ob)
    joined = apart_mm(shape(ob, START), poses[end])
    assert joined < 1.7 < 3.0 < far, (joined, far)
    # Half a second later the face has left the pose from which it started.
    assert apart_mm(shape(ob, START + int(0.5 * FPS)), poses[end]) > 1.0
    # A system that always starts from rest ignores the setting.
    ob.anyface.system = "freetalk"
    generate(ob)


def test_a_pose_of_absolute_keys_is_refused_in_words(addon, speaking):
    ob = speaking
    ob.anyface.mode = "frames"
    generate(ob)
    ob.anyface.mode, ob.anyface.starts_from_pose = "basis", True
    with pytest.raises(RuntimeError, match="Start from Current Pose"):
        bpy.ops.anyface.generate()


def test_the_take_knows_whose_emotion_it_has(addon, speaking):
    ob = speaking
    ob.anyface_audio.emotion_strip = "Wild"
    generate(ob)
    settings = addon("scene.shape_keys.record").read(ob.data.shape_keys).asked
    assert settings["anyface_audio"]["emotion_strip"] == "Wild" and settings["anyface"]["layered"]


def test_the_heat_map_is_one_step_and_leaves_the_artists_colours(addon, speaking):
    ob = speaking
    colours = ob.data.color_attributes
    colours.new("Mine", "BYTE_COLOR", "CORNER").data[0].color = (0.25, 0.5, 0.75, 1.0)
    colours.active_color_name = "Mine"
    mine = [tuple(corner.color) for corner in colours["Mine"].data]
    bpy.context.scene.frame_set(START + 20)
    assert bpy.ops.anyface.heat_map() == {"FINISHED"}
    assert {attribute.name for attribute in colours} == {"Mine", "Emotion Heat"}
    assert colours.active_color_name == "Mine"
    assert [tuple(corner.color) for corner in colours["Mine"].data] == mine
    heat = np.empty(4 * len(ob.data.vertices), dtype=np.float32)
    colours["Emotion Heat"].data.foreach_get("color", heat)
    heat = heat.reshape(-1, 4)
    # The map is redder at the brows, where emotion moves the face, than at the lips.
    places = np.array([vertex.co for vertex in ob.data.vertices])
    marks = landmarks_of(ob)
    near = lambda numbers: (  # noqa: E731
        np.linalg.norm(places[:, None] - marks[list(numbers)], axis=2).min(axis=1) < 0.012
    )
    assert heat[near(range(17, 27)), 0].mean() > heat[near(range(48, 68)), 0].mean() + 0.05
    assert (heat[:, 3] == 1.0).all() and heat[:, :3].min() >= 0.0 and heat[:, :3].max() <= 1.0
    # A second press replaces the map. Hiding it restores the mesh.
    bpy.context.scene.frame_set(START + 35)
    assert bpy.ops.anyface.heat_map() == {"FINISHED"}
    assert {attribute.name for attribute in colours} == {"Mine", "Emotion Heat"}
    assert bpy.ops.anyface.heat_map_hide() == {"FINISHED"}
    assert [attribute.name for attribute in colours] == ["Mine"]
    assert not bpy.ops.anyface.heat_map_hide.poll()
    assert ob.data.shape_keys is None and not ob.vertex_groups


def landmarks_of(ob):
    """The landmarks of the default head, `[68, 3]` object space."""
    return np.array([ob.data.vertices[mark["vertex"]].co for mark in LANDMARKS])


def test_a_system_without_emotion_has_no_heat_map(addon, speaking):
    speaking.anyface.system = "freetalk"
    assert not bpy.ops.anyface.heat_map.poll()
