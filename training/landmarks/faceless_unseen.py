"""Things without a face that training never draws: chairs, cups, boxes, trees, torsos, hands, bottles,
lumps, houses, and the backs of heads. They measure how well the finder refuses. Lengths are metres, roughly.
"""

import numpy as np

from training.landmarks.adorn import box
from training.landmarks.samples import Faces
from training.landmarks.stylise_unseen import cone

Mesh = tuple[np.ndarray, np.ndarray]


def joined(parts: list[Mesh]) -> Mesh:
    """Joins several meshes into one."""
    starts = np.cumsum([0] + [len(p) for p, _ in parts])
    return (
        np.concatenate([p for p, _ in parts]),
        np.concatenate([t + start for (_, t), start in zip(parts, starts, strict=False)]),
    )


def turned_profile(profile: np.ndarray, steps: int) -> Mesh:
    """The surface that a profile (radius, height) `[n, 2]` sweeps when it turns about y."""
    angle = np.linspace(0, 2 * np.pi, steps, endpoint=False)
    r, y = profile[:, :1], np.repeat(profile[:, 1:], steps, 1)
    points = np.stack([r * np.cos(angle), y, r * np.sin(angle)], -1).reshape(-1, 3)
    i, k = np.meshgrid(np.arange(len(profile) - 1), np.arange(steps), indexing="ij")
    a, b = i * steps + k, i * steps + (k + 1) % steps
    both = [np.stack([a, b, a + steps], -1), np.stack([b, b + steps, a + steps], -1)]
    return points, np.stack(both).reshape(-1, 3).astype(np.int32)


def chair(rng: np.random.Generator, _faces, _held) -> Mesh:
    """A seat, four legs, and a back made of one plate or some bars."""
    w, h, thick = rng.uniform(0.15, 0.3), rng.uniform(0.2, 0.5), rng.uniform(0.01, 0.03)
    parts = [box([0, 0, 0], [w, thick, w])]
    corners = [(0.9 * w * x, 0.9 * w * z) for x in (-1, 1) for z in (-1, 1)]
    parts += [box([x, -h / 2, z], [thick, h / 2, thick]) for x, z in corners]
    if rng.random() < 0.5:
        parts.append(box([0, h / 2, -w], [w, h / 2, thick]))
    else:
        bars = np.linspace(-w, w, rng.integers(2, 6))
        parts += [box([x, h / 2, -w], [thick, h / 2, thick]) for x in bars]
        parts.append(box([0, h, -w], [w, thick * 2, thick]))
    return joined(parts)


def cup(rng: np.random.Generator, _faces, _held) -> Mesh:
    """A hollow cup with a handle."""
    r, h, wall = rng.uniform(0.03, 0.05), rng.uniform(0.05, 0.12), 0.004
    lip = r * rng.uniform(0.9, 1.5)
    body = np.array([[1e-4, 0], [r, 0], [lip, h], [lip - wall, h], [r - wall, wall], [1e-4, wall]])
    a = np.linspace(-0.5 * np.pi, 0.5 * np.pi, 9)
    handle = [
        box([r + 0.6 * h * 0.4 * np.cos(t), h / 2 + 0.3 * h * np.sin(t), 0], [0.006, 0.006, 0.005]) for t in a
    ]
    return joined([turned_profile(body, 24), *handle])


def bottle(rng: np.random.Generator, _faces, _held) -> Mesh:
    """A vase, a lamp or a bottle: any profile, turned on a lathe."""
    y = np.linspace(0, rng.uniform(0.1, 0.4), 24)
    r = 0.04 + 0.025 * np.interp(np.arange(24), np.linspace(0, 23, 7), rng.normal(0, 1, 7))
    return turned_profile(np.stack([np.maximum(r, 0.005), y], 1), int(rng.integers(6, 32)))


def boxes(rng: np.random.Generator, _faces, _held) -> Mesh:
    """A pile of boxes, some turned."""
    parts = []
    for _ in range(int(rng.integers(1, 6))):
        points, triangles = box([0, 0, 0], rng.uniform(0.03, 0.15, 3))
        a = rng.uniform(0, np.pi)
        turn = np.array([[np.cos(a), 0, np.sin(a)], [0, 1, 0], [-np.sin(a), 0, np.cos(a)]])
        parts.append((points @ turn + rng.normal(0, 0.1, 3), triangles))
    return joined(parts)


