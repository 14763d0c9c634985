"""The judge of emotions finds what was added to speech, also on clips that it was not taught on."""

import numpy as np
import pytest
import torch

from training.corpus.bank import Entry
from training.corpus.conditions import EMOTIONS
from training.corpus.faces import CHANNELS
from training.systems.cafe_talk import judge as judging

CLEAR = [EMOTIONS.index(e) for e in ("neutral", "happy", "surprised", "angry")]


def clip(seed: int, frames: int = 80) -> Entry:
    """A mouth that opens and closes, [T, 51] as motion."""
    random = torch.Generator().manual_seed(seed)
    speed = 0.3 + torch.rand(1, generator=random)
    motion = torch.zeros(frames, len(CHANNELS))
    motion[:, CHANNELS.index("jawOpen")] = 0.3 * (torch.arange(frames) * speed).sin().abs()
    return Entry(str(seed), "s", False, torch.zeros(1), motion, motion, torch.zeros(1))


@pytest.mark.slow
def test_it_finds_emotions_of_clips_that_it_has_not_seen():
    judge = judging.taught([clip(seed) for seed in range(6)], 200)
    other = clip(99).motion
    verdicts = judging.judged(judge, lambda _, emotion: judging.under_emotion(other, emotion, 1.0), 1)
    assert verdicts.features.shape == (len(EMOTIONS), judging.WIDTH)
    assert [int(verdicts.read_emotions[e]) for e in CLEAR] == CLEAR
    assert verdicts.scores()["Acc"] > 0.6
    reads = [
        judging.judged(judge, lambda _, e, i=i: judging.under_emotion(other, e, i), 1).scores()["read"]
        for i in (0.0, 0.5, 1.0, 1.5)
    ]
    assert all(less + 0.1 < more for less, more in zip(reads, reads[1:], strict=False)), reads
    still = judging.judged(judge, lambda *_: other, 1)
    assert still.scores()["Acc"] == pytest.approx(1 / len(EMOTIONS)) and still.scores()["Div"] < 1e-6


def test_short_clips_teach_nothing():
    with pytest.raises(ValueError, match="expected clips of 50 frames or more, got none in 1"):
        judging.taught([clip(0, 20)], 1)


def test_accuracy_counts_against_the_label_or_against_one_emotion():
    true_emotions, read_emotions = torch.tensor([0, 1, 2, 3]).numpy(), torch.tensor([0, 0, 2, 0]).numpy()
    verdicts = judging.Verdicts(true_emotions, read_emotions, torch.eye(4), np.ones(4))
    assert verdicts.scores()["Acc"] == 0.5
    assert verdicts.scores(true_emotions != 0)["Acc"] == pytest.approx(1 / 3)
    assert verdicts.scores(true_emotions != 0, 0)["Acc"] == pytest.approx(2 / 3)
