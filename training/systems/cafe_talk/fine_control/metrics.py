"""Measures whether the face follows events, whether it does so only in their slots, and the cost to speech.

Twins of the Rust crate's `metrics::control_rate` and `tests/eval`'s section on events. A slot is a pair: its
first frame and the frame after its last. A value that cannot be measured is NaN.
"""

import math

import torch
from torch import Tensor

from training.corpus import arkit
from training.corpus.action_units import channels
from training.corpus.closures import bilabial_frames
from training.corpus.conditions import SIDES
from training.losses import lip_gap
from training.systems.cafe_talk.train import lips_met

NEIGHBOURS = 5
"""A slot is compared with this many frames on either side (Cafe-Talk §4.2.1: 0.2 s at 25 fps)."""
FAR_FRAMES = 10
MET_SHARE = 0.5
"""Lips count as closed from this value of `lips_met` on."""
Slot = tuple[int, int]


def unit_values(weights: Tensor, unit: str) -> Tensor:
    """`B_k` of eq. 7: mean of a unit's channels on both sides, weights [T, 51] → [T]."""
    indices = sorted({c for side in range(SIDES) for c in channels(unit, side)})
    return weights[:, indices].mean(dim=1)


def control_rate(values: Tensor, slot: Slot) -> float:
    """Eq. 7: the maximum of `values` [T] in the slot minus the mean of the five frames on either side."""
    inside, beside = _parts(values, slot)
    return float(inside.max() - beside.mean()) if len(inside) and len(beside) else math.nan


def leak(with_event: Tensor, without: Tensor, slot: Slot) -> float:
    """Mean change of values [T] in the five frames on either side, as a share of that in the slot."""
    inside, beside = _parts((with_event - without).abs(), slot)
    if not len(inside) or not len(beside) or inside.mean() <= 0.0:
        return math.nan
    return float(beside.mean() / inside.mean())


def far_change(with_event: Tensor, without: Tensor, slot: Slot) -> float:
    """Largest change of any weight [T, 51] more than ten frames away from the slot."""
    frames = torch.arange(len(without))
    beyond = (frames + FAR_FRAMES < slot[0]) | (frames >= slot[1] + FAR_FRAMES)
    return float((with_event - without)[beyond].abs().max()) if beyond.any() else math.nan


def gap_mm(weights: Tensor) -> Tensor:
    """Opening of the lips beyond that of the neutral face, [T, 51] → [T] millimetres on ICT's landmarks."""
    return 1e3 * lip_gap(arkit.landmarks_of(weights))


def gap_r(predicted: Tensor, true: Tensor) -> float:
    """Pearson r of the lip gap of two takes [T, 51]."""
    return float(torch.corrcoef(torch.stack([gap_mm(predicted), gap_mm(true)]))[0, 1])


def gap_slope(predicted: Tensor, true: Tensor) -> float:
    """Slope of the predicted lip gap over the true one, both [T, 51]."""
    p, t = (x - x.mean() for x in (gap_mm(predicted), gap_mm(true)))
    return float((p * t).mean() / t.square().mean())


def closures(weights: Tensor, phones: Tensor, slot: Slot) -> tuple[int, int]:
    """How many p, b and m lie within a slot, and at how many of them the lips meet.

    `weights` [T, 51]; `phones` [4 T], segments at the rate of the log-mels.
    """
    spans = [(a, b) for a, b in bilabial_frames(phones) if a >= slot[0] and b <= min(slot[1], len(weights))]
    met = lips_met(weights)
    return len(spans), sum(bool(met[a:b].max() >= MET_SHARE) for a, b in spans)


def amplitude_mm(weights: Tensor, slot: Slot, inside: bool) -> float:
    """Standard deviation of the lip gap within a slot, or everywhere else, in millimetres."""
    gap, within = gap_mm(weights), torch.zeros(len(weights), dtype=torch.bool)
    within[slot[0] : slot[1]] = True
    return float(gap[within if inside else ~within].std())


def _parts(values: Tensor, slot: Slot) -> tuple[Tensor, Tensor]:
    """Values in the slot, and in those of the five frames on either side that the clip has."""
    first, last = slot
    before = values[max(first - NEIGHBOURS, 0) : max(first, 0)]
    return values[first:last], torch.cat([before, values[last : last + NEIGHBOURS]])
