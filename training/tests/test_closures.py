"""Facts about closing lips."""

import numpy as np
import torch

from training.corpus.clip import FPS
from training.corpus.closures import (
    FASTEST_M_S,
    TOUCHING_M,
    Contact,
    approach,
    bilabial_frames,
    closures_met,
    inner_depths,
    inner_gaps,
    lips_closed,
    narrowed,
)
from training.corpus.phones import SEGMENTS
from training.losses import lip_gap


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


def test_sure_closures_touch_and_unlikely_ones_change_nothing():
    motion = torch.from_numpy(open_mouth(11)).flatten(1)
    unlikely = torch.full((11,), 0.1)
    assert (lips_closed(motion, unlikely) == motion).all()
    likely = unlikely.index_fill(0, torch.tensor([5]), 0.9)
    gap = lip_gap(lips_closed(motion, likely))
    np.testing.assert_allclose(gap[[0, 5, 10]].numpy(), [0.01, TOUCHING_M, 0.01], atol=1e-5)
    assert gap.diff().abs().max() < FASTEST_M_S / FPS


def test_lips_touch_when_they_are_nearest():
    openings = 0.004 + 0.1 * np.abs(np.arange(25) / 25 - 0.48)
    share = approach(openings, [Contact(0.42, 0.5, 1.0)])
    assert share.argmax() == 12 and share[12] > 0.999


def test_closed_lips_meet_in_depth_too():
    motion = open_mouth(1)
    motion[:, [65, 66, 67], 2] = -0.003
    closed = lips_closed(torch.from_numpy(motion).flatten(1), torch.tensor([0.9]))
    np.testing.assert_allclose(inner_depths(closed.unflatten(1, (68, 3)).numpy()), 0.0, atol=1e-7)


def test_a_closure_counts_only_in_its_own_frames():
    phones = torch.full((80,), SEGMENTS.index("a"), dtype=torch.int16)
    phones[40:48] = SEGMENTS.index("p")
    assert bilabial_frames(phones) == [(8, 13)]
    opening = torch.ones(20)
    assert closures_met(opening, phones) == [False]
    opening[10] = 0.0
    assert closures_met(opening, phones) == [True]
    assert closures_met(opening.roll(6), phones) == [False]
