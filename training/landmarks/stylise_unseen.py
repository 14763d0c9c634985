"""Stylised heads of kinds that never occur in training, to test the landmark finder.

Heads are swollen to balls, pressed into boxes, bent, twisted, pulled by a cage, seen through a lens, carved
in steps or waves, or exaggerated. Every warp either maps space, landmarks included, or moves vertices by
millimetres. So the landmarks of the face stay true. Lengths are canonical metres.
"""

import numpy as np

from training.landmarks.adorn import box
from training.landmarks.samples import Faces, Head, ellipsoid
from training.landmarks.stylise import EYES, glued, moved

CENTRE = np.array([0.0, 0.0, 0.0])


def turned_by(points: np.ndarray, angle: np.ndarray, first: int, second: int) -> np.ndarray:
    """Turns every point by its own angle in the plane of two axes."""
    out, c, s = points.copy(), np.cos(angle), np.sin(angle)
    out[:, first] = c * points[:, first] - s * points[:, second]
    out[:, second] = s * points[:, first] + c * points[:, second]
    return out


def balloon(rng: np.random.Generator, head: Head) -> Head:
    """Draws all distances from the centre towards one radius, like a face on a ball."""
    share, radius = rng.uniform(0.3, 0.65), 0.1

    def by(points: np.ndarray) -> np.ndarray:
        r = np.maximum(np.linalg.norm(points - CENTRE, axis=1, keepdims=True), 1e-6)
        return CENTRE + (points - CENTRE) * (radius / r) ** share

    return moved(head, by)


def boxed(rng: np.random.Generator, head: Head) -> Head:
    """Presses ellipsoids about the centre towards boxes."""
    share, power = rng.uniform(0.4, 0.9), rng.uniform(4, 10)

    def by(points: np.ndarray) -> np.ndarray:
        d = (points - CENTRE) / [0.08, 0.11, 0.09]
        radius = np.linalg.norm(d, axis=1, keepdims=True)
        flat = (np.abs(d) ** power).sum(1, keepdims=True) ** (1 / power)
        return CENTRE + (points - CENTRE) * (radius / np.maximum(flat, 1e-6)) ** share

    return moved(head, by)


def bent(rng: np.random.Generator, head: Head) -> Head:
    """Bends the head forwards, backwards or to a side."""
    side = rng.random() < 0.4
    angle = rng.uniform(2, 4 if side else 7) * rng.choice([-1, 1])
    return moved(head, lambda p: turned_by(p, angle * p[:, 1], *((0, 1) if side else (1, 2))))


def twisted(rng: np.random.Generator, head: Head) -> Head:
    """Twists the chin against the brow."""
    angle = rng.uniform(1.5, 3.5) * rng.choice([-1, 1])
    return moved(head, lambda p: turned_by(p, angle * p[:, 1], 0, 2))


def caged(rng: np.random.Generator, head: Head) -> Head:
    """Warps by a cage of 4×5×4 points, pulled at random and alike on both sides, with cubic weights."""
    low, high = np.array([-0.13, -0.16, -0.14]), np.array([0.13, 0.16, 0.14])
    shape = (4, 5, 4)
    pull = rng.normal(0, 0.02, (*shape, 3))
    pull = 0.5 * (pull + pull[::-1] * [-1, 1, 1])

    def by(points: np.ndarray) -> np.ndarray:
        at = np.clip((points - low) / (high - low), 0, 1)
        weights = []
        for axis, count in enumerate(shape):
            away = np.abs(at[:, axis, None] * (count - 1) - np.arange(count))
            w = np.where(away < 1, 2 / 3 - away**2 + away**3 / 2, np.maximum(2 - away, 0) ** 3 / 6)
            weights.append(w / w.sum(1, keepdims=True))
        return points + np.einsum("ni,nj,nk,ijkc->nc", *weights, pull)

    return moved(head, by)


def lens(rng: np.random.Generator, head: Head) -> Head:
    """Shows the face as a wide or a long lens does: with a large or a small middle."""
    near = rng.choice([rng.uniform(0.09, 0.2), -rng.uniform(0.25, 0.5)])

    def by(points: np.ndarray) -> np.ndarray:
        size = 1 / (1 - (points[:, 2:] - 0.05) / abs(near) * np.sign(near) * 0.55)
        size = np.clip(size, 0.35, 2.5)
        return points * np.concatenate([size, size, np.ones_like(size)], 1)

    return moved(head, by)


def squeezed(rng: np.random.Generator, head: Head) -> Head:
    """Crowds the features towards the brow or the chin, as on babies and brutes."""
    lean = rng.uniform(0.25, 0.55) * rng.choice([-1, 1])

    def by(points: np.ndarray) -> np.ndarray:
        y = np.clip(points[:, 1] / 0.12, -1, 1)
        return points + np.stack([0 * y, 0.12 * lean * (1 - y**2) * 0.5, 0 * y], 1)

    return moved(head, by)


def waves(rng: np.random.Generator, head: Head) -> Head:
    """Carves waves of a random direction into the surface."""
    way, size = rng.normal(size=3), rng.uniform(0.0008, 0.002)
    way *= 2 * np.pi / rng.uniform(0.012, 0.04) / np.linalg.norm(way)

    def by(points: np.ndarray) -> np.ndarray:
        d = points - CENTRE
        out = d / np.maximum(np.linalg.norm(d, axis=1, keepdims=True), 1e-6)
        return points + size * np.sin(points @ way)[:, None] * out

    return moved(head, by)


def blocks(rng: np.random.Generator, head: Head) -> Head:
    """Snaps vertices to a grid of 3 to 6 mm; the landmarks stay where the face was."""
    step = rng.uniform(0.003, 0.006)
    return Head(np.round(head.points / step) * step, head.triangles, head.landmarks)


