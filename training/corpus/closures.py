"""Lip closures: where the sound has p, b or m, and whether the lips meet there."""

from dataclasses import dataclass

import numpy as np
import torch
from numpy.lib.stride_tricks import sliding_window_view

from training.corpus.action_units import runs
from training.corpus.clip import FPS, MEL_PER_FRAME
from training.corpus.phones import BILABIALS

INNER_UPPER, INNER_LOWER = (61, 62, 63), (67, 66, 65)
OUTER_UPPER, OUTER_LOWER = (49, 50, 51, 52, 53), (59, 58, 57, 56, 55)
OUTER_SHARES = (0.4, 0.8, 1.0, 0.8, 0.4)
UPPER_SHARE = 0.35
"""The upper lip makes this share of a closing motion, the lower lip the rest."""
MET_SHARE = 0.15
SURE_FROM, SURE_AT = 0.2, 0.35
PEAK_FRAMES, PEAK_SHARE = 2, 0.75
"""A frame counts if its probability is at least `PEAK_SHARE` of the highest one nearby.

Nearby means within `PEAK_FRAMES` frames on either side.
"""
TOUCHING_M = -0.5e-3
"""Lips touch in speech at this opening, in metres relative to the neutral face."""
BEFORE_FRAMES = 2
FASTEST_M_S, SPEED_UP_S = 0.28, 0.02
"""Greatest speed of closing and opening lips in m/s, and the seconds they take to reach it."""
HALF_TOUCH_S = 0.014
EDGES_S = 0.13
REACH_S = 0.02
NEAR_M = 0.5e-3
SHARPNESS = 6
LEAST_SHARE = 1e-3


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


@dataclass(frozen=True)
class Contact:
    """A span in which the lips touch: start and end in seconds, and how far they close, 0 to 1."""

    start_s: float
    end_s: float
    share: float


def contacts(probability: np.ndarray) -> list[Contact]:
    """The spans in which the lips touch, from `probability` [T] at 25 Hz.

    Twin of `LipClosures::contacts` in `rust-core/src/speech/closures.rs`. A frame counts if its probability
    is at least three quarters of the highest within two frames. A smooth step from 0.2 to 0.35 decides how
    far the lips close.
    """
    padded = np.pad(probability, PEAK_FRAMES)
    highest = sliding_window_view(padded, 2 * PEAK_FRAMES + 1).max(axis=1)
    near = np.where(probability >= PEAK_SHARE * highest, probability, 0.0)
    lip_contacts = []
    for first, end in runs(torch.from_numpy(near > SURE_FROM).int()):
        share = np.clip((near[first:end].max() - SURE_FROM) / (SURE_AT - SURE_FROM), 0, 1)
        start_s, end_s = (max((frame - 0.5) / FPS, 0.0) for frame in (first, end))
        lip_contacts.append(Contact(start_s, end_s, float(share * share * (3 - 2 * share))))
    return lip_contacts


def approach(openings: np.ndarray, closures: list[Contact]) -> np.ndarray:
    """How far the lips close in each frame, [T], 0 to 1, if they are `openings` [T] metres from touching.

    Twin of `approach` in `rust-core/src/motion/contacts/approach.rs`, at 25 frames a second.
    """
    times_s = np.arange(len(openings)) / FPS
    widest = np.full(len(openings), np.inf)
    for contact in closures:
        from_s, to_s = _touch(openings, contact)
        middle = min(int(np.floor(0.5 * (from_s + to_s) * FPS + 0.5)), len(openings) - 1)
        away_s = np.maximum(np.maximum(from_s - times_s, times_s - to_s), 0.0)
        fast = FASTEST_M_S * (away_s - 0.5 * SPEED_UP_S)
        reach = np.where(away_s < SPEED_UP_S, FASTEST_M_S * away_s**2 / (2 * SPEED_UP_S), fast)
        widest = np.minimum(widest, (1 - contact.share) * openings[middle] + reach)
    with np.errstate(divide="ignore", over="ignore"):
        ratio = np.where(openings > 0, openings / widest, 0.0)
        share = 1 - (1 + ratio**SHARPNESS) ** (-1 / SHARPNESS)
    return np.where(share < LEAST_SHARE, 0.0, share)


def _touch(openings: np.ndarray, contact: Contact) -> tuple[float, float]:
    """Start and end of the touch in seconds: around the smallest opening, for at least one frame."""
    middle_s, half_s = 0.5 * (contact.start_s + contact.end_s), 0.5 * (contact.end_s - contact.start_s)
    touching_s = max(half_s - 0.5 * EDGES_S, HALF_TOUCH_S)
    room_s = max(half_s - touching_s, 0.0)
    first = max(int(np.ceil((contact.start_s - REACH_S) * FPS)), 0)
    near = openings[first : int((contact.end_s + REACH_S) * FPS) + 1]
    at_s = middle_s
    if len(near):
        weight = np.exp(-(near - near.min()) / NEAR_M)
        at_s = float((weight * (first + np.arange(len(near)))).sum() / weight.sum() / FPS)
    at_s = min(max(at_s, middle_s - room_s), middle_s + room_s)
    touching_s = max(touching_s, 0.5 / FPS)
    return at_s - touching_s, at_s + touching_s


def lips_closed(motion: torch.Tensor, probability: torch.Tensor) -> torch.Tensor:
    """Closes the lips of a motion [T, 204] where `probability` [T] says p, b or m. No gap grows.

    Moves the lips as `close_lips` in `rust-core/src/motion/contacts/lips.rs` does. The jaw does not move.
    """
    points = motion.unflatten(-1, (68, 3)).numpy()
    gaps = inner_gaps(points, np.zeros((68, 3), points.dtype))
    openings = np.maximum(gaps - TOUCHING_M, 0.0)
    share = approach(openings.max(axis=1), contacts(probability.numpy()))[:, None].astype(points.dtype)
    closed = narrowed(points, share * openings, share * inner_depths(points))
    return torch.from_numpy(closed).flatten(1)


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
