"""Expressions for training and evaluation: channel weights of real speech, of the upper face, and random.

Shapes: `T` frames, `M` = 51 channels in the order of `faces.CHANNELS`.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from training.corpus.facegood import arkit_takes, channel_rows
from training.corpus.faces import CHANNELS

HELD_OUT_TAKE = "1114_3_15"
"""The take of facegood_zh that is held out for the evaluation."""

UPPER = [i for i, c in enumerate(CHANNELS) if c.startswith(("brow", "eye", "cheekS", "nose"))]


@dataclass(frozen=True)
class SpeechWeights:
    """Mouth and jaw weights of real speech. train, test: [T, M]."""

    train: np.ndarray
    test: np.ndarray


def load_speech(data: Path) -> SpeechWeights:
    """Loads the ARKit conversion of facegood_zh and drops frames at rest."""
    takes = {}
    for name, columns in arkit_takes(data, np.float64):
        weights = channel_rows(columns)
        takes[name] = weights[weights.max(1) > 0.05]
    test = takes.pop(HELD_OUT_TAKE)
    return SpeechWeights(np.concatenate(list(takes.values())), test)


def upper_face(rng: np.random.Generator, frames: int) -> np.ndarray:
    """Brows, lids, eyes and nose at random, left and right mostly together. [T, M]."""
    weights = np.zeros((frames, len(CHANNELS)))
    active = rng.random((frames, len(UPPER))) < 0.2
    weights[:, UPPER] = 0.7 * active * rng.random((frames, len(UPPER)))
    for left in [i for i in UPPER if CHANNELS[i].endswith("Left")]:
        right = CHANNELS.index(CHANNELS[left].replace("Left", "Right"))
        both = rng.random(frames) < 0.8
        weights[both, right] = weights[both, left]
    return weights


def random_combinations(rng: np.random.Generator, frames: int) -> np.ndarray:
    """A few channels at once, at any strength. [T, M]."""
    active = rng.random((frames, len(CHANNELS))) < 0.08
    return active * rng.random((frames, len(CHANNELS)))


def training_frames(rng: np.random.Generator, speech: np.ndarray, frames: int) -> np.ndarray:
    """Frames [T, M]: three quarters speech (0.7 to 1.4 of its strength) and upper face, the rest random."""
    picked = speech[rng.integers(len(speech), size=frames)]
    picked = picked * rng.uniform(0.7, 1.4, (frames, 1)) + upper_face(rng, frames)
    combined = random_combinations(rng, frames)
    return np.where(rng.random((frames, 1)) < 0.75, picked, combined)


def evaluation_frames(rng: np.random.Generator, speech: np.ndarray, frames: int) -> np.ndarray:
    """Speech as recorded, with upper face. [T, M]."""
    picked = speech[rng.integers(len(speech), size=frames)]
    return picked + upper_face(rng, frames)
