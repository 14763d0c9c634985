"""Lip closures: where the sound has p, b or m, and whether the lips meet there."""

import numpy as np
import torch

from training.corpus.action_units import runs
from training.corpus.clip import MEL_PER_FRAME
from training.corpus.phones import BILABIALS

INNER_UPPER, INNER_LOWER = (61, 62, 63), (67, 66, 65)
OUTER_UPPER, OUTER_LOWER = (49, 50, 51, 52, 53), (59, 58, 57, 56, 55)
OUTER_SHARES = (0.4, 0.8, 1.0, 0.8, 0.4)
UPPER_SHARE = 0.35
"""The upper lip makes this share of a closing motion, the lower lip the rest."""
MET_SHARE = 0.15
BEFORE_FRAMES = 2


def inner_gaps(motion: np.ndarray, neutral: np.ndarray) -> np.ndarray:
    """Opening of the three inner lip pairs, [T, 3] metres."""
    height = motion[..., 1] + neutral[:, 1]
    return height[:, list(INNER_UPPER)] - height[:, list(INNER_LOWER)]


def inner_depths(motion: np.ndarray) -> np.ndarray:
    """How far the upper lip is in front of the lower one at the inner pairs, [T, 3], unit of the motion."""
    return motion[:, list(INNER_UPPER), 2] - motion[:, list(INNER_LOWER), 2]


def narrowed(motion: np.ndarray, height: np.ndarray, depth: np.ndarray) -> np.ndarray:
    """Brings upper and lower lip together by [T, 3] metres at the inner pairs. The corners do not move."""
    out = motion.copy()
    spread = np.array([[1, 1, 0, 0, 0], [0, 0, 1, 0, 0], [0, 0, 0, 1, 1]]) * np.array(OUTER_SHARES)
    for axis, by in ((1, height), (2, depth)):
        outer = by @ spread.astype(by.dtype)
        for upper, lower, amount in ((INNER_UPPER, INNER_LOWER, by), (OUTER_UPPER, OUTER_LOWER, outer)):
            out[:, list(upper), axis] -= UPPER_SHARE * amount
            out[:, list(lower), axis] += (1.0 - UPPER_SHARE) * amount
    return out


def closures_met(opening: torch.Tensor, phones: torch.Tensor) -> list[bool]:
    """For each p, b and m: whether the opening falls below 15 % of the clip's 95 % quantile.

    `opening` [T] is that of the inner lips, `phones` [4 T] are segments at mel rate.
    """
    bound = MET_SHARE * opening.quantile(0.95)
    return [bool(opening[a:b].min() < bound) for a, b in bilabial_frames(phones)]


def bilabial_frames(phones: torch.Tensor) -> list[tuple[int, int]]:
    """Motion frames [first, last) around each run of p, b or m in a track at mel rate [4 T]."""
    inside = torch.isin(phones.long(), torch.tensor(BILABIALS)).int()
    spans = []
    for a, b in runs(inside):
        last = min(b // MEL_PER_FRAME + 1, len(phones) // MEL_PER_FRAME)
        first = max(a // MEL_PER_FRAME - BEFORE_FRAMES, 0)
        if first < last:
            spans.append((first, last))
    return spans
