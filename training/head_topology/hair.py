"""Lashes and brows as combs of flat hairs. Each comb is one piece. Centimetres in ICT's frame."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from training.default_head.parts import Part
from training.deform.tension_screened_biharmonic import catmull_rom
from training.head_topology.quads import normals

UPPER_LASHES, LOWER_LASHES = (0.8, 0.45), (0.28, 0.14)
"""Lengths of the longest and the shortest lash on each lid, in centimetres."""
HAIRS_PER_CM = 9.0
BROW_STEPS, BROW_ROWS = 40, 4
BROW_HALF_CM = [0.14, 0.25, 0.28, 0.26, 0.21, 0.13, 0.03]
BROW_OVER_SKIN_CM = 0.055


@dataclass
class Skin:
    """`points` `[V, 3]`, `triangles` `[F, 3]`."""

    points: np.ndarray
    triangles: np.ndarray

    def __post_init__(self):
        self.normals = normals(self.points, self.triangles)
        self._middles = cKDTree(self.points[self.triangles].mean(1))

    def under(self, places: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The skin nearest to places `[P, 3]`: a triangle's corners `[P, 3]` and their weights `[P, 3]`."""
        candidates = self._middles.query(places, k=16)[1]
        corners, shares, least = None, None, None
        for number in range(candidates.shape[1]):
            triangle = self.triangles[candidates[:, number]]
            share = nearest_share(places, self.points[triangle])
            far = np.linalg.norm(np.einsum("pc,pcd->pd", share, self.points[triangle]) - places, axis=1)
            if least is None:
                corners, shares, least = triangle, share, far
                continue
            better = far < least
            corners[better], shares[better] = triangle[better], share[better]
            least = np.minimum(far, least)
        return corners, shares


