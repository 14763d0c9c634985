"""Facts about closed lips."""

import numpy as np
import torch

from training.corpus.closures import bilabial_frames, closures_met, inner_depths, inner_gaps, narrowed
from training.corpus.phones import SEGMENTS


def open_mouth(frames: int, gap_m: float = 0.01) -> np.ndarray:
    """Motion [T, 68, 3] whose lower lip hangs by `gap_m`."""
    motion = np.zeros((frames, 68, 3), np.float32)
    motion[:, [55, 56, 57, 58, 59, 65, 66, 67], 1] = -gap_m
    return motion


def test_narrowing_takes_the_gap_that_is_asked_and_leaves_the_corners():
    motion = open_mouth(2)
    by = np.array([[0.004, 0.006, 0.004], [0.0, 0.0, 0.0]], np.float32)
    out = narrowed(motion, by, 0.5 * by)
    change = inner_gaps(motion, np.zeros((68, 3))) - inner_gaps(out, np.zeros((68, 3)))
    np.testing.assert_allclose(change, by, atol=1e-7)
    np.testing.assert_allclose(inner_depths(motion) - inner_depths(out), 0.5 * by, atol=1e-7)
    assert (out[:, [48, 54, 60, 64]] == motion[:, [48, 54, 60, 64]]).all()
    assert (out[1] == motion[1]).all()


def test_a_closure_counts_only_in_its_own_frames():
    phones = torch.full((80,), SEGMENTS.index("a"), dtype=torch.int16)
    phones[40:48] = SEGMENTS.index("p")
    assert bilabial_frames(phones) == [(8, 13)]
    opening = torch.ones(20)
    assert closures_met(opening, phones) == [False]
    opening[10] = 0.0
    assert closures_met(opening, phones) == [True]
    assert closures_met(opening.roll(6), phones) == [False]
