"""How the page of a batch shows a take: its lip gap, sound, pictures and doubts."""

import base64

import numpy as np
import pytest

RATE, FPS = 16000, 25.0


@pytest.fixture
def look(addon):
    """The module under test."""
    return addon("core.look")


def speech(addon, parts):
    """A sound made of parts `(seconds, loudness)`."""
    tones = [
        loudness * np.sin(2.0 * np.pi * 200.0 * np.arange(int(seconds * RATE)) / RATE)
        for seconds, loudness in parts
    ]
    return addon("core.take").Sound(np.concatenate(tones).astype(np.float32), RATE, "voice")


def test_a_wave_is_peaks_up_to_one(addon, look):
    peaks = look.wave(speech(addon, [(1.0, 0.1), (1.0, 0.4)]))
    assert len(peaks) == 200 and peaks.max() == 1.0
    assert np.allclose(peaks[:99], 0.25, atol=0.01) and np.allclose(peaks[101:], 1.0, atol=0.01)
    assert look.wave(speech(addon, [(0.5, 0.0)])).max() == 0.0


def test_lips_that_rest_in_speech_gape_in_pauses_or_jump_are_doubted(addon, look):
    sound = speech(addon, [(2.0, 0.5), (2.0, 0.0)])
    times = np.arange(100) / FPS
    talks = np.where(times < 2.0, 4.0 + 4.0 * np.sin(20.0 * times), 0.0)
    assert look.doubts(talks, FPS, sound) == []
    (rests,) = look.doubts(0.1 * talks, FPS, sound)
    assert "part by no more than 0.8 mm" in rests
    (gapes,) = look.doubts(np.where(times < 2.0, talks, 6.0), FPS, sound)
    assert "open by 6.0 mm in pauses" in gapes
    pops = talks.copy()
    pops[20:50] = np.linspace(30.0, 0.0, 30)
    assert any("jump at 0.80 s" in text for text in look.doubts(pops, FPS, sound))
    assert look.doubts(talks[:1], FPS, sound) == []


def test_pictures_show_the_widest_lips_the_nearest_and_the_most(addon, look):
    take = addon("core.take")
    side = np.linspace(-0.1, 0.1, 21)
    x, y = np.meshgrid(side, side)
    points = np.column_stack([x.ravel(), y.ravel(), -4.0 * (x**2 + y**2).ravel()])
    at = np.arange(400) // 20 * 21 + np.arange(400) % 20
    triangles = np.concatenate(
        [np.column_stack([at, at + 1, at + 21]), np.column_stack([at + 1, at + 22, at + 21])]
    )
    bumps = (
        np.exp(-((x - 0.03) ** 2 + y**2) / 0.0008).ravel(),
        np.exp(-((x + 0.03) ** 2 + y**2) / 0.0008).ravel(),
    )
    vectors = np.zeros((2, 441, 3), np.float32)
    vectors[0, :, 1], vectors[1, :, 2] = 0.02 * bumps[0], 0.03 * bumps[1]
    weights = np.array([[0.0, 0.0], [1.0, 0.0], [0.1, 0.0], [0.8, 0.0], [0.0, 1.0]])
    life = take.Life(np.zeros((5, 3)), np.zeros((5, 2, 2)), np.eye(4)[:3], None, None)
    motion = take.Basis(vectors, weights, 0.0)
    basis_take = take.Take(FPS, 20.0, "BASIS", motion, life)
    basis_take.opening = np.array([0.0, 10.0, 1.0, 8.0, 0.0])
    face = take.FaceMesh("Head", points, triangles.astype(np.uint32), np.eye(4))
    assert look._rows(basis_take) == [1, 2]
    shown = look.pictures(face, basis_take)
    assert len(shown) == 2 and shown[0] != shown[1]
    for address in shown:
        kind, _, data = address.partition(",")
        assert kind == "data:image/png;base64" and base64.b64decode(data)[:4] == b"\x89PNG"
    key_take = take.Take(FPS, 20.0, "KEYS", take.ClipMotion(None, np.eye(3)), life)
    assert look.pictures(face, key_take) == []
    fields = look.of_take(face, speech(addon, [(0.2, 0.5)]), basis_take)
    assert fields["gap"] == {"fps": FPS, "values": [0.0, 10.0, 1.0, 8.0, 0.0]}
    assert fields["duration_s"] == 0.2 and len(fields["pictures"]) == 2