def tree(rng: np.random.Generator, _faces, _held) -> Mesh:
    """A fir of cones, or a trunk whose branches fork again and again."""
    if rng.random() < 0.4:
        tiers = range(int(rng.integers(3, 6)))
        parts = [cone([0, 0.2 * i, 0], [0, 0.2 * i + 0.35, 0], 0.25 - 0.035 * i) for i in tiers]
        return joined([turned_profile(np.array([[0.04, -0.3], [0.04, 0.1]]), 8), *parts])
    parts, ends = [], [(np.zeros(3), np.array([0, 0.3, 0]), 0.04)]
    for _ in range(4):
        more = []
        for foot, way, thick in ends:
            parts.append(cone(foot, foot + way * 1.2, thick, 6))
            more += [(foot + way, 0.7 * way + rng.normal(0, 0.3, 3) * np.linalg.norm(way), 0.6 * thick)]
            more += [(foot + way, 0.7 * way + rng.normal(0, 0.4, 3) * np.linalg.norm(way), 0.6 * thick)]
        ends = more
    return joined(parts)


def torso(rng: np.random.Generator, faces: Faces, _held) -> Mesh:
    """Shoulders, chest and waist with a cut neck: a turned profile pressed flat, some with arms or stumps."""
    profile = [[0.001, 0.1], [0.055, 0.1], [0.06, 0.0], [0.19, -0.06], [0.2, -0.15]]
    profile += [[0.15, -0.4], [0.18, -0.6], [0.001, -0.62]]
    points, triangles = turned_profile(np.array(profile) * rng.uniform(0.85, 1.2, (8, 1)), 28)
    points = points * [1, 1, rng.uniform(0.5, 0.75)]
    parts = [(points, triangles)]
    if rng.random() < 0.6:
        reach = rng.uniform(0.2, 0.6)
        hands = [[s * (0.25 + 0.3 * reach), -0.1 - reach, 0.05] for s in (-1, 1)]
        parts += [cone([np.sign(tip[0]) * 0.18, -0.1, 0], tip, 0.06) for tip in hands]
    return joined(parts)


def hand(rng: np.random.Generator, _faces, _held) -> Mesh:
    """A more or less closed hand: a palm, four fingers of three bones each, and a thumb."""
    curl, parts = rng.uniform(0, 0.6), [box([0, 0, 0], [0.042, 0.045, 0.013])]
    roots = [([x, 0.045, 0], 0.034) for x in np.linspace(-0.032, 0.032, 4)] + [([-0.05, -0.01, 0.01], 0.03)]
    for number, (root, long) in enumerate(roots):
        at, bend = np.array(root, float), curl * rng.uniform(0.5, 1.0)
        angle = 0.0
        for bone in range(3):
            angle += bend * (bone > 0)
            way = np.array([0, np.cos(angle), np.sin(angle)]) * long * (1 - 0.2 * bone)
            if number == 4:
                way = way[[1, 0, 2]] * [-0.8, 1, 1] + [0, 0.01, 0]
            middle = at + 0.5 * way
            parts.append(box(middle, np.maximum(0.52 * np.abs(way), 0.0075)))
            at = at + way
    return joined(parts)


def lump(rng: np.random.Generator, _faces, _held) -> Mesh:
    """A stone: a ball whose radius varies with the direction."""
    points, triangles = turned_profile(
        np.stack([np.sin(np.linspace(1e-3, np.pi - 1e-3, 50)), np.cos(np.linspace(0, np.pi, 50))], 1), 80
    )
    radius = np.ones(len(points))
    for _ in range(12):
        way = rng.normal(0, 3, 3)
        radius += rng.normal(0, 0.06) * np.sin(points @ way + rng.uniform(0, 6))
    return 0.1 * points * radius[:, None] * rng.uniform(0.6, 1.4, 3), triangles


def house(rng: np.random.Generator, _faces, _held) -> Mesh:
    """Walls, a roof, a chimney, and protruding windows and a door, not arranged like a face."""
    w, h, d = rng.uniform(0.1, 0.2, 3)
    roof = cone([0, h, 0], [0, h + rng.uniform(0.05, 0.2), 0], 1.4 * w, 4)
    parts = [box([0, 0, 0], [w, h, d]), roof, box([0.5 * w, h + 0.08, 0], [0.02, 0.08, 0.02])]
    places = [[x * w, rng.uniform(-0.1, 0.6) * h, d] for x in (-0.6, -0.1, 0.35, 0.7)]
    parts += [box(place, [0.02, 0.025, 0.004]) for place in places]
    return joined([*parts, box([0.6 * w, -0.6 * h, d], [0.025, 0.4 * h, 0.004])])


def back_of_head(rng: np.random.Generator, faces: Faces, held_out: np.ndarray) -> Mesh:
    """A head without its front. The rest stays as it is."""
    head = faces.ict_head(rng, held_out[rng.integers(len(held_out))])
    middle = head.points[head.triangles].mean(1)
    behind = middle[:, 2] < head.landmarks[36:48, 2].mean() - rng.uniform(0.03, 0.06)
    return head.points, head.triangles[behind]


KINDS = (chair, cup, bottle, boxes, tree, torso, hand, lump, house, back_of_head)
