"""Facts about the ear's body and the scores of motion, on made-up features."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from training.corpus.ear import LAYERS, MOTION, SILENT_SOUNDS, EarClip, silence, timed
from training.corpus.phones import SEGMENTS, Phone
from training.losses import lip_gap
from training.speech import strangers
from training.speech.ear import EarBody, debug_config, ear_mel
from training.speech.train_ear import EarSampler, EarToMotion, phones_right

WIDTH = 8


def clip(name: str, source: str, frames: int, seed: int, voices: int = 2) -> EarClip:
    """Features and a mouth that opens with the first of them; p in its middle, silence around it."""
    random = torch.Generator().manual_seed(seed)
    heard = torch.randn(voices, len(LAYERS), 2 * frames, WIDTH, generator=random)
    motion = torch.zeros(frames, MOTION)
    motion[:, 3 * 66 + 1] = -5e-3 - 2e-3 * heard[0, 0, ::2, 0]
    motion[:, 3 * 62 + 1] = 5e-3
    phones = torch.zeros(4 * frames, dtype=torch.int16)
    phones[2 * frames : 2 * frames + 12] = SEGMENTS.index("p")
    mels = torch.randn(1, 4 * frames, 64, generator=random).half() - 5.0
    return EarClip(
        name, source, False, mels, motion, torch.ones_like(motion), phones, heard=heard.half()
    )  # fmt: skip


def test_windows_of_features_fit_those_of_motion():
    clips = [clip("a", "grid_s1", 30, 0), clip("b", "grid_s1", 50, 1), clip("c", "espeak_de", 40, 2)]
    batch = EarSampler(clips, {"grid_s1": 0.7, "taught": 0.3}, 0).batch(6, 40)
    assert batch.heard.shape == (6, len(LAYERS), 80, WIDTH) and batch.phones.shape == (6, 160)
    opening = 10e-3 + 2e-3 * batch.heard[:, 0, ::2, 0].float()
    is_own = (lip_gap(batch.motion) - opening).abs().amax(dim=1) < 1e-4
    assert is_own.any() and not is_own.all(), "re-voiced copies have features of their own"


def test_loud_and_quiet_copies_of_a_sound_are_one_to_the_ear():
    time = torch.arange(16000) / 16000
    voice = 0.3 * torch.sin(2 * torch.pi * 150 * time) * torch.sin(2 * torch.pi * 3 * time).abs()
    loud, quiet = ear_mel(voice), ear_mel(0.05 * voice)
    torch.testing.assert_close(quiet, loud, atol=1e-3, rtol=0)
    assert ear_mel(1e-4 * voice).max() < loud.max() - 0.2, "near-silence stays silent"


def test_silence_holds_no_speech_and_a_face_at_rest():
    sounds = silence(np.random.default_rng(0))
    assert len(sounds) == SILENT_SOUNDS and np.abs(sounds[0].samples).max() == 0.0
    assert all([p.label for p in u.phones] == ["_"] and np.isfinite(u.samples).all() for u in sounds)


def test_a_body_gives_one_row_for_two_of_whisper():
    body = EarBody(debug_config()).eval()
    heard = torch.randn(3, 2, 26, 16)
    features = body(heard)
    assert features.shape == (3, 13, 16)
    heard[:, :, 20:] += 1e6
    assert torch.isfinite(body(heard)).all()


def test_a_track_of_segments_comes_back_as_phones():
    phones = timed(torch.tensor([0] * 10 + [5] * 20 + [3] * 7))
    assert [(round(p.start_s, 2), round(p.duration_s, 2)) for p in phones] == [
        (0, 0.1),
        (0.1, 0.2),
        (0.3, 0.07),
    ]
    assert [p.label for p in phones] == [SEGMENTS[0], SEGMENTS[5], SEGMENTS[3]]


def test_phones_are_judged_outside_pauses():
    model = EarToMotion(replace(debug_config(), width=WIDTH)).eval()
    with torch.no_grad():
        model.phones.readout.bias[SEGMENTS.index("p")] = 1e3
    right = phones_right(model, clip("a", "espeak_de", 40, 6))
    assert len(right) == 3 and (right == 1).all()


def test_scores_take_loudness_out():
    entry = clip("a", "grid_s1", 200, 7, voices=1)
    louder = torch.from_numpy(np.sin(np.arange(200) / 9.0)).float()
    entry.mels = (entry.mels.float() * 0.0 - 6.0 + louder.repeat_interleave(4)[None, :, None]).half()
    entry.motion[:, 3 * 66 + 1] -= 4e-3 * louder
    by_loudness = torch.zeros(200, MOTION)
    by_loudness[:, 3 * 62 + 1] = 1e-3 * louder
    perfect, loud = (strangers.scores([(motion, entry)]) for motion in (entry.motion, by_loudness))
    assert min(perfect["gap r"], perfect["gap speech"], perfect["gap beyond"]) > 0.999
    assert abs(perfect["gap slope"] - 1.0) < 1e-5
    assert loud["gap r"] > 0.7 and abs(loud["gap beyond"]) < 0.2


def test_closures_are_met_or_false_where_they_stand():
    fps, motion = 50.0, np.zeros((100, 68, 3))
    motion[:, 61:64, 1] = 5e-3
    labels = ["_", "a", "p", "a", "b", "a", "_"]
    starts = [0.0, 0.2, 0.5, 0.6, 0.9, 1.0, 1.8]
    said = [Phone(s, e - s, x) for s, e, x in zip(starts, [*starts[1:], 2.0], labels, strict=True)]
    for second in (0.06, 0.5, 1.4):
        motion[int(second * fps), 61:64, 1] = 0.0
    counted = strangers.count_closures(motion, fps, said)
    assert (counted.said, counted.met, counted.false) == (2, 1, 1)
    assert counted.seconds == pytest.approx(1.4, abs=0.05)
    said[5] = Phone(said[5].start_s, said[5].duration_s, "β")
    assert strangers.count_closures(motion, fps, said).false == 0, "both lips come near in β"
    said[5] = Phone(said[5].start_s, said[5].duration_s, "a")
    motion[45, 61:63, 1] = 0.0
    assert strangers.count_closures(motion, fps, said).met == 1, "all three pairs have to meet"
    motion[45, 63, 1] = 0.4e-3
    assert (counted + strangers.count_closures(motion, fps, said)).met == 3


def test_within_speech_pauses_do_not_count():
    time = torch.arange(200)
    level = torch.where(time < 100, -1.0, -12.0)
    true = torch.where(time < 100, torch.sin(time / 5.0), torch.full((200,), -8.0))
    other = torch.where(time < 100, torch.cos(time / 5.0), torch.full((200,), -8.0))
    right = strangers.feature_scores([(true, true, level)])
    wrong = strangers.feature_scores([(other, true, level)])
    assert right["speech"] == pytest.approx(1.0, abs=1e-5) and right["slope"] == pytest.approx(1.0)
    assert wrong["r"] > 0.9 and abs(wrong["speech"]) < 0.1


def test_a_line_over_loudness_tells_nothing_beyond_loudness():
    level = torch.sin(torch.arange(200) / 7.0)
    true = level + 0.5 * torch.sin(torch.arange(200) / 2.0)
    scores = strangers.feature_scores([(3.0 * level - 1.0, true, level)])
    assert scores["r"] > 0.8 and scores["beyond"] == 0.0
    assert strangers.feature_scores([(torch.ones(200), true, level)])["r"] == 0.0
