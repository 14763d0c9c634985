"""Rows of single teeth in their gums. ICT's teeth are measured for the size, never copied.

All lengths are centimetres in ICT's frame.
"""

import numpy as np

from training.default_head.parts import Part, tube_faces

# Widths and heights of crowns from the middle to the back (Wheeler's Dental Anatomy, in centimetres).
UPPER_WIDTHS, UPPER_HEIGHTS = (
    [0.85, 0.65, 0.76, 0.71, 0.68, 1.0, 0.95],
    [1.05, 0.92, 1.0, 0.85, 0.8, 0.72, 0.7],
)
LOWER_WIDTHS, LOWER_HEIGHTS = (
    [0.54, 0.58, 0.69, 0.70, 0.71, 1.05, 1.0],
    [0.88, 0.92, 1.0, 0.85, 0.8, 0.72, 0.7],
)
DEPTHS = [0.34, 0.34, 0.5, 0.72, 0.75, 0.95, 0.95]
RING, LEVELS = 10, [0.0, 0.06, 0.22, 0.5, 0.8, 1.0]
GUM_RING, GUM_INNER = 9, 4
"""Number of points around the gum's tube, and index of the one that lies deepest in the gum."""
SQUARENESS = 0.55
"""Exponent on the coordinates of a circle that turns it into a rounded square."""
FULLNESS = [0.72, 0.9, 1.0, 0.98, 0.9, 0.8]
"""Size of a crown's outline at each of `LEVELS` from its edge to the gum. The widest has 1."""


