"""The ear for emotion: what it hears, how it learns, and that the recording's source says nothing."""

from pathlib import Path

import numpy as np
import torch

from training.nn.checkpoint import write_model
from training.speech.distil_emotion import cut, directions, moved, pooled
from training.speech.emotion_ear import (
    ARRAYS,
    EmotionEarConfig,
    EmotionEarNet,
    inputs_of,
    read_ear,
    rows_of,
)
from training.systems.emoface.emotion_encoder import HEARD_EMOTIONS, NUMBERS, instants, voice_of
from training.systems.emoface.golden_emotion_encoder import made_voice

SMALL = EmotionEarConfig(channels=16, coarse_dilations=[1], hidden=8, told=6)


def test_a_louder_voice_is_heard_alike():
    voice = voice_of(made_voice())
    parts = [torch.from_numpy(x).float()[None] for x in (voice.mel, voice.octave, voice.periodic)]
    heard, weight = inputs_of(*parts)
    louder, same = inputs_of(parts[0] + 2.0, *parts[1:])
    assert torch.allclose(heard, louder, atol=1e-5) and torch.equal(weight, same)
    assert heard.shape == (1, len(voice.mel), 66)


def test_every_instant_has_a_row():
    torch.manual_seed(0)
    voice = voice_of(made_voice())
    rows = rows_of(EmotionEarNet(SMALL).eval(), voice)
    assert rows.shape == (len(instants(len(voice.mel))), SMALL.told + NUMBERS)


def test_sounds_that_are_moved_keep_their_peak_and_their_parts_their_length():
    random = torch.Generator().manual_seed(0)
    sounds = torch.from_numpy(np.stack([made_voice()[:32000]] * 12)) / 0.2
    heard = moved(sounds, random)
    assert torch.allclose(heard.abs().amax(dim=1), torch.full((12,), 0.9), atol=1e-5)
    plain = 0.9 / sounds.abs().amax(dim=1, keepdim=True) * sounds
    is_plain = torch.isclose(heard, plain, atol=1e-5).all(dim=1)
    assert 1 <= is_plain.sum() <= 8
    sounds = sounds[:3]
    lengths = torch.tensor([32000, 20000, 13000])
    for frames, (which, parts) in cut(sounds, lengths, random).items():
        assert parts.shape == (len(which), frames * 160) and frames % 20 == 0
        assert (lengths[which] >= frames * 160).all()


def test_the_first_directions_are_those_of_emotions():
    random = torch.Generator().manual_seed(0)
    rows = torch.randn(400, 300, generator=random)
    emotion_offsets = torch.zeros(100, 300)
    emotion_offsets[:, 7] = torch.randn(100, generator=random)
    mean, scale, basis = directions(rows, emotion_offsets, 60)
    assert basis.shape == (300, 60) and basis[7, 0].abs() > 0.99
    assert pooled([torch.ones(2, 5, 3)]).shape == (2, 9)


def test_an_ear_is_read_as_it_was_written(tmp_path: Path):
    torch.manual_seed(0)
    net, size = EmotionEarNet(SMALL).eval(), SMALL.told + NUMBERS
    shapes = {"weight": (size, len(HEARD_EMOTIONS)), "bias": (len(HEARD_EMOTIONS),)}
    arrays = {name: torch.randn(shapes.get(name, (size,))) for name in ARRAYS}
    write_model(tmp_path, arrays | net.state_dict(), SMALL.to_json(), exact=("",))
    ear = read_ear(tmp_path)
    assert all(np.array_equal(x.numpy(), getattr(ear, name)) for name, x in arrays.items())
    voice = voice_of(made_voice())
    assert np.array_equal(rows_of(net, voice), rows_of(ear.net, voice))
