"""The target that a rig's controls are fitted to: motion of skin points near the 68 landmarks.

Runs in the worker thread, without Blender.
"""

from dataclasses import replace

import numpy as np

from . import finding
from .plan import Plan
from .take import ROLES, ControlMotion, Found

# The regions for which misses are reported, and how much a point in each of them counts.
REGIONS = ("mouth", "eyes", "brows", "jaw", "nose")
IMPORTANCE = (3.0, 2.0, 1.5, 1.0, 1.0)
# Landmarks of iBUG 300-W by region: jaw 0-16, brows 17-26, nose 27-35, eyes 36-47, mouth 48-67.
_REGION_OF = np.repeat([3, 2, 4, 1, 0], [17, 10, 9, 12, 20])
# Points lie nearer to a landmark than the share _NEAR of the distance between the temples. At most
# _MOST points are enough for all controls of a face, and quick to evaluate.
_NEAR, _MOST = 0.2, 1500
_BLOCK = 4096
_SKIN = ROLES.index("skin")


class FollowPoints(Plan):
    """Keeps only the motion of the points that the controls are fitted to."""

    def finish(self, face, take, engine, progress):
        landmarks = finding.find(face, {}, engine.find, progress)
        count = face.pieces[0].count if face.pieces else len(face.positions)
        vertices, regions = nearby(face.positions[:count], landmarks)
        vertices, regions, pairs = _with_lips(vertices, regions, landmarks.lips(count))
        frames = np.ascontiguousarray(take.motion.displacements[:, vertices])
        largest = max(float(np.sqrt((f.astype(np.float64) ** 2).sum(axis=1).max()))
                      for f in take.motion.displacements)  # fmt: skip
        mm = take.largest_mm / max(largest, 1e-12)
        motion = ControlMotion(vertices, frames, regions, pairs, mm)
        return replace(take, motion=motion)


def nearby(positions: np.ndarray, face: Found) -> tuple[np.ndarray, np.ndarray]:
    """Numbers `[P]` of vertices `[V, 3]` of the skin near the landmarks, and their regions."""
    landmarks = face.positions
    width = float(np.linalg.norm(landmarks[0] - landmarks[16]))
    nearest = np.empty(len(positions), dtype=np.int64)
    apart = np.empty(len(positions))
    for first in range(0, len(positions), _BLOCK):
        rows = slice(first, first + _BLOCK)
        away = np.linalg.norm(positions[rows, None] - landmarks[None], axis=2)
        nearest[rows], apart[rows] = away.argmin(axis=1), away.min(axis=1)
    is_skin = np.asarray(face.part_roles)[face.part_of_vertex[: len(positions)]] == _SKIN
    inside = np.flatnonzero((apart <= _NEAR * width) & is_skin)
    step = max(1, -(-len(inside) // _MOST))
    inside = inside[::step]
    return inside, _REGION_OF[nearest[inside]]


def _with_lips(vertices, regions, lips) -> tuple:
    """Adds the vertices of `lips` `[N, 2]` to the points; returns their pairs `[N, 2]` as well."""
    fresh = np.setdiff1d(lips, vertices)
    every = np.concatenate([vertices, fresh])
    place = {int(vertex): number for number, vertex in enumerate(every)}
    pairs = np.array([place[int(vertex)] for vertex in lips.ravel()], dtype=np.int64)
    regions = np.concatenate([regions, np.zeros(len(fresh), dtype=regions.dtype)])
    return every, regions, pairs.reshape(-1, 2)
