"""The ear for emotion: what it hears, how it learns, and that the recording's source says nothing."""

from functools import partial
from pathlib import Path

import numpy as np
import soundfile
import torch

from training import shipped
from training.corpus.emodb import SOURCE
from training.nn.checkpoint import write_model
from training.speech.distil_emotion import cut, directions, moved, pooled
from training.speech.emotion_ear import (
    ARRAYS,
    HALF_BELIEVED,
    EmotionEarConfig,
    EmotionEarNet,
    inputs_of,
    neutral_offset,
    neutral_voice,
    read_ear,
    read_layer,
    rows_of,
)
from training.speech.neutral_voice import RECORDINGS, recordings, shown_of
from training.speech.train_emotion_ear import Rows, fitted
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


def rows_of_strangers(random: np.random.Generator) -> Rows:
    """Actors of one kind of recording who feel along axes 0 to 6, readers of another that axis 9 tells."""
    rows = object.__new__(Rows)
    size, count = SMALL.told + NUMBERS, 140
    label = np.arange(count) % len(HEARD_EMOTIONS)
    actors = 0.5 * random.standard_normal((count, size))
    actors[np.arange(count), label] += 4.0
    actors[:, 9] += 6.0
    readers = 0.5 * random.standard_normal((60, size))
    readers[:, 0] += 4.0
    rows.x = np.concatenate([actors, readers])
    rows.label = np.concatenate([label, np.zeros(60, int)])
    rows.source = np.array([SOURCE] * count + ["picovoice_en"] * 60)
    rows.speaker = np.array([f"{k % 4}" for k in range(count)] + ["reader"] * 60)
    rows.held_out = np.zeros(len(rows.x), bool)
    rows.actor_rows, rows.readers = np.arange(count), np.arange(count, count + 60)
    return rows


def test_an_emotion_is_known_in_another_kind_of_recording():
    random = np.random.default_rng(0)
    rows = rows_of_strangers(random)
    ear = fitted(rows, rows.actor_rows)
    stranger = 0.5 * random.standard_normal((70, rows.x.shape[1]))
    label = np.arange(70) % len(HEARD_EMOTIONS)
    stranger[np.arange(70), label] += 4.0
    assert (ear.logits(stranger).argmax(axis=1) == label).mean() > 0.9


def test_a_neutral_voice_is_moved_to_that_of_readers_the_more_of_it_there_is():
    random = np.random.default_rng(0)
    rows, readers = random.standard_normal((5, 9)) + 3.0, np.zeros(9)
    weight = np.array([1.0, 1.0, 0.0, 1.0, 1.0])
    offset = neutral_offset(rows, weight, readers)
    assert np.allclose(offset, -rows[weight > 0].mean(axis=0) * 4.0 / (4.0 + HALF_BELIEVED))
    much = neutral_offset(np.tile(rows, (50, 1)), np.tile(weight, 50), readers)
    assert (np.abs(much) > np.abs(offset)).all()
    voice = voice_of(made_voice())
    heard, share = neutral_voice(EmotionEarNet(SMALL).eval(), voice)
    assert heard.shape == (len(share), SMALL.told + NUMBERS) and len(share) == 4 + 3
    assert ((share >= 0.0) & (share <= 1.0)).all() and share.max() > 0.3


def test_an_ear_keeps_the_mean_voice_of_readers():
    rows = rows_of_strangers(np.random.default_rng(0))
    ear = fitted(rows, rows.actor_rows)
    assert np.allclose(ear.readers, rows.neutral_voices().mean(axis=0)) and "readers" in ear.arrays()


def test_an_ear_is_read_as_it_was_written(tmp_path: Path):
    torch.manual_seed(0)
    rows = rows_of_strangers(np.random.default_rng(0))
    layer, net = fitted(rows, rows.actor_rows), EmotionEarNet(SMALL).eval()
    arrays = {name: torch.from_numpy(x).float() for name, x in layer.arrays().items()}
    write_model(tmp_path, arrays | net.state_dict(), SMALL.to_json(), exact=("",))
    ear = read_ear(tmp_path)
    assert all(np.array_equal(x.numpy(), getattr(ear, name)) for name, x in arrays.items())
    assert all(np.array_equal(getattr(read_layer(tmp_path), name), getattr(ear, name)) for name in ARRAYS)
    voice = voice_of(made_voice())
    assert np.array_equal(rows_of(net, voice), rows_of(ear.net, voice))


def test_recordings_of_each_folder_are_counted(tmp_path: Path):
    for folder, _, _ in RECORDINGS:
        (tmp_path / folder).mkdir(parents=True, exist_ok=True)
        soundfile.write(tmp_path / folder / "one.wav", made_voice(), 16000)
    ear = read_ear(shipped("emotion_ear"))
    lines = list(recordings(tmp_path, partial(shown_of, ear)))
    assert len(lines) == len(RECORDINGS) and all(" of 1 are shown" in line for line in lines)
    always = list(recordings(tmp_path, lambda samples: (0.5, 1)))
    assert always[0] == "motion/grid_s1/audio: 1 of 1 are shown one as angry 0.50"
