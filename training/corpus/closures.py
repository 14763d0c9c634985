"""Lips that meet: where the sound says p, b or m, and whether they do."""

import numpy as np
import torch
from torch.nn.functional import max_pool1d

from training.corpus.action_units import runs
from training.corpus.clip import MEL_PER_FRAME
from training.corpus.phones import BILABIALS

INNER_UPPER, INNER_LOWER = (61, 62, 63), (67, 66, 65)
OUTER_UPPER, OUTER_LOWER = (49, 50, 51, 52, 53), (59, 58, 57, 56, 55)
OUTER_SHARES = (0.4, 0.8, 1.0, 0.8, 0.4)
UPPER_SHARE = 0.35
"""Part of a closing motion that the upper lip makes."""
MET_SHARE = 0.15
SURE_FROM, SURE_AT = 0.2, 0.35
PEAK_FRAMES, PEAK_SHARE = 2, 0.75
"""Frames to either side among which a probability has to come near the highest, and how near."""
TOUCHING_M = -0.5e-3
"""Opening over that of the neutral face at which lips touch in speech."""
BEFORE_FRAMES = 2


def inner_gaps(motion: np.ndarray, neutral: np.ndarray) -> np.ndarray:
    """Opening of the three inner lip pairs, [T, 3] metres."""
    height = motion[..., 1] + neutral[:, 1]
    return height[:, list(INNER_UPPER)] - height[:, list(INNER_LOWER)]


def inner_depths(motion: np.ndarray) -> np.ndarray:
    """How far the upper lip is before the lower one at the inner pairs, [T, 3] of the motion's unit."""
    return motion[:, list(INNER_UPPER), 2] - motion[:, list(INNER_LOWER), 2]


def narrowed(motion: np.ndarray, height: np.ndarray, depth: np.ndarray) -> np.ndarray:
    """Brings upper and lower lip together by [T, 3] metres at the inner pairs; corners stay."""
    out = motion.copy()
    spread = np.array([[1, 1, 0, 0, 0], [0, 0, 1, 0, 0], [0, 0, 0, 1, 1]]) * np.array(OUTER_SHARES)
    for axis, by in ((1, height), (2, depth)):
        outer = by @ spread.astype(by.dtype)
        for upper, lower, amount in ((INNER_UPPER, INNER_LOWER, by), (OUTER_UPPER, OUTER_LOWER, outer)):
            out[:, list(upper), axis] -= UPPER_SHARE * amount
            out[:, list(lower), axis] += (1.0 - UPPER_SHARE) * amount
    return out


def lips_closed(motion: torch.Tensor, probability: torch.Tensor) -> torch.Tensor:
    """Motion [T, 204] whose lips touch where `probability` [T] says p, b or m.

    Twin of `closures.rs` in `rust-core/src/speech` and `rust-core/src/motion`. Where the probability is
    three quarters of the highest within two frames, a smooth step from 0.2 to 0.35 decides how far the gap of
    each inner lip pair goes to where lips touch, and how far one lip comes forward to the other; it never
    widens.
    """
    highest = max_pool1d(probability[None], 2 * PEAK_FRAMES + 1, 1, PEAK_FRAMES)[0]
    probability = torch.where(probability >= PEAK_SHARE * highest, probability, 0.0)
    share = ((probability - SURE_FROM) / (SURE_AT - SURE_FROM)).clamp(0, 1)
    share = share * share * (3 - 2 * share)
    points = motion.unflatten(-1, (68, 3)).numpy()
    gaps = inner_gaps(points, np.zeros((68, 3), points.dtype))
    share = share.numpy()[:, None]
    closed = narrowed(points, share * np.maximum(gaps - TOUCHING_M, 0.0), share * inner_depths(points))
    return torch.from_numpy(closed).flatten(1)


def closures_met(opening: torch.Tensor, phones: torch.Tensor) -> list[bool]:
    """For each p, b, m: do the lips come within 15 % of the clip's 95 % quantile?

    `opening` [T] of the inner lips, `phones` [4 T] segments at mel rate.
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
