"""Strong, smooth caricatures of a head: snouts, large eyes, other proportions, smooth toys.

Every map moves the surface and its landmarks alike, so that a stylised head keeps true landmarks. On an
animal they lie on the nearest analogue. Lengths are canonical metres.
"""

import numpy as np
import scipy.sparse as sp
from scipy.spatial import cKDTree

from training.landmarks.render import come_out
from training.landmarks.samples import Head, ellipsoid

EYES = (slice(36, 42), slice(42, 48))


def moved(head: Head, by) -> Head:
    """The head and its landmarks, moved by a map of space `[V, 3]` → `[V, 3]`."""
    return Head(by(head.points), head.triangles, by(head.landmarks))


def ramp(x: np.ndarray, low: float, high: float) -> np.ndarray:
    """0 below `low`, 1 above `high`, smooth between."""
    t = np.clip((x - low) / (high - low), 0, 1)
    return t * t * (3 - 2 * t)


def snout(rng: np.random.Generator, head: Head) -> Head:
    """Nose and mouth pushed out, down and together, as on a dog, a goat or a bear."""
    middle = head.landmarks[[30, 33, 51, 57]].mean(0)
    width, height = rng.uniform(0.022, 0.042), rng.uniform(0.026, 0.045)
    out, taper = rng.uniform(0.01, 0.09), rng.uniform(-0.3, 0.35)
    drop = np.clip(rng.normal(-0.2, 0.3) * out, -0.5 * height, 0.5 * height)

    def by(points: np.ndarray) -> np.ndarray:
        d = points - middle
        share = np.exp(-0.5 * ((d[:, 0] / width) ** 2 + (d[:, 1] / height) ** 2))
        share = share * ramp(d[:, 2], -0.06, 0.0)
        sideways = points[:, 0] * (1 - taper * share)
        return np.stack([sideways, points[:, 1] + drop * share, points[:, 2] + out * share], 1)

    return moved(head, by)


def swell(head: Head, centre: np.ndarray, factor: float, sigma: float) -> Head:
    """Magnifies by `factor` around a centre. The map is one-to-one for factors below 3."""

    def by(points: np.ndarray) -> np.ndarray:
        d = points - centre
        near = np.exp(-0.5 * (d**2).sum(1, keepdims=True) / sigma**2)
        return points + (factor - 1) * near * d

    return moved(head, by)


def shifted_eyes(rng: np.random.Generator, head: Head) -> Head:
    """Both eyes moved apart or together, up or down, mirrored."""
    apart, up = rng.normal(0, 0.006), rng.normal(0, 0.006)
    for side, eye in zip((-1, 1), EYES, strict=True):
        centre = head.landmarks[eye].mean(0)
        step = np.array([side * apart, up, 0.0])

        def by(points: np.ndarray, centre=centre, step=step) -> np.ndarray:
            near = np.exp(-0.5 * ((points - centre) ** 2).sum(1, keepdims=True) / 0.022**2)
            return points + near * step

        head = moved(head, by)
    return head


def egg(rng: np.random.Generator, head: Head) -> Head:
    """A wider cranium over a narrower jaw, or the reverse, and other proportions of the whole."""
    lean, reach = np.clip(rng.normal(0, 0.22), -0.4, 0.4), rng.uniform(0.05, 0.1)
    stretch = np.exp(rng.normal(0, 0.16, 3)) * [1, 1, rng.choice([1.0, 0.8, 0.6])]

    def by(points: np.ndarray) -> np.ndarray:
        grown = 1 + lean * np.tanh(points[:, 1:2] / reach)
        return points * np.concatenate([grown, np.ones_like(grown), grown], 1) * stretch

    return moved(head, by)


