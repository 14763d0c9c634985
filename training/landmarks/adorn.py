"""Things that characters wear or carry in their faces.

Stuck-on eyes, thick rims, brows, glasses, beards, hair over the brow, ears at the sides, muzzles, and
features melted away. Every function takes a head with true landmarks and returns a head whose landmarks
are still true: it places closed shapes at landmarks, or moves landmarks with the surface. Lengths are
canonical metres.
"""

import numpy as np
import scipy.sparse as sp
from scipy.spatial import cKDTree

from training.landmarks.render import come_out
from training.landmarks.samples import Head, ellipsoid
from training.landmarks.stylise import EYES, glued, limb

BROWS = (slice(17, 22), slice(22, 27))


def tube(path: np.ndarray, radius, closed: bool, steps: int = 7) -> tuple[np.ndarray, np.ndarray]:
    """A tube along `path` `[n, 3]`: points and triangles.

    `radius` is one number, or two: in the face's plane and out of it.
    """
    ahead, behind = np.roll(path, -1, 0), np.roll(path, 1, 0)
    if not closed:
        ahead[-1], behind[0] = path[-1], path[0]
    along = ahead - behind
    along /= np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-9)
    across = np.cross(along, [0.0, 0.0, 1.0])
    across /= np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-9)
    out = np.cross(across, along)
    wide, high = np.broadcast_to(radius, 2)
    angle = np.linspace(0, 2 * np.pi, steps, endpoint=False)[:, None, None]
    points = path + wide * np.cos(angle) * across + high * np.sin(angle) * out
    count = len(path)
    i, k = np.meshgrid(np.arange(steps), np.arange(count if closed else count - 1), indexing="ij")
    a, b = i * count + k, i * count + (k + 1) % count
    c, d = (i + 1) % steps * count + k, (i + 1) % steps * count + (k + 1) % count
    triangles = np.stack([np.stack([a, b, c], -1), np.stack([b, d, c], -1)]).reshape(-1, 3)
    return points.reshape(-1, 3), triangles.astype(np.int32)


def box(centre, half) -> tuple[np.ndarray, np.ndarray]:
    """A box: points and triangles."""
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], float)
    quads = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    triangles = [[q[0], q[i], q[i + 1]] for q in quads for i in (1, 2)]
    return corners * half + np.asarray(centre), np.array(triangles, np.int32)


def ring(centre, wide: float, high: float, steps: int = 20) -> np.ndarray:
    """An upright ellipse, `[steps, 3]`."""
    angle = np.linspace(0, 2 * np.pi, steps, endpoint=False)
    flat = np.stack([wide * np.cos(angle), high * np.sin(angle), 0 * angle], 1)
    return np.asarray(centre) + flat


def eyes_of(marks: np.ndarray) -> list[tuple[np.ndarray, float, float]]:
    """Centre, half width and half height of each eye's outline. Eyes that meet count as a single one."""
    both = np.linalg.norm(marks[39] - marks[42]) < 1e-6
    out = []
    for eye in [slice(36, 48)] if both else EYES:
        spread = 0.5 * np.ptp(marks[eye], axis=0)
        out.append((marks[eye].mean(0), float(spread[0]), float(spread[1])))
    return out


def eyeballs(rng: np.random.Generator, head: Head) -> Head:
    """Balls, buttons or eggs stuck on or set into both eyes, sometimes with a pupil that stands out.

    Where the balls cover landmarks of the eyes, the landmarks move out to them.
    """
    extra, marks = [], head.landmarks
    grown, tall, deep = rng.uniform(0.75, 1.25), rng.uniform(0.75, 1.3), rng.uniform(0.25, 1.1)
    sunk, pupil = rng.uniform(-0.7, 0.4), rng.random() < 0.3
    for centre, wide, _ in eyes_of(head.landmarks):
        radii = wide * grown * np.array([1, tall, deep])
        centre = centre + [0, 0, sunk * radii[2]]
        extra.append(ellipsoid(centre, radii, int(rng.integers(5, 12))))
        marks = come_out(marks, slice(36, 48), extra[-1:])
        if pupil:
            front = centre + [0, 0, 0.95 * radii[2]]
            extra.append(ellipsoid(front, radii * [0.4, 0.4, 0.2], 6))
    return glued(Head(head.points, head.triangles, marks), extra)


