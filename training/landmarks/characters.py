"""Heads that were never human, with their 68 landmarks.

Eyes, brows, a nose and a mouth are raised from balls, boxes and columns, dented into them or stuck on. A head
is a superellipsoid whose front is displaced by heights over x and y. The features are drawn over x and y, and
so are the landmarks. So these lie on the features, whatever is piled on. Lengths are canonical metres.
"""

from dataclasses import dataclass, field

import numpy as np

from training.align import canonical_landmarks
from training.landmarks import adorn
from training.landmarks.samples import Head
from training.landmarks.stylise import ramp

RINGS, SPOKES = 120, 150


@dataclass
class Clay:
    """A head in the making: radii, roundness, taper of x and z towards the chin, and heights to add."""

    radii: np.ndarray
    power: float
    chin: float
    waist: float
    heights: list = field(default_factory=list)
    extra: list = field(default_factory=list)

    def over(self, xy: np.ndarray) -> np.ndarray:
        """Points of the bare front at x and y, `[n, 3]`. Places outside the front move in to its edge."""
        reach = (np.abs(xy / self.radii[:2]) ** self.power).sum(-1, keepdims=True) ** (1 / self.power)
        xy = xy * np.minimum(1.0, 0.96 / np.maximum(reach, 1e-9))
        left = 1 - (np.abs(xy / self.radii[:2]) ** self.power).sum(-1)
        z = self.radii[2] * np.maximum(left, 0) ** (1 / self.power)
        return np.concatenate([xy, z[:, None]], 1)

    def bare(self) -> tuple[np.ndarray, np.ndarray]:
        """The superellipsoid itself as points and triangles. The mesh is finest in front."""
        theta = np.pi * np.linspace(0, 1, RINGS) ** 1.4
        theta, phi = np.meshgrid(theta, np.linspace(0, 2 * np.pi, SPOKES, endpoint=False), indexing="ij")
        d = np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], -1)
        d = d.reshape(-1, 3) / self.radii
        points = d * self.radii / (np.abs(d) ** self.power).sum(1, keepdims=True) ** (1 / self.power)
        i, k = np.meshgrid(np.arange(RINGS - 1), np.arange(SPOKES), indexing="ij")
        a, b = i * SPOKES + k, i * SPOKES + (k + 1) % SPOKES
        faces = [np.stack([a, a + SPOKES, b], -1), np.stack([b, a + SPOKES, b + SPOKES], -1)]
        return points, np.stack(faces).reshape(-1, 3).astype(np.int32)

    def raised(self, points: np.ndarray) -> np.ndarray:
        """Points of the bare head with all heights added, then tapered towards the chin."""
        front = ramp(points[:, 2] / self.radii[2], 0.0, 0.25)
        outward = points / self.radii**2 * self.radii[2] * [0.7, 0.7, 1.0]
        outward /= np.linalg.norm(outward, axis=1, keepdims=True)
        total = sum((height(points[:, :2]) for height in self.heights), np.zeros(len(points)))
        points = points + (front * total)[:, None] * outward
        lower = ramp(-points[:, 1], -self.waist, 0.7 * self.radii[1])[:, None]
        return points * (1 + (self.chin - 1) * lower * [1.0, 0.0, 0.35])


def radius_of(xy: np.ndarray, centre, wide: float, high: float) -> np.ndarray:
    """Distance from a centre, in units of the half width `wide` and the half height `high`."""
    d = (xy - np.asarray(centre)[:2]) / [wide, high]
    return np.sqrt((d**2).sum(-1))


def line_distance(xy: np.ndarray, path: np.ndarray) -> np.ndarray:
    """Distance to a polyline `[n, 2]`."""
    best = np.full(len(xy), np.inf)
    for a, b in zip(path[:-1], path[1:], strict=True):
        along = b - a
        t = np.clip(((xy - a) @ along) / max(along @ along, 1e-12), 0, 1)
        best = np.minimum(best, np.linalg.norm(xy - a - t[:, None] * along, axis=1))
    return best