def smoothed(head: Head, rounds: int) -> Head:
    """Melts detail away by averaging neighbours. The landmarks move with their nearest vertices.

    A head that is only landmarks without a surface (as in the shape prior) stays as it is.
    """
    if len(head.triangles) < len(head.landmarks):
        return head
    count = len(head.points)
    t = head.triangles
    edges = np.concatenate([t[:, [0, 1]], t[:, [1, 2]], t[:, [2, 0]]])
    edges = np.concatenate([edges, edges[:, ::-1]])
    adjacency = sp.csr_matrix((np.ones(len(edges)), edges.T), (count, count))
    degree = np.asarray(adjacency.sum(1)).ravel()
    rider = cKDTree(head.points[degree > 0]).query(head.landmarks)[1]
    rider = np.flatnonzero(degree > 0)[rider]
    mean = sp.diags(1 / np.maximum(degree, 1)) @ adjacency
    points = head.points
    for _ in range(rounds):
        points = np.where(degree[:, None] > 0, 0.3 * points + 0.7 * (mean @ points), points)
    return Head(points, t, points[rider])


def glued(head: Head, extra: list) -> Head:
    """Joins separate closed shapes to the head."""
    points, triangles = [head.points], [head.triangles]
    for more_points, more_triangles in extra:
        triangles.append(more_triangles + sum(map(len, points)))
        points.append(more_points)
    return Head(np.concatenate(points), np.concatenate(triangles), head.landmarks)


def toy(rng: np.random.Generator, head: Head) -> Head:
    """A smooth head with eyes, brows and a nose stuck on, as on low-poly characters."""
    head = smoothed(head, int(rng.integers(15, 60)))
    marks, extra = head.landmarks, []
    for eye, brow in zip(EYES, (slice(17, 22), slice(22, 27)), strict=True):
        centre, wide = marks[eye].mean(0), np.ptp(marks[eye][:, 0]) * rng.uniform(0.4, 0.6)
        if rng.random() < 0.8:
            radii = [wide, wide * rng.uniform(0.6, 1.6), wide * rng.uniform(0.3, 0.9)]
            extra.append(ellipsoid(centre, radii, 8))
            head.landmarks = come_out(head.landmarks, eye, extra[-1:])
        if rng.random() < 0.6:
            wide = np.ptp(marks[brow][:, 0]) * 0.5
            thick = wide * rng.uniform(0.12, 0.3, 2)
            extra.append(ellipsoid(marks[brow].mean(0), [wide, thick[0], thick[1]], 6))
    if rng.random() < 0.5:
        radii = rng.uniform(0.005, 0.014, 3)
        extra.append(ellipsoid(marks[[30, 33]].mean(0), radii, 7))
    return glued(head, extra)


def animal(rng: np.random.Generator, head: Head) -> Head:
    """Melted features, a large nose on a snout, small eyes, ears at the sides, a wide head."""
    head = smoothed(head, int(rng.integers(10, 50)))
    head = swell(head, head.landmarks[30], rng.uniform(1.0, 2.0), 0.02)
    head = snout(rng, head)
    marks, extra = head.landmarks, []
    if rng.random() < 0.7:
        tip = marks[[30, 33]].mean(0)
        extra.append(ellipsoid(tip, rng.uniform([0.008, 0.006, 0.006], [0.022, 0.03, 0.016]), 9))
    size, bulge = rng.uniform(0.005, 0.012), rng.uniform(-0.2, 0.6)
    if rng.random() < 0.6:
        for eye in EYES:
            extra.append(ellipsoid(marks[eye].mean(0) + [0, 0, bulge * size], [size] * 3, 7))
            head.landmarks = come_out(head.landmarks, eye, extra[-1:])
    if rng.random() < 0.8:
        out, up = rng.uniform(0.06, 0.11), rng.uniform(-0.01, 0.11)
        radii = rng.uniform([0.015, 0.02, 0.008], [0.05, 0.06, 0.03])
        for side in (-1, 1):
            extra.append(ellipsoid([side * out, up, -0.02], radii, 8))
    return glued(head, extra)


