"""Action units on ARKit's channels, and the events for training fine control.

The table maps the Facial Action Coding System (Ekman & Friesen 1978) to ARKit's names. Algorithm 1 of
Cafe-Talk (Chen et al. 2025, appendix C.2) determines the units that are active in a clip. Speech shows few of
them, so others are added at random, as an animator would ask for them.
"""

from dataclasses import dataclass

import numpy as np
import torch
import torch.nn.functional as F
from torch import Tensor

from training.corpus.clip import FPS
from training.corpus.conditions import SIDES, UNITS
from training.corpus.faces import CHANNELS

STEMS = {
    "1": ["browInnerUp"],
    "2": ["browOuterUp"],
    "4": ["browDown"],
    "5": ["eyeWide"],
    "6": ["cheekSquint"],
    "7": ["eyeSquint"],
    "9": ["noseSneer"],
    "10": ["mouthUpperUp"],
    "12": ["mouthSmile"],
    "14": ["mouthDimple"],
    "15": ["mouthFrown"],
    "16": ["mouthLowerDown"],
    "17": ["mouthShrugLower"],
    "20": ["mouthStretch"],
    "23": ["mouthPress"],
    "26": ["jawOpen"],
    "28": ["mouthRollLower", "mouthRollUpper"],
    "45": ["eyeBlink"],
}
LOWER = {"9", "10", "12", "14", "15", "17", "20", "26", "28"}
THRESHOLD = (0.15, 0.35)
LONGEST_POOL_FRAMES = 9
MERGED_REACH_FRAMES = 4
DROPPED_EVENTS, DROPPED_UNITS = 0.8, 0.3
ONSET_S, HOLD_S, OFFSET_S = (0.1, 0.4), (0.0, 1.5), (0.2, 0.8)
STRENGTH = (0.6, 1.0)
BOTH_SIDES, PAIRED = 0.6, 0.35
SLOT_SHARE = 0.2
"""An added event counts as active in frames where it exceeds this share of its strength."""


def channels(unit: str, side: int) -> list[int]:
    """Indices of a unit's channels on the left (0) or the right (1). A channel without sides is on both."""
    ending = ("Left", "Right")[side]
    names = [c for stem in STEMS[unit] for c in (f"{stem}{ending}", stem) if c in CHANNELS]
    return [CHANNELS.index(c) for c in names]


def unit_matrix() -> Tensor:
    """Which channels belong to which unit, [32, 51] of 0 and 1; all units on the left, then on the right."""
    matrix = torch.zeros(SIDES * len(UNITS), len(CHANNELS))
    for side in range(SIDES):
        for row, unit in enumerate(UNITS):
            matrix[side * len(UNITS) + row, channels(unit, side)] = 1.0
    return matrix


def unit_strengths(weights: Tensor) -> Tensor:
    """How strongly each unit shows in weights [T, 51]: the mean of its channels, [T, 32]."""
    matrix = unit_matrix()
    return weights @ (matrix / matrix.sum(dim=1, keepdim=True)).T


def active_units(weights: Tensor, random: np.random.Generator) -> Tensor:
    """Algorithm 1: binarised weights, max-pooled and merged at random, [T, 32] of 0 and 1."""
    active = (unit_strengths(weights) > random.uniform(*THRESHOLD)).float()
    pool = 2 * int(random.integers(0, LONGEST_POOL_FRAMES // 2 + 1)) + 1
    active = F.max_pool1d(active.T[None], pool, 1, pool // 2)[0].T
    return merged(active, int(random.integers(0, MERGED_REACH_FRAMES + 1)))


def merged(active: Tensor, reach: int) -> Tensor:
    """Joins runs with at most `2 reach` frames between them (a morphological closing), [T, 32]."""
    if reach == 0:
        return active
    width = 2 * reach + 1
    grown = F.max_pool1d(active.T[None], width, 1, reach)
    shrunk = -F.max_pool1d(-F.pad(grown, (reach, reach), value=1.0), width, 1)
    return torch.maximum(active, shrunk[0].T)


def sparse(active: Tensor, random: np.random.Generator) -> Tensor:
    """Thins the units out as an animator would: drops 80 % of the runs, then 30 % of the rest (§3.2)."""
    events = torch.zeros_like(active)
    for unit in range(active.shape[1]):
        for first, last in runs(active[:, unit]):
            if random.random() > DROPPED_EVENTS and random.random() > DROPPED_UNITS:
                events[first:last, unit] = 1.0
    return events


def runs(active: Tensor) -> list[tuple[int, int]]:
    """First frame of every run of ones in [T], and the frame after its last."""
    edges = torch.diff(active, prepend=torch.zeros(1), append=torch.zeros(1))
    starts, ends = (torch.nonzero(edges == sign).flatten().tolist() for sign in (1, -1))
    return list(zip(starts, ends, strict=True))


@dataclass
class Added:
    """Events to put on a clip: what they add to the weights [T, 51], and where units are active [T, 32]."""

    weights: Tensor
    active: Tensor


def random_events(frames: int, closed: Tensor, random: np.random.Generator) -> Added:
    """One or two events. Units of the lower face yield where `closed` [T] says that the lips meet."""
    matrix = unit_matrix()
    added, active = torch.zeros(frames, len(CHANNELS)), torch.zeros(frames, len(matrix))
    for _ in range(1 + int(random.random() < 0.5)):
        rows = _units(random)
        curve = envelope(frames, random)
        strength = float(random.uniform(*STRENGTH))
        shown = matrix[rows].amax(dim=0)
        free = 1.0 - closed[:, None] * lower_channels()
        added = torch.maximum(added, strength * curve[:, None] * free * shown)
        active[:, rows] = torch.maximum(active[:, rows], (curve > SLOT_SHARE).float()[:, None])
    return Added(added, active)


def lower_channels() -> Tensor:
    """1 for the channels of lower units, [51]."""
    matrix = unit_matrix()
    rows = [
        side * len(UNITS) + row for side in range(SIDES) for row, unit in enumerate(UNITS) if unit in LOWER
    ]
    return matrix[rows].amax(dim=0)


def _units(random: np.random.Generator) -> list[int]:
    chosen = random.choice(len(UNITS), size=1 + int(random.random() < PAIRED), replace=False)
    sides = (0, 1) if random.random() < BOTH_SIDES else (int(random.integers(0, SIDES)),)
    return [side * len(UNITS) + int(u) for u in chosen for side in _sides(UNITS[u], sides)]


def _sides(unit: str, sides: tuple[int, ...]) -> tuple[int, ...]:
    """The sides of a unit; a unit whose channel has no sides is on both."""
    return (0, 1) if channels(unit, 0) == channels(unit, 1) else sides


def envelope(frames: int, random: np.random.Generator) -> Tensor:
    """A smooth rise, hold and fall somewhere in the window, [T] from 0 to 1."""
    onset, hold, offset = (random.uniform(*span) * FPS for span in (ONSET_S, HOLD_S, OFFSET_S))
    start = random.uniform(-0.5 * onset, max(frames - onset - 0.5 * hold, 1.0))
    time = torch.arange(frames) - start
    rise, fall = (time / onset).clamp(0, 1), ((onset + hold + offset - time) / offset).clamp(0, 1)
    x = torch.minimum(rise, fall)
    return x * x * (3.0 - 2.0 * x)
