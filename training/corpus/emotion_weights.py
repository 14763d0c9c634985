"""Emotions as ARKit weights: the tables that move FreeTalk's landmarks, expressed in channels."""

from functools import lru_cache

import torch
from torch import Tensor

from training.corpus.conditions import EMOTIONS
from training.corpus.emotions import AU_TO_ARKIT, OPENING, PROTOTYPES, channel_of
from training.corpus.faces import CHANNELS
from training.corpus.manner import MANNERS

HIGHEST = 1.5
MOUTH = [i for i, c in enumerate(CHANNELS) if c.startswith(("jaw", "mouth"))]
ROUND = [i for i, c in enumerate(CHANNELS) if c.startswith(("mouthPucker", "mouthFunnel"))]


@lru_cache(maxsize=1)
def table() -> tuple[Tensor, Tensor]:
    """Weights of each emotion at intensity 1, [15, 51] each: the lasting part, and the part that yields to
    closures."""
    parts = torch.zeros(2, len(EMOTIONS), len(CHANNELS))
    for row, emotion in enumerate(EMOTIONS):
        for unit, strength in PROTOTYPES[emotion].items():
            for shape in AU_TO_ARKIT[unit]:
                yields = unit in OPENING and shape.startswith(("jaw", "mouth"))
                parts[int(yields), row, channel_of(shape)] += strength
    return parts[0], parts[1]


@lru_cache(maxsize=1)
def factors() -> Tensor:
    """The factor by which each emotion scales each channel of speech at intensity 1, [15, 51]."""
    out = torch.ones(len(EMOTIONS), len(CHANNELS))
    for row, emotion in enumerate(EMOTIONS):
        manner = MANNERS[emotion]
        out[row, MOUTH] = manner.opening
        out[row, ROUND] = manner.rounding
    return out


def with_emotion(weights: Tensor, emotion: Tensor, intensity: Tensor, closed: Tensor) -> Tensor:
    """Adds an emotion to speech weights [T, 51].

    `emotion` [T, 15] is a mixture, `intensity` [T], `closed` [T] rises from 0 to 1 where the lips meet.
    """
    lasting, yielding = table()
    strength = emotion * intensity[:, None]
    spoken = weights * (1.0 + strength @ (factors() - 1.0))
    added = strength @ lasting + (1.0 - closed)[:, None] * (strength @ yielding)
    return (spoken + added).clamp(0.0, HIGHEST)
