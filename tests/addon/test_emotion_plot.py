"""The emotion heard in a voice: kept with the take, drawn once, compared with a neutral voice."""

import bpy
import numpy as np
import pytest

from figures import select, tone
from test_emotion_of import voice
from test_heads import import_head
from test_panels import draw_all


@pytest.fixture
def speaking(addon, tmp_path):
    """The default head with a voice whose emotion is heard."""
    bpy.context.window_manager.anyface_more = True
    ob = import_head()
    select(ob)
    settings = ob.anyface
    settings.source, settings.emotion_source = "FILE", "VOICE"
    settings.sound_file = voice(tmp_path / "voice.wav", 110.0, 0.02)
    return ob


def generate(ob):
    assert bpy.ops.anyface.generate() == {"FINISHED"}, ob.anyface.report


@pytest.fixture
def heard(addon):
    """`heard(ob)` is the emotion heard in the take of `ob`, or None."""

    def of(ob):
        take_and_emotion = addon("ui.emotion_plot").heard(ob)
        return None if take_and_emotion is None else take_and_emotion[1]

    return of


def words(addon):
    """The texts of the emotion subpanel."""
    return [text for text, _ in draw_all(addon)["ANYFACE_PT_emotion"]]


def test_a_take_keeps_what_was_heard_and_the_panel_draws_it_once(
    addon, speaking, heard, tmp_path, monkeypatch
):
    assert heard(speaking) is None and "Heard in the Voice" not in words(addon)
    generate(speaking)
    emotion = heard(speaking)
    assert len(emotion.time_s) >= 4 and emotion.time_s == sorted(emotion.time_s)
    rows = np.array(list(emotion.probability.values()))
    assert np.abs(rows.sum(axis=0) - 1.0).max() < 0.01
    assert np.abs([emotion.valence, emotion.arousal]).max() <= 1.0
    plot, drawings = addon("core.plot"), []
    draw = plot.draw
    monkeypatch.setattr(plot, "draw", lambda *curves: drawings.append(curves) or draw(*curves))
    assert "Heard in the Voice" in words(addon)
    likeliest = emotion.likely()[0][0].capitalize()
    assert any(text.startswith(f"{likeliest}, up to") for text in words(addon))
    assert len(drawings) == 1
    module = addon("ui.emotion_plot")
    take_id, _ = module.heard(speaking)
    picture = module._previews[f"take {take_id}"]
    assert tuple(picture.image_size) == (256, 256)
    pixels = np.array(picture.image_pixels_float[:]).reshape(256, 256, 4)
    assert pixels[..., 3].min() == 1.0 and pixels[..., :3].max() > 0.5
    # The emotion is still there after the file is opened again.
    path = str(tmp_path / "shot.blend")
    bpy.ops.wm.save_as_mainfile(filepath=path)
    bpy.ops.wm.open_mainfile(filepath=path)
    ob = bpy.data.objects["Head"]
    select(ob)
    bpy.context.window_manager.anyface_more = True
    assert heard(ob) == emotion
    assert "Heard in the Voice" in words(addon) and len(drawings) == 2


def test_each_take_has_its_own_picture_and_one_that_heard_nothing_has_none(
    addon, speaking, heard, tmp_path
):
    generate(speaking)
    first = heard(speaking)
    speaking.anyface.sound_file = voice(tmp_path / "wild.wav", 320.0, 0.5)
    assert bpy.ops.anyface.take_keep() == {"FINISHED"}
    generate(speaking)
    assert heard(speaking) not in (None, first)
    speaking.anyface.emotion_source = "GIVEN"
    generate(speaking)
    assert heard(speaking) is None and "Heard in the Voice" not in words(addon)
    first_take = addon("scene.takes.take_list").rows(speaking)[0]
    addon("scene.takes.take_list").switch(speaking, first_take.id)
    assert heard(speaking) == first


def test_a_neutral_voice_changes_what_is_heard(addon, speaking, heard, tmp_path):
    generate(speaking)
    alone = heard(speaking)
    neutral = voice(tmp_path / "neutral.wav", 115.0, 0.05)
    speaking.anyface_audio.neutral_voice = neutral
    generate(speaking)
    beside = heard(speaking)
    assert beside.time_s == alone.time_s and beside.probability != alone.probability
    settings = addon("scene.shape_keys.record").read(speaking.data.shape_keys).asked
    assert settings["anyface_audio"]["neutral_voice"] == neutral


@pytest.mark.parametrize(("seconds", "said"), [(0.5, "0.50 s"), (None, "Neutral Voice: no sound")])
def test_a_neutral_voice_that_cannot_be_heard_is_told(addon, speaking, tmp_path, seconds, said):
    path = tmp_path / "short.wav"
    if seconds is not None:
        tone(path, seconds=seconds)
    speaking.anyface_audio.neutral_voice = str(path)
    with pytest.raises(RuntimeError, match=said):
        bpy.ops.anyface.generate()
    assert speaking.data.shape_keys is None
    # If the emotion is not taken from the voice, the neutral voice is ignored.
    speaking.anyface.emotion_source = "GIVEN"
    generate(speaking)


def test_what_is_no_emotion_is_none_and_a_long_sound_is_thinned_out(addon):
    kind = addon("core.heard_emotion").HeardEmotion
    level = {"time_s": [0.0], "intensity": [0.5], "valence": [0.5], "arousal": [0.5]}
    for more in (None, {}, {"sad": [0.1, 0.2]}, {"sad": "x"}, {"sad": [float("nan")]}, []):
        emotion = kind.of_plain(level | {"probability": more})
        assert (emotion is not None) == (more in ({}, []))
    for values in ({}, "text", [], {"time_s": 1}, {**level, "time_s": [[0.0]]}):
        assert kind.of_plain(values) is None
    assert kind.of_json(None) is None
    times = [0.32 * k for k in range(3000)]
    level = [0.5] * len(times)
    long = kind(times, {"neutral": level, "sad": [0.001 * (k % 400) for k in range(3000)]},
                level, level, level)  # fmt: skip
    thinned = kind.of_plain(long.to_plain())
    assert len(thinned.time_s) == len(thinned.probability["sad"]) == len(thinned.valence) == 200
    assert thinned.time_s[0] == 0.0 and thinned.time_s[-1] == pytest.approx(times[-1], abs=1e-3)
    assert [name for name, *_ in thinned.likely()] == ["neutral", "sad"]


def test_curves_lie_where_their_values_are(addon):
    plot = addon("core.plot")
    times = np.linspace(0.0, 3.0, 10)
    red, blue = (1.0, 0.0, 0.0), (0.0, 0.0, 1.0)
    drawn = plot.draw(times, [(np.full(10, 0.25), red), (np.linspace(0.0, 1.0, 10), blue)], 128)
    assert drawn.shape == (128, 128, 4) and (drawn[..., 3] == 255).all()
    is_red, is_blue = (drawn[..., k] > 150 for k in (0, 2))
    rows = np.flatnonzero(is_red.any(axis=1))
    assert 90 <= rows.min() <= rows.max() <= 95
    # The second curve rises from the lower left to the upper right and covers the first.
    left, right = (np.flatnonzero(is_blue[:, column]).mean() for column in (10, 117))
    assert left > 110 > 20 > right and not (is_red & is_blue).any()
    once = plot.draw(times[:1], [(np.array([1.0]), red)], 64)
    assert (once[:, 32, 0] > 150).sum() in (2, 3)
