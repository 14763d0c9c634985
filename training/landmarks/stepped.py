"""Surfaces in steps: vertices on a randomly turned lattice, true voxels, layers of board.

The landmarks stay where the face was. Steps are finer or coarser than on the heads that measure the finder
(`stylise_unseen.py`: 3 to 6 mm, equal in all directions, along the axes). Lengths are metres.
"""

import numpy as np

from training.landmarks.samples import Head

FINE, COARSE = (0.0015, 0.003), (0.006, 0.0085)
"""Ranges of fine and of coarse step lengths, in metres."""


def step(rng: np.random.Generator, count: int) -> np.ndarray:
    """Step lengths in `count` directions, each fine or coarse on its own."""
    low, high = np.where(rng.random((count, 1)) < 0.5, [FINE], [COARSE]).T
    return rng.uniform(low, high)


def lattice(rng: np.random.Generator, head: Head) -> Head:
    """Moves vertices to a lattice with its own step in each direction, turned by up to 45 degrees."""
    turn = np.eye(3)
    if rng.random() < 0.75:
        axis = rng.normal(size=3)
        axis /= np.linalg.norm(axis)
        x, y, z = axis
        cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
        angle = rng.uniform(0.05, 0.8)
        turn = np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross
    size, offset = step(rng, 3), rng.random(3)
    cells = np.floor(head.points @ turn / size + offset) + 0.5
    return Head((cells - offset) * size @ turn.T, head.triangles, head.landmarks)


def layers(rng: np.random.Generator, head: Head) -> Head:
    """Moves vertices along one direction only, as in a head cut from layers of board."""
    way = np.array([0, 0, 1.0]) + rng.normal(0, 0.5, 3)
    way /= np.linalg.norm(way)
    size = step(rng, 1)[0]
    along = head.points @ way
    shift = (np.floor(along / size + rng.random()) + 0.5) * size - along
    return Head(head.points + shift[:, None] * way, head.triangles, head.landmarks)


SIDES = np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]])


def voxels(rng: np.random.Generator, head: Head) -> Head:
    """Cubes wherever the surface passes. Only their free sides become faces."""
    size = float(step(rng, 1)[0])
    inside = np.unique(np.floor(spread(rng, head, 0.6 * size) / size + rng.random(3)).astype(int), axis=0)
    key = {tuple(cell) for cell in inside.tolist()}
    points, count = [], 0
    for side in SIDES:
        free = np.array([tuple(c) not in key for c in (inside + side).tolist()])
        points.append(square(inside[free], side))
        count += int(free.sum())
    corners = np.concatenate(points).reshape(-1, 3) * size
    first = 4 * np.arange(count)[:, None]
    triangles = np.concatenate([first + [0, 1, 2], first + [0, 2, 3]]).astype(np.int32)
    middle = 0.5 * size * np.ones(3)
    shift = head.points[head.triangles].mean((0, 1)) - (inside * size + middle).mean(0)
    return Head(corners + shift, triangles, head.landmarks)


def square(cells: np.ndarray, side: np.ndarray) -> np.ndarray:
    """The faces of cells `[n, 3]` that point towards `side`, as corners `[n, 4, 3]`."""
    across = np.roll(np.abs(side), 1)
    up = np.roll(np.abs(side), 2)
    corner = np.maximum(side, 0)
    return cells[:, None] + corner + np.array([0 * up, across, across + up, up])


def spread(rng: np.random.Generator, head: Head, gap: float) -> np.ndarray:
    """Points on the surface, about one in each square of `gap`."""
    a, b, c = (head.points[head.triangles[:, k]] for k in range(3))
    area = 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1)
    count = int(min(4 * area.sum() / gap**2, 300_000))
    triangle = rng.choice(len(area), count, p=area / area.sum())
    u, v = np.sqrt(rng.random((count, 1))), rng.random((count, 1))
    return (1 - u) * a[triangle] + u * (1 - v) * b[triangle] + u * v * c[triangle]


def stepped(rng: np.random.Generator, head: Head) -> Head:
    """One of the above."""
    return (lattice, layers, voxels)[rng.choice(3, p=[0.55, 0.2, 0.25])](rng, head)
