"""Covers for eyes: prisms and rounded blocks on them, patches in front of one eye, visors in front of both.

An eye's landmarks lie on the visible surface, not on the skin behind it. So they move out to the front of the
cover, which is what users see and drag. Covers are rounded, many-sided or bent. Boxes appear only on the
heads that measure the finder (`stylise_unseen.py`). Lengths are canonical metres.
"""

import numpy as np

from training.landmarks import render
from training.landmarks.samples import Head, ellipsoid
from training.landmarks.stylise import EYES, glued, limb


def prism(outline: np.ndarray, taper: float, bulge: float) -> tuple[np.ndarray, np.ndarray]:
    """A closed prism from z = −1 to 1 over an outline `[n, 2]` around the origin: points and triangles.

    Its front is `taper` times as wide, and the middle of the front stands out by `bulge`.
    """
    count, flat = len(outline), np.ones((len(outline), 1))
    rings = [np.hstack([wide * outline, z * flat]) for wide, z in ((1, -1), (1, 0.7), (taper, 1))]
    points = np.concatenate([*rings, [[0, 0, -1.0], [0, 0, 1.0 + bulge]]])
    k = np.arange(count)
    nxt = (k + 1) % count
    triangles = [np.stack([k, nxt, 0 * k + 3 * count], 1)]
    for low in (0, count):
        triangles += [
            np.stack([low + k, low + nxt, low + count + k], 1),
            np.stack([low + nxt, low + count + nxt, low + count + k], 1),
        ]
    triangles.append(np.stack([2 * count + k, 2 * count + nxt, 0 * k + 3 * count + 1], 1))
    return points, np.concatenate(triangles).astype(np.int32)


def rounded(power: float) -> tuple[np.ndarray, np.ndarray]:
    """A superellipsoid with radii of 1: a pebble, or a block with rounded edges."""
    points, triangles = ellipsoid([0, 0, 0], [1, 1, 1], 18)
    size = (np.abs(points) ** power).sum(1, keepdims=True) ** (1 / power)
    return points / size, triangles


