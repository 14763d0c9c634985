"""Streams of a face while somebody is speaking, and the microphone."""

import numpy as np
import pytest

from conftest import RATE_HZ, spoken


def followed(anyface, blocks, **options):
    """The frames of a stream that gets a voice in these blocks."""
    with anyface.Stream(any_sound=True, **options) as stream:
        frames = []
        for block in blocks:
            stream.push(block)
            frames += stream.frames()
        stream.finish()
        return frames + list(stream.frames())


def test_frames_are_the_same_however_the_sound_comes(anyface):
    voice = spoken()
    whole = followed(anyface, [voice])
    pieces = followed(anyface, np.split(voice, range(100, len(voice), 317)))
    assert [frame.index for frame in whole] == list(range(round(25 * len(voice) / RATE_HZ + 0.49)))
    assert whole[25].time_s == 1.0
    for one, other in zip(whole, pieces, strict=True):
        assert np.array_equal(one.shapes, other.shapes)
        assert np.array_equal(one.visemes, other.visemes)
        assert np.array_equal(one.head, other.head)


def test_a_voice_opens_the_mouth_and_an_emotion_smiles(anyface):
    with anyface.Stream() as stream:
        shapes, visemes = stream.names
        assert len(shapes) == 52 and visemes[0] == "viseme_sil"
        assert 0.0 < stream.latency_s <= 0.2
    jaw, smile = shapes.index("jawOpen"), shapes.index("mouthSmileLeft")
    neutral = np.array([frame.shapes for frame in followed(anyface, [spoken()])])
    happy = np.array([f.shapes for f in followed(anyface, [spoken()], emotion="happy:1")])
    assert neutral.min() >= 0.0 and neutral.max() <= 1.0
    assert neutral[:, jaw].max() > 0.1
    assert happy[:, smile].mean() > neutral[:, smile].mean() + 0.1


def test_an_emotion_is_heard_as_it_comes(anyface):
    # A buzz carries no emotion. What matters is that blocks of any size give the same result.
    voice = spoken(3.0)
    whole = followed(anyface, [voice], emotion="auto")
    pieces = followed(anyface, np.split(voice, range(1600, len(voice), 1600)), emotion="auto")
    for one, other in zip(whole, pieces, strict=True):
        assert np.array_equal(one.shapes, other.shapes)


@pytest.mark.parametrize("look_ahead, latency_s", [(0.19, 0.1925), (0.07, 0.0725), (0.0, 0.0)])
def test_frames_come_sooner_with_less_look_ahead(anyface, look_ahead, latency_s):
    voice = spoken()
    with anyface.Stream(any_sound=True, look_ahead=look_ahead) as stream:
        assert stream.latency_s == pytest.approx(latency_s)
        stream.push(voice[: round((1.0 + latency_s) * RATE_HZ)])
        # The frames of 0 to 1 s.
        assert len(list(stream.frames())) == 26
        jaw = stream.names[0].index("jawOpen")
    whole = followed(anyface, [voice], look_ahead=look_ahead)
    pieces = followed(anyface, np.split(voice, range(100, len(voice), 317)), look_ahead=look_ahead)
    assert len(whole) == round(25 * len(voice) / RATE_HZ + 0.49)
    assert max(frame.shapes[jaw] for frame in whole) > 0.1
    for one, other in zip(whole, pieces, strict=True):
        assert np.array_equal(one.shapes, other.shapes)


def test_what_cannot_be_done_is_said(anyface):
    with pytest.raises(anyface.AnyfaceError, match="look-ahead"):
        anyface.Stream(look_ahead=-1.0)
    stream = anyface.Stream()
    with pytest.raises(anyface.AnyfaceError, match="finite"):
        stream.push([np.nan])
    with pytest.raises(anyface.AnyfaceError, match="joyous"):
        stream.emotion = "joyous:1"
    stream.close()
    stream.close()
    with pytest.raises(anyface.AnyfaceError, match="closed"):
        stream.push([0.0])
    with pytest.raises(anyface.AnyfaceError, match="whole sound"):
        anyface.Stream(engine=anyface.Engine(system="cafe-talk"))


def test_a_microphone_that_is_none_is_refused(anyface):
    names = anyface.microphones()
    assert all(isinstance(name, str) for name in names)
    with pytest.raises(anyface.AnyfaceError, match="microphone: expected"):
        anyface.Microphone("a device that nobody has")