def stylise(rng: np.random.Generator, head: Head) -> Head:
    """A random mixture of the above: one in four an animal, one in six a toy."""
    if rng.random() < 0.25:
        return egg(rng, shifted_eyes(rng, animal(rng, head)))
    if rng.random() < 0.2:
        head = toy(rng, head)
    if rng.random() < 0.7:
        factor, sigma = rng.uniform(0.85, 2.1), rng.uniform(0.012, 0.018)
        for eye in EYES:
            head = swell(head, head.landmarks[eye].mean(0), factor, sigma)
    if rng.random() < 0.5:
        head = shifted_eyes(rng, head)
    if rng.random() < 0.5:
        head = swell(head, head.landmarks[30], rng.uniform(0.4, 1.8), rng.uniform(0.014, 0.022))
    if rng.random() < 0.5:
        head = swell(head, head.landmarks[48:60].mean(0), rng.uniform(0.5, 1.7), 0.022)
    if rng.random() < 0.4:
        head = snout(rng, head)
    return egg(rng, head)


def limb(rng: np.random.Generator, start, end, thick: float):
    """A long ellipsoid from one point to another."""
    start, end = np.asarray(start, float), np.asarray(end, float)
    axis = end - start
    length = np.linalg.norm(axis)
    points, triangles = ellipsoid([0, 0, 0], [thick, 0.55 * length, thick], 8)
    y = axis / length
    x = np.cross(y, rng.normal(size=3))
    x /= np.linalg.norm(x)
    turn = np.stack([x, y, np.cross(x, y)])
    return points @ turn + 0.5 * (start + end), triangles


def company(rng: np.random.Generator, head: Head) -> Head:
    """Adds things that stylised heads have: a body with limbs or four legs, ears, horns, a hat."""
    extra = []
    if rng.random() < 0.5:
        extra += body(rng, four_legs=rng.random() < 0.35)
    for chance, thick, out in ((0.35, (0.02, 0.05), (0.05, 0.12)), (0.2, (0.008, 0.02), (0.08, 0.3))):
        if rng.random() < chance:
            low, high = rng.uniform(0.0, 0.1), rng.uniform(*out)
            width, thick = rng.uniform(0.03, 0.09), rng.uniform(*thick)
            lean = rng.normal(0, 0.05, 2)
            for side in (-1, 1):
                foot, tip = (
                    [side * width, low, -0.02],
                    [side * (width + lean[0]), low + high, -0.02 + lean[1]],
                )
                extra.append(limb(rng, foot, tip, thick))
    if rng.random() < 0.2:
        height = rng.uniform(0.06, 0.13)
        wide = rng.uniform(0.1, 0.25)
        extra.append(ellipsoid([0, height, 0], [wide, 0.012, wide], 12))
        extra.append(
            limb(rng, [0, height, 0], [0, height + rng.uniform(0.05, 0.3), -0.02], rng.uniform(0.06, 0.1))
        )
    return glued(head, extra)


def body(rng: np.random.Generator, four_legs: bool) -> list:
    """A trunk and limbs, under a head or (with four legs) behind it."""
    size = rng.uniform(0.5, 1.6)
    if four_legs:
        end = np.array([0, rng.uniform(-0.3, 0.0), -0.45]) * size + [0, -0.08, -0.05]
        start = np.array([0, -0.1, -0.06])
        parts = [limb(rng, start, end, rng.uniform(0.08, 0.16) * size)]
        for side in (-1, 1):
            for foot in (0.2, 0.85):
                top = start + foot * (end - start) + [side * 0.08 * size, 0, 0]
                parts.append(limb(rng, top, top - [0, 0.4 * size, 0], 0.045 * size))
        return parts
    hip = np.array([0, -0.15 - 0.5 * size, -0.03])
    wide = rng.uniform(0.1, 0.2) * size
    parts = [limb(rng, [0, -0.1, -0.03], hip, wide * 0.8)]
    for side in (-1, 1):
        shoulder = np.array([side * wide, -0.17, -0.03])
        swing = rng.uniform(0, 1.6)
        hand = shoulder + 0.55 * size * np.array([side * np.sin(swing), -np.cos(swing), rng.normal(0, 0.2)])
        parts.append(limb(rng, shoulder, hand, 0.045 * size))
        thigh = hip + [side * 0.09 * size, 0, 0]
        parts.append(limb(rng, thigh, thigh - [0, 0.8 * size, 0], 0.07 * size))
    return parts