def cover_shape(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """A shape with radii of about 1 and a flat or nearly flat front."""
    if rng.random() < 0.35:
        return rounded(rng.uniform(4.0, 9.0))
    sides = int(rng.choice([3, 5, 6, 7, 8, 12]))
    angle = rng.uniform(0, 2 * np.pi) + np.linspace(0, 2 * np.pi, sides, endpoint=False)
    outline = np.stack([np.cos(angle), np.sin(angle)], 1) * (1.15 if sides < 6 else 1.0)
    return prism(outline, rng.uniform(0.7, 1.0), rng.uniform(0.0, 0.25))


def turned(rng: np.random.Generator, points: np.ndarray, degrees: float) -> np.ndarray:
    """Points turned a little about x and y."""
    a, b = np.radians(rng.normal(0, degrees, 2))
    about_x = np.array([[1, 0, 0], [0, np.cos(a), -np.sin(a)], [0, np.sin(a), np.cos(a)]])
    return points @ about_x.T @ render.yaw(b).T


def set_before(marks: np.ndarray, eye: slice, shape, flat: bool) -> np.ndarray:
    """Moves the landmarks of one eye out to the surface of a cover.

    If `flat`, landmarks that the cover does not reach move out to the height of its front.
    """
    out = render.come_out(marks, eye, [shape])
    if flat:
        out[eye, 2] = np.maximum(out[eye, 2], np.median(out[eye, 2]))
        out[eye, 2] = np.maximum(out[eye, 2], shape[0][:, 2].max() - 0.003)
    return out


def eye_blocks(rng: np.random.Generator, head: Head) -> Head:
    """Prisms or rounded blocks on both eyes, sometimes only on one. Some have a pupil."""
    marks, extra = head.landmarks, []
    shape, triangles = cover_shape(rng)
    grown, tall, deep = rng.uniform(0.75, 1.35), rng.uniform(0.6, 1.25), rng.uniform(0.2, 1.1)
    sunk, pupil, only = rng.uniform(-0.4, 0.3), rng.random() < 0.25, rng.random() < 0.15
    for eye in EYES[: 1 if only else 2]:
        half, middle = 0.5 * np.ptp(marks[eye][:, 0]), marks[eye].mean(0)
        radii = half * grown * np.array([1.0, tall, deep])
        points = turned(rng, shape * radii, 5.0) + middle + [0, 0, sunk * radii[2]]
        marks = set_before(marks, eye, (points, triangles), flat=True)
        extra.append((points, triangles))
        if pupil:
            front = [middle[0], middle[1], points[:, 2].max()]
            extra.append(ellipsoid(front, radii * [0.35, 0.35, 0.15], 6))
    return glued(Head(head.points, head.triangles, marks), extra)


def patch(rng: np.random.Generator, head: Head) -> Head:
    """A patch in front of one eye: round, bent or many-sided, sometimes on a strap."""
    eye = EYES[int(rng.integers(2))]
    marks = head.landmarks
    half, middle = 0.5 * np.ptp(marks[eye][:, 0]), marks[eye].mean(0)
    shape, triangles = cover_shape(rng)
    radii = half * rng.uniform(1.05, 1.6) * np.array([1.0, rng.uniform(0.65, 1.2), 0.0])
    radii[2] = rng.uniform(0.0006, 0.003)
    points = shape * radii
    points[:, 2] -= rng.uniform(0, 0.35) * (points[:, :2] ** 2).sum(1) / radii[0]
    centre = middle + [0, 0, rng.uniform(0.002, 0.013)]
    points = turned(rng, points, 6.0) + centre
    extra, marks = [(points, triangles)], set_before(marks, eye, (points, triangles), flat=False)
    if rng.random() < 0.4:
        reach, lift = 1.1 * np.abs(marks[:17, 0]).max(), rng.uniform(-0.01, 0.05)
        for side, rise in ((-1, lift), (1, -0.3 * lift)):
            end = [side * reach, centre[1] + rise * (1 if middle[0] < 0 else -1) * side, -0.01]
            extra.append(limb(rng, centre - [0, 0, 0.002], end, rng.uniform(0.001, 0.003)))
    return glued(Head(head.points, head.triangles, marks), extra)


def visor(rng: np.random.Generator, head: Head) -> Head:
    """A bent band in front of both eyes."""
    marks = head.landmarks
    middle = marks[36:48].mean(0)
    wide = 0.5 * np.ptp(marks[36:48, 0]) * rng.uniform(1.1, 1.5)
    high = 0.5 * np.ptp(marks[36:42, 0]) * rng.uniform(0.6, 1.3)
    across, up = np.meshgrid(np.linspace(-1, 1, 17), np.linspace(-1, 1, 5), indexing="ij")
    bend, out = rng.uniform(0.1, 0.5), rng.uniform(0.003, 0.014)
    front = marks[36:48, 2].max() + out
    z = front - bend * wide * across**2 - rng.uniform(0, 0.15) * high * up**2
    points = np.stack([middle[0] + wide * across, middle[1] + high * up * (1 - 0.2 * across**2), z], -1)
    points = points.reshape(-1, 3)
    grid = np.arange(85).reshape(17, 5)
    a, b, c, d = (g.ravel() for g in (grid[:-1, :-1], grid[1:, :-1], grid[:-1, 1:], grid[1:, 1:]))
    triangles = np.concatenate([np.stack([a, b, c], 1), np.stack([b, d, c], 1)]).astype(np.int32)
    marks = render.come_out(marks, slice(36, 48), [(points, triangles)])
    return glued(Head(head.points, head.triangles, marks), [(points, triangles)])


def covered(rng: np.random.Generator, head: Head) -> Head:
    """One of the above."""
    return (eye_blocks, patch, visor)[rng.choice(3, p=[0.5, 0.4, 0.1])](rng, head)