def layout(rng: np.random.Generator, clay: Clay) -> np.ndarray:
    """Places of the features, `[68, 2]`: human proportions, with every part moved and scaled."""
    flat = canonical_landmarks()[:, :2].copy()
    flat *= clay.radii[:2] / [0.078, 0.108] * np.exp(rng.normal(0, 0.08, 2))
    apart, size, tall = np.exp(rng.normal(0.05, 0.2)), np.exp(rng.normal(0.1, 0.35)), rng.uniform(0.6, 2.6)
    up, single = rng.normal(0.0, 0.012), rng.random() < 0.04
    for eye in (slice(36, 42), slice(42, 48)):
        middle = flat[eye].mean(0)
        wide = min(0.5 * np.ptp(flat[eye][:, 0]) * size, 0.8 * abs(middle[0]) * apart)
        moved = np.array([np.sign(middle[0]) * wide if single else middle[0] * apart, middle[1] + up])
        flat[eye] = eye_outline(moved, wide, 0.45 * wide * tall)
    lift = flat[36:48, 1].max() - 0.0135 + rng.uniform(-0.004, 0.012)
    flat[17:27] = flat[17:27] * [apart, np.exp(rng.normal(0, 0.2))] + [0, lift]
    tilt = rng.normal(0, 0.25)
    flat[17:27, 1] += tilt * (np.abs(flat[17:27, 0]) - np.abs(flat[17:27, 0]).mean())
    nose, drop = np.exp(rng.normal(-0.1, 0.4)), rng.normal(0, 0.008)
    flat[31:36, 0] *= nose
    flat[27:36, 1] = flat[27, 1] + (flat[27:36, 1] - flat[27, 1]) * np.exp(rng.normal(-0.1, 0.25)) + drop
    flat[48:68] = mouth_outline(rng)
    low, high = flat[48:68, 1].min(), flat[48:68, 1].max()
    top, end = flat[33, 1] - 0.004 - high, -0.85 * clay.radii[1] - low
    flat[48:68, 1] += max(top - rng.uniform(0, 1) ** 1.3 * max(top - end, 0.0), end)
    return flat


def eye_outline(middle: np.ndarray, wide: float, high: float) -> np.ndarray:
    """Six points around an eye in iBUG's order."""
    angles = np.radians([180, 125, 55, 0, -55, -125])
    outline = np.stack([wide * np.cos(angles), high * np.sin(angles)], 1)
    return middle + outline


def mouth_outline(rng: np.random.Generator) -> np.ndarray:
    """Twenty points around a mouth at the origin, with any width, smile, lips and opening."""
    wide = 0.025 * np.exp(rng.normal(-0.15, 0.5))
    lips, smile = rng.uniform(0.1, 0.7, 2) * min(wide, 0.02), rng.normal(0.1, 0.3)
    gape = rng.uniform(0.1, 1.3) * wide if rng.random() < 0.3 else 0.0
    x = np.array([-1, -0.67, -0.29, 0, 0.29, 0.67, 1, 0.71, 0.41, 0, -0.41, -0.71])
    inner = np.array([-0.87, -0.4, 0, 0.4, 0.87, 0.42, 0, -0.42])
    arch = np.sqrt(np.maximum(1 - np.r_[x, inner] ** 2, 0))
    above = np.r_[np.ones(7), -np.ones(5), np.ones(5), -np.ones(3)]
    above[[0, 6, 12, 16]] = 0
    thick = np.r_[np.full(7, lips[0]), np.full(5, lips[1]), np.full(8, 0.0004)]
    y = above * arch * (thick + 0.5 * gape) + smile * wide * (np.r_[x, inner] ** 2 - 0.3)
    return np.stack([wide * np.r_[x, inner], y], 1)


def jaw_outline(clay: Clay) -> np.ndarray:
    """Seventeen points near the edge of the front, in the directions of a human jaw line."""
    d = canonical_landmarks()[:17, :2] / [0.078, 0.108]
    reach = (np.abs(d) ** clay.power).sum(1, keepdims=True) ** (1 / clay.power)
    return 0.95 * d / reach * clay.radii[:2]


