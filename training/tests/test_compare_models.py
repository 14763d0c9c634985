"""Tests of the comparison of two folders of models."""

import numpy as np
import pytest

from training.benchmarks.compare_models import Difference, cell, head_scale


def test_a_difference_is_in_millimetres_and_counts_what_moves():
    one = np.zeros((2, 3, 3))
    one[:, 0, 0] = 0.01
    one[:, 1, 0] = 0.0001  # moves too little for the means
    other = one.copy()
    other[0, 0, 1] = 0.001
    other[1, 2, 2] = 0.002  # the largest difference is at a vertex that stands still
    difference = Difference.between(one, other, 1000.0)
    assert difference.largest == pytest.approx(2.0)
    assert difference.mean == pytest.approx(0.5)
    assert difference.largest_motion == pytest.approx(10.0)
    assert difference.mean_motion == pytest.approx(10.0)
    assert cell(difference.largest, difference.largest_motion) == "2.000 mm (20.0 %)"


def test_a_mesh_of_any_unit_has_the_size_of_a_human_head():
    neutral = np.random.default_rng(0).normal(size=(68, 3))
    assert head_scale(neutral, neutral) == pytest.approx(1000.0)
    assert head_scale(100.0 * neutral, neutral) == pytest.approx(10.0)