def rims(rng: np.random.Generator, head: Head) -> Head:
    """Thick raised rims around the eyes."""
    gap, thick, flat = rng.uniform(1.1, 1.5), rng.uniform(0.15, 0.5), rng.uniform(0.5, 1.3)
    extra = []
    for centre, wide, high in eyes_of(head.landmarks):
        high = max(high, wide * rng.uniform(0.5, 1.0))
        path = ring(centre, gap * wide, gap * high, int(rng.integers(7, 20)))
        extra.append(tube(path, (thick * wide, flat * thick * wide), True, 6))
    marks = come_out(head.landmarks, slice(36, 48), extra)
    return glued(Head(head.points, head.triangles, marks), extra)


def brows(rng: np.random.Generator, head: Head) -> Head:
    """Bars as brows, thin to bushy. Sometimes one bar spans both."""
    thick = rng.uniform(0.0015, 0.007)
    path = head.landmarks[17:27] + [0, 0, rng.uniform(-0.3, 0.8) * thick]
    if rng.random() < 0.1:
        return glued(head, [tube(path, (thick, thick), False, 5)])
    return glued(head, [tube(path[side], (thick, thick), False, 5) for side in (slice(0, 5), slice(5, 10))])


def glasses(rng: np.random.Generator, head: Head) -> Head:
    """Glasses with round or square frames, sometimes with lenses that hide the eyes."""
    marks, extra, thick = head.landmarks, [], rng.uniform(0.0012, 0.004)
    gap, out = rng.uniform(1.15, 1.6), rng.uniform(0.006, 0.018)
    front = marks[36:48, 2].max() + out
    corners, lens = int(rng.choice([4, 6, 24])), rng.random() < 0.35
    hinges, inner = [], []
    for side, eye in zip((-1, 1), EYES, strict=True):
        centre, wide = marks[eye].mean(0), 0.5 * np.ptp(marks[eye][:, 0])
        radius = min(gap * wide, 0.47 * abs(marks[36:42, 0].mean() - marks[42:48, 0].mean()))
        middle = [centre[0], centre[1], front]
        path = ring(middle, radius, radius * rng.uniform(0.7, 1.0), corners)
        extra.append(tube(path, thick, True, 5))
        hinges.append(np.add(middle, [side * radius, 0, 0]))
        inner.append(np.subtract(middle, [side * radius, 0, 0]))
        if lens:
            extra.append(ellipsoid(middle, [radius, radius * 0.85, 0.002], 8))
            marks = come_out(marks, eye, extra[-1:])
    extra.append(tube(np.array(inner), thick, False, 5))
    extra += [tube(np.array([p, p - [0, 0, 0.09]]), thick, False, 5) for p in hinges]
    return glued(Head(head.points, head.triangles, marks), extra)


def beard(rng: np.random.Generator, head: Head) -> Head:
    """A long or short beard of lumps along the jaw, sometimes with a moustache. The lips stay free."""
    marks, extra = head.landmarks, []
    size, long = rng.uniform(0.012, 0.024), rng.uniform(0.5, 3.0)
    for i in range(int(rng.integers(0, 4)), 9):
        for mark in {i, 16 - i}:
            drop = size * long * rng.uniform(0.3, 1.0) * (0.4 + 0.6 * i / 8)
            centre = marks[mark] * [0.93, 1, 1] + [0, -0.4 * drop, 0.3 * size]
            extra.append(ellipsoid(centre, [size, size + 0.6 * drop, size], 6))
    if rng.random() < 0.6:
        thick = rng.uniform(0.15, 0.45) * np.linalg.norm(marks[33] - marks[51])
        middle = 0.5 * (marks[33] + marks[51]) * [0, 1, 1]
        half = (marks[54] - marks[48]) * [0.5 * rng.uniform(0.7, 1.3), 0, 0]
        down = [0, -rng.uniform(0, 1.5) * thick, -2 * thick]
        path = np.array([middle - half + down, middle, middle + half + down])
        extra.append(tube(path + [0, 0, 0.5 * thick], thick, False, 6))
    return glued(head, extra)


def fringe(rng: np.random.Generator, head: Head) -> Head:
    """Hair that falls over the brow, in strands or in one piece. The eyes stay free."""
    marks, extra = head.landmarks, []
    high = marks[[36, 39, 42, 45, 37, 44], 1].max()
    low = high + rng.uniform(0.0, 0.7) * (marks[17:27, 1].mean() - high) + 0.002
    width = 1.1 * np.abs(marks[17:27, 0]).max()
    top = low + rng.uniform(0.04, 0.08)
    front, side = marks[17:27, 2].max() + 0.005, marks[[17, 26], 2].mean()
    for x in np.linspace(-1, 1, int(rng.integers(4, 10))):
        z = front + (side - front) * x * x + 0.006
        foot = [x * width, low + rng.uniform(-0.002, 0.012), z]
        tip = [x * width * 0.7, top, z - 0.035]
        extra.append(limb(rng, foot, tip, rng.uniform(0.008, 0.018)))
    return glued(head, extra)