def relief(rng: np.random.Generator, head: Head) -> Head:
    """Presses the head flat, as on a coin or a mask."""
    depth = rng.uniform(0.35, 0.6)
    return moved(head, lambda p: p * [1, 1, depth])


def cone(foot, tip, radius: float, steps: int = 10) -> tuple[np.ndarray, np.ndarray]:
    """An open cone: points and triangles."""
    foot, tip = np.asarray(foot, float), np.asarray(tip, float)
    along = (tip - foot) / np.linalg.norm(tip - foot)
    x = np.cross(along, [0.3, 0.5, 0.81])
    x /= np.linalg.norm(x)
    angle = np.linspace(0, 2 * np.pi, steps, endpoint=False)[:, None]
    rim = foot + radius * (np.cos(angle) * x + np.sin(angle) * np.cross(along, x))
    k = np.arange(steps)
    return np.concatenate([rim, tip[None]]), np.stack([k, (k + 1) % steps, 0 * k + steps], 1).astype(np.int32)


def cone_nose(rng: np.random.Generator, head: Head) -> Head:
    """Adds a carrot as the nose; the landmark of the nose tip moves to its tip."""
    marks = head.landmarks.copy()
    foot = marks[[29, 30, 33]].mean(0) - [0, 0, 0.004]
    tip = foot + [0, rng.normal(0, 0.006), rng.uniform(0.015, 0.04)]
    marks[30] = tip
    return glued(Head(head.points, head.triangles, marks), [cone(foot, tip, rng.uniform(0.007, 0.013))])


def cube_eyes(rng: np.random.Generator, head: Head) -> Head:
    """Adds blocks as eyes; the eye landmarks move out to the blocks' fronts."""
    out, marks = [], head.landmarks.copy()
    for eye in EYES:
        half, middle = 0.5 * np.ptp(marks[eye][:, 0]) * rng.uniform(0.8, 1.0), marks[eye].mean(0)
        out.append(box(middle, [half, 0.8 * half, 0.5 * half]))
        marks[eye, 2] = middle[2] + 0.5 * half
    return glued(Head(head.points, head.triangles, marks), out)


def spikes(rng: np.random.Generator, head: Head) -> Head:
    """Adds hair made of cones to the crown."""
    out = []
    for _ in range(int(rng.integers(6, 20))):
        d = rng.normal(size=3)
        d[1] = abs(d[1]) + 0.8
        d[2] -= 0.4
        d /= np.linalg.norm(d)
        foot = d * [0.07, 0.09, 0.085] + [0, 0.02, -0.01]
        out.append(cone(foot, foot + d * rng.uniform(0.03, 0.09), 0.015))
    return glued(head, out)


def eye_patch(rng: np.random.Generator, head: Head) -> Head:
    """Adds a flat patch over one eye; the eye's landmarks move out to it."""
    eye, marks = EYES[int(rng.integers(2))], head.landmarks.copy()
    middle = marks[eye].mean(0) + [0, 0, 0.008]
    half = 0.62 * np.ptp(marks[eye][:, 0])
    marks[eye, 2] = middle[2] + 0.0015
    return glued(Head(head.points, head.triangles, marks), [box(middle, [half, 0.8 * half, 0.0015])])


def tusks(rng: np.random.Generator, head: Head) -> Head:
    """Adds cones that rise from the corners of the mouth."""
    out = []
    for corner, side in ((48, -1), (54, 1)):
        foot = head.landmarks[corner] + [side * 0.002, -0.004, 0.002]
        out.append(cone(foot, foot + [side * 0.006, rng.uniform(0.015, 0.035), 0.014], 0.004))
    return glued(head, out)


def ruff(rng: np.random.Generator, head: Head) -> Head:
    """Adds a collar of plates under the chin and, half of the time, a helmet's bowl behind the face."""
    low = head.landmarks[8, 1] - 0.02
    angle = np.linspace(0, 2 * np.pi, 14, endpoint=False)
    out = [box([0.1 * np.cos(a), low, 0.1 * np.sin(a) - 0.01], [0.02, 0.006, 0.02]) for a in angle]
    if rng.random() < 0.5:
        out.append(ellipsoid([0, 0.035, -0.04], [0.1, 0.12, 0.1], 14))
    return glued(head, out)


WARPS = (balloon, boxed, bent, twisted, caged, lens, squeezed, waves, relief)
THINGS = (cone_nose, cube_eyes, spikes, eye_patch, tusks, ruff)


def unseen_head(rng: np.random.Generator, faces: Faces, held_out: np.ndarray) -> tuple[Head, list[str]]:
    """A head with one to three warps, at most two added things and sometimes blocks, and their names.

    Three heads in four are ICT identities kept out of training, exaggerated by up to 2.2. The rest are
    MakeHuman, which has only one identity.
    """
    if rng.random() < 0.75:
        coefficients = held_out[rng.integers(len(held_out))] * rng.uniform(1.0, 2.2)
        head = faces.ict_head(rng, coefficients.astype(np.float32))
    else:
        head = faces.makehuman_head(rng)
    names = []
    for warp in rng.permutation(np.array(WARPS, object))[: rng.integers(1, 4)]:
        head = warp(rng, head)
        names.append(warp.__name__)
    if rng.random() < 0.15:
        head = blocks(rng, head)
        names.append(blocks.__name__)
    for add in rng.permutation(np.array(THINGS, object))[: rng.integers(0, 3)]:
        head = add(rng, head)
        names.append(add.__name__)
    return head, names
