"""Creases: folds of the skin between the landmarks, transferred from a reference face by correspondence.

Mirrors `rust-core/src/deform/creases.rs`.

    dV = ... + s(v) B(v) C dL

68 landmarks cannot tell how the skin folds between the brows, beside the nose and over the cheeks, and a
network over them smooths the folds away. On a reference face the residual of every point is a linear function
of the landmarks' motion. C holds K combinations of that motion, and B their effect at P points of that face's
surface. To move these points to another face, the shift of the 68 landmarks is interpolated with the radial
basis |r|. A vertex follows its nearest points, more if their skin lies in its own plane and less if they are
far from it. There is one reference for each kind of face that the static weights know. A face follows the
reference of the kind nearest to it, because every artist folds skin in other places.

Lengths are decimetres in the canonical frame. Shapes: `V` vertices, `P` points, `N` = 68, `K` rank.
"""

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import RBFInterpolator
from scipy.spatial import cKDTree

NEIGHBOURS = 4
SOFT_DM = 0.003
"""This is added to distances, so that a point at distance 0 does not outweigh all others."""
FULL_WITHIN_DM, GONE_AT_DM = 0.06, 0.12
"""Distances from a vertex to its nearest point.

Up to the first a vertex follows its points fully. From the second on it does not follow at all.
"""


@dataclass
class Creases:
    """points, normals: [P, 3]. landmarks: [N, 3], of the reference. cross: [P, 3, K]. motion: [K, 3N]."""

    points: np.ndarray
    normals: np.ndarray
    landmarks: np.ndarray
    cross: np.ndarray
    motion: np.ndarray

    def transferred(self, positions: np.ndarray, triangles: np.ndarray, landmarks: np.ndarray) -> np.ndarray:
        """`s B` of a face. positions: [V, 3]. triangles: [F, 3]. landmarks: [N, 3]. Returns [V, 3, K]."""
        shift = RBFInterpolator(self.landmarks, landmarks - self.landmarks, kernel="linear", degree=0)
        points = self.points + shift(self.points)
        distance, index = cKDTree(points).query(positions, NEIGHBOURS, distance_upper_bound=GONE_AT_DM)
        index = np.minimum(index, len(points) - 1)
        normals = self.normals[index]
        along = np.einsum("vkx,vxy,vky->vk", normals, planes(positions, triangles), normals)
        weight = along / (distance + SOFT_DM) ** 2
        total = weight.sum(1, keepdims=True)
        near = ((GONE_AT_DM - distance[:, :1]) / (GONE_AT_DM - FULL_WITHIN_DM)).clip(0.0, 1.0)
        weight = np.where(total > 0.0, near * weight / np.maximum(total, 1e-12), 0.0)
        return np.einsum("vk,vkxr->vxr", weight, self.cross[index])


def planes(positions: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Orientation of the triangles around each vertex, whatever their winding: mean of n nᵀ, [V, 3, 3]."""
    edges = positions[triangles[:, 1:]] - positions[triangles[:, :1]]
    normal = np.cross(edges[:, 0], edges[:, 1])
    out = np.zeros((len(positions), 3, 3))
    for corner in triangles.T:
        np.add.at(out, corner, normal[:, :, None] * normal[:, None])
    return out / np.trace(out, axis1=1, axis2=2)[:, None, None].clip(1e-30)