def nearest_share(places: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Barycentric weights of the point of each triangle `[P, 3, 3]` nearest to its place, clamped into it."""
    a, b, c = triangles[:, 0], triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]
    to = places - a
    bb, cc, bc = (b * b).sum(1), (c * c).sum(1), (b * c).sum(1)
    tb, tc = (to * b).sum(1), (to * c).sum(1)
    area = np.maximum(bb * cc - bc**2, 1e-12)
    v, w = (cc * tb - bc * tc) / area, (bb * tc - bc * tb) / area
    share = np.clip(np.stack([1 - v - w, v, w], 1), 0, 1)
    return share / share.sum(1, keepdims=True)


def line(points: np.ndarray, count: int) -> np.ndarray:
    """`[count, 3]` evenly spaced points on a Catmull-Rom curve through `points`."""
    knots = np.concatenate([[2 * points[0] - points[1]], points, [2 * points[-1] - points[-2]]])
    fine = [
        catmull_rom(a, b, c, d, t)
        for a, b, c, d in zip(knots, knots[1:], knots[2:], knots[3:], strict=False)
        for t in np.linspace(0, 1, 20, endpoint=False)
    ]
    fine = np.array([*fine, points[-1]])
    far = np.r_[0, np.cumsum(np.linalg.norm(np.diff(fine, axis=0), axis=1))]
    return np.stack([np.interp(np.linspace(0, far[-1], count), far, fine[:, k]) for k in range(3)], 1)


def lashes(name: str, upper: np.ndarray, lower: np.ndarray, eye: np.ndarray) -> Part:
    """The lashes of both lids. The hairs stand on a strip along the rim.

    `upper` and `lower` are lines along the rims from the inner corner. `eye` is the centre of the eyeball.
    """
    points, faces = [], []
    for rim, (longest, shortest), up in ((upper, UPPER_LASHES, 1.0), (lower, LOWER_LASHES, -1.0)):
        hairs = int(np.linalg.norm(np.diff(rim, axis=0), axis=1).sum() * HAIRS_PER_CM)
        base = line(rim, 2 * hairs + 1)
        share = np.linspace(0, 1, len(base))[:, None]
        out = base - eye
        out /= np.linalg.norm(out, axis=1, keepdims=True)
        outer = (base[-1] - base[0]) / np.linalg.norm(base[-1] - base[0])
        first = len(points)
        points += [*(base + 0.01 * out), *(base + 0.035 * out + [0, 0.01 * up, 0])]
        for k in range(len(base) - 1):
            a, b = first + k, first + len(base) + k
            faces += [[a, a + 1, b + 1], [a, b + 1, b]]
        for n in range(hairs):
            left = first + len(base) + 2 * n
            middle, at = 0.5 * (points[left] + points[left + 1]), share[2 * n]
            if not 0.16 < at < 0.96:
                continue
            size = shortest + (longest - shortest) * np.sin(np.pi * at**1.3)
            way = out[2 * n] + 0.8 * (at - 0.45) * outer
            half = 0.5 * (points[left + 1] - points[left])
            root = [left, left + 1]
            for far, lift, width in ((0.4, 0.08, 0.8), (0.75, 0.3, 0.5)):
                bent = middle + size * (far * way + up * lift * np.array([0, 1, 0]))
                tops = [len(points), len(points) + 1]
                points += [bent - width * half, bent + width * half]
                faces += [[root[0], root[1], tops[1]], [root[0], tops[1], tops[0]]]
                root = tops
            faces.append([*root, len(points)])
            points.append(middle + size * (way + up * 0.55 * np.array([0, 1, 0])))
    return Part(name, np.array(points), {"lashes": np.array(faces)})


def brow(name: str, skin: Skin, marks: np.ndarray) -> Part:
    """A brow over its landmarks `[5, 3]` from the inner end: a thin patch with hairs at its edges."""
    centre = line(marks, BROW_STEPS)
    half = np.interp(np.linspace(0, 1, BROW_STEPS), np.linspace(0, 1, len(BROW_HALF_CM)), BROW_HALF_CM)
    along = np.gradient(centre, axis=0)
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    corners, shares = skin.under(centre)
    out = np.einsum("pc,pcd->pd", shares, skin.normals[corners])
    across = np.cross(out, along)
    across *= np.sign(across[:, 1:2])
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    rows = np.linspace(-1, 1, BROW_ROWS)
    grid = centre[:, None] + rows[None, :, None] * half[:, None, None] * across[:, None]
    rough = np.random.default_rng(0).uniform(0.75, 1.25, len(centre))
    # Hairs stand up at the inner end and lie along the brow further out.
    lie = np.interp(np.linspace(0, 1, BROW_STEPS - 1), [0, 0.15, 0.5, 1], [0.3, 0.8, 1.3, 1.6])[:, None]
    size = 0.26 * rough[:-1, None] * (half[:-1, None] / 0.28) ** 0.5
    tips = grid[:-1, -1] + size * (0.5 * across[:-1] + lie * along[:-1])
    low = grid[:-1, 0] + 0.6 * size[::-1] * (-0.35 * across[:-1] + lie * along[:-1])
    flat = np.concatenate([grid.reshape(-1, 3), tips, low])
    corners, shares = skin.under(flat)
    on_skin = np.einsum("pc,pcd->pd", shares, skin.points[corners])
    away = np.einsum("pc,pcd->pd", shares, skin.normals[corners])
    over = BROW_OVER_SKIN_CM * np.concatenate(
        [np.tile(1 - 0.75 * rows**2, len(centre)), np.full(len(tips), 0.75), np.full(len(low), 0.6)]
    )
    points = on_skin + over[:, None] * away
    faces, first_tip = [], len(centre) * BROW_ROWS
    for step in range(BROW_STEPS - 1):
        for n in range(BROW_ROWS - 1):
            a, b = step * BROW_ROWS + n, (step + 1) * BROW_ROWS + n
            faces += [[a, b, b + 1], [a, b + 1, a + 1]]
        top, bottom = step * BROW_ROWS + BROW_ROWS - 1, step * BROW_ROWS
        faces.append([top, top + BROW_ROWS, first_tip + step])
        faces.append([bottom + BROW_ROWS, bottom, first_tip + len(tips) + step])
    faces = np.array(faces)
    a, b, c = (points[faces[:, k]] for k in range(3))
    inward = (np.cross(b - a, c - a) * away[faces[:, 0]]).sum(1) < 0
    faces[inward] = faces[inward][:, ::-1]
    return Part(name, points, {"brows": faces})
