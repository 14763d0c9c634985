"""Tests of meshes with more or fewer triangles."""

import numpy as np

from training.corpus.remesh import quartered


def test_a_triangle_becomes_four_of_the_same_area():
    points = np.array([[0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [0.0, 2.0, 0.0], [2.0, 2.0, 0.0]])
    triangles = np.array([[0, 1, 2], [1, 3, 2]])
    grow, four = quartered(triangles, len(points))
    cut = grow @ points
    assert len(cut) == 4 + 5  # five edges, one of them shared
    assert len(four) == 8
    corners = cut[four]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    np.testing.assert_allclose(normals, np.tile([0.0, 0.0, 1.0], (8, 1)))