def add_muzzle(rng: np.random.Generator, clay: Clay, flat: np.ndarray) -> None:
    """Adds a snout, a plate or a tall column that carries the mouth, with or without the nose."""
    mouth = flat[48:68]
    top = flat[33, 1] if rng.random() < 0.6 else flat[29, 1]
    low = min(mouth[:, 1].min() - 0.006, -rng.uniform(0.5, 0.95) * clay.radii[1])
    centre, high = [0, 0.5 * (top + low)], 0.5 * (top - low) * rng.uniform(0.9, 1.2)
    wide = np.ptp(mouth[:, 0]) * rng.uniform(0.45, 1.2) + rng.uniform(0.003, 0.02)
    out, hard = rng.uniform(0.008, 0.06), rng.uniform(0.1, 0.6)

    def height(xy: np.ndarray) -> np.ndarray:
        return out * (1 - ramp(radius_of(xy, centre, wide, high), 1 - hard, 1 + hard))

    clay.heights.append(height)


def add_eyes(rng: np.random.Generator, clay: Clay, flat: np.ndarray) -> None:
    """Adds sockets, bulges, raised rims or lids around both eyes."""
    kinds = ["bulge", "socket", "rim", "bulge", "lids", "goggle"]
    kind = rng.choice(kinds, p=[0.1, 0.2, 0.3, 0.15, 0.15, 0.1])
    depth, width, gap = rng.uniform(0.004, 0.02), rng.uniform(0.12, 0.4), rng.uniform(1.05, 1.5)
    for middle, wide, high in adorn.eyes_of(flat):

        def socket(xy, middle=middle, wide=wide, high=high):
            return -depth * (1 - ramp(radius_of(xy, middle, wide, high), 0.6, 1.1))

        def rim(xy, middle=middle, wide=wide, high=high):
            r = radius_of(xy, middle, wide, high)
            return depth * np.exp(-(((r - gap) / width) ** 2))

        def bulge(xy, middle=middle, wide=wide, high=high):
            r = radius_of(xy, middle, wide, high)
            return depth * np.sqrt(np.maximum(1 - r**2, 0)) - 0.3 * depth * (r < 1.15) * (r > 1)

        clay.heights += {"socket": [socket], "rim": [rim, socket], "bulge": [bulge]}.get(kind, [rim, bulge])
    if kind == "goggle":
        mask = flat[36:48].mean(0), 0.6 * np.ptp(flat[36:48, 0]), rng.uniform(0.8, 2) * np.ptp(flat[36:48, 1])
        step = rng.uniform(0.003, 0.012)
        clay.heights.append(lambda xy: step * (1 - ramp(radius_of(xy, *mask), 0.85, 1.2)))


def add_brows(rng: np.random.Generator, clay: Clay, flat: np.ndarray) -> None:
    """Adds ridges along the brows."""
    out, wide = rng.uniform(0.001, 0.012), rng.uniform(0.002, 0.008)
    for brow in (slice(17, 22), slice(22, 27)):
        clay.heights.append(
            lambda xy, brow=brow: out * np.exp(-((line_distance(xy, flat[brow]) / wide) ** 2))
        )


def add_nose(rng: np.random.Generator, clay: Clay, flat: np.ndarray) -> None:
    """Adds a knob as the nose, at times with a bridge that rises to it, or with nostrils."""
    tip, out = flat[30], rng.uniform(0.004, 0.03)
    wide = max(0.5 * np.ptp(flat[31:36, 0]), 0.004) * rng.uniform(0.7, 1.3)
    high = max(abs(flat[30, 1] - flat[33, 1]), 0.004) * rng.uniform(0.6, 1.2)
    clay.heights.append(lambda xy: out * np.exp(-0.5 * radius_of(xy, tip, wide, high) ** 2))
    if rng.random() < 0.5:
        ridge = np.stack([flat[27], flat[30]])
        rise = out * rng.uniform(0.3, 0.9)

        def bridge(xy: np.ndarray) -> np.ndarray:
            share = ramp(ridge[0, 1] - xy[:, 1], 0.0, max(ridge[0, 1] - ridge[1, 1], 1e-3))
            return rise * share * np.exp(-((line_distance(xy, ridge) / (0.7 * wide)) ** 2))

        clay.heights.append(bridge)
    if rng.random() < 0.4:
        for x in (flat[32, 0], flat[34, 0]):
            hole = [x, 0.5 * (flat[30, 1] + flat[33, 1])], 0.35 * wide, 0.3 * high
            clay.heights.append(lambda xy, hole=hole: -0.5 * out * (radius_of(xy, *hole) < 1))