def side_ears(rng: np.random.Generator, head: Head) -> Head:
    """Large ears at the sides: plates or balls, some with a raised rim."""
    extra, reach = [], np.abs(head.landmarks[:17, 0]).max()
    wide, high = rng.uniform(0.015, 0.05), rng.uniform(0.02, 0.06)
    up, back = rng.uniform(-0.03, 0.06), rng.uniform(-0.06, 0.02)
    flat, rimmed = rng.uniform(0.1, 0.6), rng.random() < 0.5
    for side in (-1, 1):
        centre = np.array([side * (reach + 0.7 * wide), up, back])
        extra.append(ellipsoid(centre, [wide, high, flat * wide], int(rng.integers(5, 12))))
        if rimmed:
            path = ring(centre, wide, high, 12)
            extra.append(tube(path, flat * wide * rng.uniform(0.5, 1.0) + 0.002, True, 5))
    return glued(head, extra)


def muzzle(rng: np.random.Generator, head: Head) -> Head:
    """A snout stuck on over nose and mouth. Landmarks under it move out to its surface."""
    marks = head.landmarks.copy()
    region = np.r_[30:36, 48:68]
    low, high = marks[region].min(0), marks[region].max(0)
    middle = 0.5 * (low + high)
    radii = 0.5 * (high - low) * rng.uniform([1.3, 1.15, 0], [2.0, 1.6, 0])
    radii[2], middle[2] = rng.uniform(0.015, 0.06), marks[region, 2].mean() - 0.01
    power = rng.choice([2.0, 2.0, 4.0])
    points, triangles = ellipsoid([0, 0, 0], [1, 1, 1], 30)
    points /= (np.abs(points) ** power).sum(1, keepdims=True) ** (1 / power)
    flat = np.abs((marks[region, :2] - middle[:2]) / radii[:2]) ** power
    depth = radii[2] * np.maximum(1 - flat.sum(1), 0.0) ** (1 / power)
    out = middle[2] + depth > marks[region, 2]
    marks[region, 2] = np.maximum(marks[region, 2], middle[2] + depth)
    head = Head(head.points, head.triangles, marks)
    extra = [(points * radii + middle, triangles)]
    if out[6:].mean() > 0.5:
        extra += mouth_on(rng, marks)
    if rng.random() < 0.7:
        extra.append(ellipsoid(marks[30:36].mean(0), rng.uniform(0.005, 0.018, 3), 8))
    return glued(head, extra)


def mouth_on(rng: np.random.Generator, marks: np.ndarray) -> list:
    """The mouth drawn as raised lips: one line from corner to corner, or a ring around it."""
    thick = 0.5 * max(np.ptp(marks[48:60, 1]) * 0.3, 0.0015) * rng.uniform(0.6, 1.2)
    if rng.random() < 0.5:
        return [tube(marks[[48, 60, 61, 62, 63, 64, 54]], thick, False, 6)]
    inner = marks[[60, 61, 61, 62, 63, 63, 64, 65, 65, 66, 67, 67]]
    return [tube(0.5 * (marks[48:60] + inner), thick, True, 6)]


def melted(rng: np.random.Generator, head: Head, centre: np.ndarray, sigma: float) -> Head:
    """Smooths the surface around `centre` until the feature there is gone. Landmarks move with it."""
    t, near = head.triangles, np.exp(-0.5 * ((head.points - centre) ** 2).sum(1) / sigma**2)
    edges = np.concatenate([t[:, [0, 1]], t[:, [1, 2]], t[:, [2, 0]]])
    edges = np.concatenate([edges, edges[:, ::-1]])
    links = sp.csr_matrix((np.ones(len(edges)), edges.T), (len(near), len(near)))
    degree = np.maximum(np.asarray(links.sum(1)).ravel(), 1)
    mean, share = sp.diags(1 / degree) @ links, (near * (degree > 1))[:, None]
    points = head.points
    for _ in range(int(rng.integers(80, 200))):
        points = points + share * (mean @ points - points)
    used = np.unique(t)
    rider = used[cKDTree(head.points[used]).query(head.landmarks)[1]]
    return Head(points, t, head.landmarks + (points - head.points)[rider])
