"""Facts about synthesised emotion; those with a face need ../shared."""

from itertools import combinations

import numpy as np
import pytest
import torch

from training.corpus.emotions import PROTOTYPES, EmotionSynthesiser, uncrossed
from training.corpus.manner import MANNERS, articulate, episode, follow
from training.losses import lip_gap
from training.systems.freetalk.ats import EMOTIONS
from training.tests.test_parity import SHARED, needs_shared


@pytest.fixture(scope="module")
def emotions() -> EmotionSynthesiser:
    """Seed 0."""
    return EmotionSynthesiser(SHARED / "data", 0)


def affect(emotion: str, intensity: float, frames: int = 60) -> torch.Tensor:
    """One emotion throughout, [1, T, 16]."""
    rows = torch.zeros(1, frames, 16)
    rows[..., EMOTIONS.index(emotion)], rows[..., 15] = 1.0, intensity
    return rows


def talking(frames: int = 60) -> torch.Tensor:
    """A jaw that opens 8 mm, swings, and closes at frames 29 … 31: [1, T, 204]."""
    motion = torch.zeros(1, frames, 68, 3)
    down = 6e-3 + 2e-3 * torch.sin(torch.arange(frames) * 0.7)
    down[29:32] = 0.0
    motion[..., [65, 66, 67], 1] = -down[:, None]
    motion[..., 5:12, 1] = -down[:, None]
    return motion.flatten(2)


def test_every_emotion_has_a_prototype_and_a_manner():
    assert set(PROTOTYPES) == set(MANNERS) == set(EMOTIONS)


def test_a_step_comes_within_its_onset_and_goes_slower():
    strength = np.zeros((1, 100, 15), np.float32)
    strength[:, 20:60, :] = 1.0
    face = follow(strength)[0]
    for k, emotion in enumerate(EMOTIONS):
        rise = int(np.argmax(face[20:, k] > 0.75))
        fall = int(np.argmax(face[60:, k] < 0.25))
        assert 4 <= rise <= 11, emotion
        assert fall > rise, emotion
    assert np.abs(follow(np.ones((1, 30, 15), np.float32)) - 1.0).max() < 1e-6


def test_an_episode_rises_faster_than_it_falls():
    random = np.random.default_rng(0)
    for _ in range(20):
        curve = episode(400, 1.2, random)
        assert 0 <= curve.min() and curve.max() <= 1.2
        change = np.diff(curve)
        if curve[-1] == 0:
            assert 4 <= (change > 0).sum() <= 11 <= (change < 0).sum() + 1 <= 22


def test_anger_speaks_larger_and_sadness_smaller_with_closures_kept():
    motion, free = talking(), torch.ones(1, 60)
    free[:, 28:33] = 0.0
    for emotion, larger in (("angry", True), ("sad", False), ("drunk", False)):
        spoken = articulate(motion, affect(emotion, 1.0)[..., :15], free)
        ratio = float(lip_gap(spoken)[0, 40:].mean() / lip_gap(motion)[0, 40:].mean())
        assert (ratio > 1.15) == larger and (ratio < 0.9) != larger
        assert lip_gap(spoken)[0, 30].abs() < 1e-6


def test_slurred_speech_swings_less():
    motion, free = talking(), torch.ones(1, 60)
    drunk = articulate(motion, affect("drunk", 1.0)[..., :15], free)
    assert lip_gap(drunk)[0, 40:].std() < 0.6 * lip_gap(motion)[0, 40:].std()


def test_crossed_lips_are_parted():
    spoken = torch.zeros(1, 1, 204)
    felt = spoken.clone()
    felt[..., 3 * 66 + 1] = 3e-3
    assert lip_gap(uncrossed(felt, spoken)).item() == pytest.approx(-5e-4, abs=1e-6)


@needs_shared
def test_any_two_emotions_differ_on_the_landmarks(emotions):
    faces = (emotions.lasting + emotions.opening).unflatten(1, (68, 3)).numpy() * 1e3
    for a, b in combinations(range(15), 2):
        apart = np.linalg.norm(faces[a] - faces[b], axis=1)
        assert apart.max() > 2.0, (EMOTIONS[a], EMOTIONS[b])
        assert np.sqrt((apart**2).mean()) > 0.8, (EMOTIONS[a], EMOTIONS[b])


@needs_shared
def test_more_intensity_moves_an_emotions_own_landmarks_further(emotions):
    motion = talking()
    for k, emotion in enumerate(EMOTIONS[1:], start=1):
        reach = emotions.lasting[k].unflatten(0, (68, 3)).norm(dim=1)
        own = reach > 0.5 * reach.max()
        moved = []
        for intensity in np.linspace(0, 1.5, 7):
            felt = emotions.apply(motion, affect(emotion, float(intensity)))
            moved.append(float((felt - motion).unflatten(2, (68, 3))[0, 45, own].norm(dim=1).mean()))
        assert moved[0] == 0.0 and (np.diff(moved) > 1e-4).all(), (emotion, moved)


@needs_shared
def test_lips_stay_closed_for_plosives_in_every_emotion(emotions):
    motion = talking()
    for emotion in EMOTIONS[1:]:
        gap = lip_gap(emotions.apply(motion, affect(emotion, 1.0)))[0]
        assert gap[30] < 0.25 * gap[40:].quantile(0.95), emotion
        assert gap.min() > -0.6e-3, emotion