class Arch:
    """Half an ellipse through ICT's teeth, `width` and `depth` in centimetres. It ends at z = `back`."""

    def __init__(self, measured: np.ndarray):
        self.back = measured[:, 2].min() + 0.35
        self.width = float(np.percentile(np.abs(measured[:, 0]), 97)) - 0.35
        self.depth = measured[:, 2].max() - self.back
        angles = np.linspace(0, 0.5 * np.pi, 400)
        self._line = np.stack([self.width * np.sin(angles), self.back + self.depth * np.cos(angles)], 1)
        self._far = np.r_[0, np.cumsum(np.linalg.norm(np.diff(self._line, axis=0), axis=1))]
        self.length = float(self._far[-1])

    def at(self, far: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Places `[N, 2]` (x, z) and normals at distances along the left half, or the right if negative."""
        side = np.where(far < 0, -1.0, 1.0)[:, None] * [1, 0] + [0, 1]
        inside = np.clip(np.abs(far), 0, self.length)
        place = np.stack([np.interp(inside, self._far, self._line[:, k]) for k in (0, 1)], 1)
        beyond = np.maximum(np.abs(far) - self.length, 0)
        out = np.stack([place[:, 0] / self.width**2, (place[:, 1] - self.back) / self.depth**2], 1)
        out /= np.linalg.norm(out, axis=1, keepdims=True)
        return (place - np.stack([0 * beyond, beyond], 1)) * side, out * side


def crown(width: float, height: float, depth: float, biting: bool) -> tuple[np.ndarray, np.ndarray]:
    """A tooth as points `[N, 3]` (across, up, out) and triangles. Its edge is at 0, its gum at `height`.

    A tooth with a biting edge (`biting`) has the shape of a chisel, any other that of a block.
    """
    around = np.linspace(0, 2 * np.pi, RING, endpoint=False) + np.pi / RING
    circle = np.stack([np.cos(around), np.sin(around)], 1)
    outline = np.sign(circle) * np.abs(circle) ** SQUARENESS
    points = []
    for level, full in zip(LEVELS, FULLNESS, strict=True):
        thick = (0.3 + 0.7 * level**0.7) if biting else full
        lean = -0.12 * depth * (1 - level) if biting else 0.0
        for x, z in outline:
            points.append([0.5 * width * full * x, height * level, 0.5 * depth * thick * z + lean])
    points = np.array([*points, [0, -0.01 * height, -0.12 * depth if biting else 0.0]])
    faces = []
    for level in range(len(LEVELS) - 1):
        for k in range(RING):
            a, b = level * RING + k, level * RING + (k + 1) % RING
            faces += [[a, a + RING, b], [b, a + RING, b + RING]]
    faces += [[len(points) - 1, k, (k + 1) % RING] for k in range(RING)]
    return points, np.array(faces)


def row(name: str, measured: np.ndarray, upper: bool) -> Part:
    """Fourteen teeth and the gum over them."""
    arch, sign = Arch(measured), 1.0 if upper else -1.0
    edge = float(np.percentile(measured[:, 1], 2 if upper else 98))
    widths, heights = (UPPER_WIDTHS, UPPER_HEIGHTS) if upper else (LOWER_WIDTHS, LOWER_HEIGHTS)
    shrink = (arch.length + 0.1) / sum(widths)
    points, faces, roots, far = [], [], [], 0.0
    gum_far, gum_height = [], []
    for width, height, depth, number in zip(widths, heights, DEPTHS, range(7), strict=True):
        width *= shrink
        for side in (1.0, -1.0):
            shape, triangles = crown(width * 0.97, height, depth, number < 3)
            along = side * (far + 0.5 * width) + shape[:, 0]
            place, out = arch.at(along)
            place = place + out * (shape[:, 2] - 0.5 * depth)[:, None]
            # Middle incisors and canines reach furthest. The second incisors fall a little short,
            # and the teeth behind the canines ever more.
            rise = 0.04 * (number == 1) + 0.015 * max(0, number - 2) ** 2
            y = edge + sign * (shape[:, 1] + rise)
            first = sum(map(len, points))
            points.append(np.stack([place[:, 0], y, place[:, 1]], 1))
            faces.append((triangles if sign > 0 else triangles[:, ::-1]) + first)
            roots.append((first + (len(LEVELS) - 1) * RING, side * (far + 0.5 * width)))
        for share in (0.02, 0.16, 0.33, 0.5, 0.67, 0.84, 0.98):
            gum_far.append(far + share * width)
            gum_height.append(height - 0.1 - 0.16 * (2 * share - 1) ** 2)
        far += width
    teeth = np.concatenate(points), np.concatenate(faces)
    gum, gum_faces = gums(arch, np.array(gum_far), np.array(gum_height), edge, sign)
    # A triangle inside the gum is attached to each tooth, so that the row is one piece.
    ends = np.r_[-np.array(gum_far)[::-1], gum_far]
    rings = [min(int(np.abs(ends - place).argmin()), len(ends) - 2) for _, place in roots]
    inner = [len(teeth[0]) + ring * GUM_RING + GUM_INNER for ring in rings]
    anchors = [[tooth, at, at + GUM_RING] for (tooth, _), at in zip(roots, inner, strict=True)]
    in_gum = np.concatenate([gum_faces + len(teeth[0]), anchors])
    return Part(name, np.concatenate([teeth[0], gum]), {"teeth": teeth[1], "gums": in_gum})


def gums(arch: Arch, far: np.ndarray, height: np.ndarray, edge: float, sign: float):
    """A tube over the roots. Its rim follows the necks of the teeth."""
    far, height = np.r_[-far[::-1], far], np.r_[height[::-1], height]
    depth = np.interp(np.abs(far), np.linspace(0, arch.length, 7), DEPTHS)
    # Points around the tube: (share of the depth, inward from the outer face; height over the neck).
    profile = [
        (-0.02, 0.0), (-0.12, 0.1), (-0.12, 0.3), (0.0, 0.55), (0.5, 0.6),
        (1.0, 0.55), (1.12, 0.3), (1.05, 0.1), (0.5, 0.12),
    ]  # fmt: skip
    rings = []
    for s, h, d in zip(far, height, depth, strict=True):
        place, out = arch.at(np.array([s]))
        for inward, over in profile:
            at = place[0] - out[0] * inward * d
            rings.append([at[0], edge + sign * (h + 0.9 * over), at[1]])
    faces = tube_faces(len(far), len(profile), sign > 0)
    return np.array(rings), faces