def add_mouth(rng: np.random.Generator, clay: Clay, flat: np.ndarray) -> None:
    """Adds the mouth: a dented line, at times lips around it, and a hole if it gapes."""
    line = np.stack([flat[48], flat[60], *(0.5 * (flat[61:64] + flat[[67, 66, 65]])), flat[64], flat[54]])
    lip = 0.5 * np.ptp(flat[[51, 57], 1])
    gape = flat[62, 1] - flat[66, 1]
    deep, wide = rng.uniform(0.002, 0.01), max(rng.uniform(0.15, 0.5) * lip, 0.0015)
    if rng.random() < 0.6:
        out = rng.uniform(0.1, 0.8) * lip
        clay.heights.append(lambda xy: out * np.exp(-((line_distance(xy, line) / lip) ** 4)))
    clay.heights.append(lambda xy: -deep * np.exp(-((line_distance(xy, line) / wide) ** 2)))
    if gape > 0.002:
        middle, half = flat[[62, 66]].mean(0), 0.5 * np.ptp(flat[60:68, 0])
        hole = rng.uniform(0.3, 1.5) * gape
        clay.heights.append(lambda xy: -hole * (1 - ramp(radius_of(xy, middle, half, 0.5 * gape), 0.8, 1.05)))


def clay_of(rng: np.random.Generator) -> Clay:
    """A bare head: a ball, an egg or a box, broad or tall. Its chin is narrower or wider than its crown."""
    radii = np.array([0.078, 0.108, 0.09]) * np.exp(rng.normal(0, [0.22, 0.15, 0.2]))
    power = float(rng.choice([2.0, 2.5, 4.0, 8.0], p=[0.5, 0.2, 0.2, 0.1]))
    return Clay(radii, power, float(np.exp(rng.normal(-0.15, 0.3))), rng.uniform(-0.03, 0.03))


def character(rng: np.random.Generator) -> Head:
    """One head with all, or most, of its features."""
    clay = clay_of(rng)
    flat = layout(rng, clay)
    for add, chance in (
        (add_muzzle, 0.5),
        (add_eyes, 0.95),
        (add_brows, 0.45),
        (add_nose, 0.7),
        (add_mouth, 1.0),
    ):
        if rng.random() < chance:
            add(rng, clay, flat)
    points, triangles = clay.bare()
    jaw = clay.over(jaw_outline(clay))
    landmarks = np.concatenate([jaw, clay.over(flat[17:])])
    shift = [0, 0, -0.02]
    head = Head(clay.raised(points) + shift, triangles, clay.raised(landmarks) + shift)
    return stuck_on(rng, head)


STUCK_ON = ((adorn.eyeballs, 0.6), (adorn.rims, 0.25), (adorn.brows, 0.25), (adorn.side_ears, 0.5))


def stuck_on(rng: np.random.Generator, head: Head) -> Head:
    """Sticks separate shapes on a clay head: balls as eyes and nose, rims, bars as brows, ears, lips."""
    for add, chance in STUCK_ON:
        if rng.random() < chance:
            head = add(rng, head)
    if rng.random() < 0.25:
        marks = head.landmarks
        head = adorn.glued(head, [adorn.ellipsoid(marks[[30, 33]].mean(0), rng.uniform(0.004, 0.018, 3), 8)])
    if rng.random() < 0.15:
        head = adorn.glued(head, adorn.mouth_on(rng, head.landmarks))
    return head
