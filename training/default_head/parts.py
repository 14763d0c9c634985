"""Eyes, teeth and tongue of the default head: plain shapes of ours, sized to the identity.

The ICT model's own eyeballs and teeth are only measured (place and size), never copied.
All lengths are centimetres in the ICT frame.
"""

from dataclasses import dataclass

import numpy as np

# The angles of the rings of an eye from the axis of sight. The pupil and the iris each end at a ring.
PUPIL_DEGREES, IRIS_DEGREES = 8.0, 24.0
EYE_RINGS_DEGREES = [4, PUPIL_DEGREES, 15, 20, IRIS_DEGREES, 29, 36, 45, 56, 68, 82, 98, 116, 136, 158]
EYE_SEGMENTS = 24
TEETH_STEPS, TEETH_PER_ARCH = 70, 14


@dataclass
class Part:
    """A closed shape: `points` `[V, 3]`, faces by material name."""

    name: str
    points: np.ndarray
    faces: dict[str, np.ndarray]


def fit_sphere(points: np.ndarray) -> tuple[np.ndarray, float]:
    """Least-squares sphere through points: centre and radius."""
    system = np.c_[2 * points, np.ones(len(points))]
    x = np.linalg.lstsq(system, (points**2).sum(1), rcond=None)[0]
    return x[:3], float(np.sqrt(x[3] + x[:3] @ x[:3]))


def eye(name: str, measured: np.ndarray) -> Part:
    """A sphere looking along +z. The front of `measured` (an eyeball) gives its place and size."""
    middle, _ = fit_sphere(measured)
    out = measured - middle
    angle = np.degrees(np.arccos(out[:, 2] / np.linalg.norm(out, axis=1)))
    centre, radius = fit_sphere(measured[(angle > 28) & (angle < 80)])
    rings = np.radians(EYE_RINGS_DEGREES)[:, None]
    around = np.linspace(0, 2 * np.pi, EYE_SEGMENTS, endpoint=False)[None]
    # The cornea protrudes by at most a millimetre and fades out at the edge of the iris.
    bulge = 1 + 0.05 * np.clip(1 - (rings / np.radians(IRIS_DEGREES + 4)) ** 2, 0, 1)
    grid = (
        np.stack(
            [np.sin(rings) * np.cos(around), np.sin(rings) * np.sin(around), np.cos(rings) + 0 * around], -1
        )
        * bulge[..., None]
    )
    points = np.concatenate([[[0, 0, 1.05]], grid.reshape(-1, 3), [[0, 0, -1]]]) * radius + centre
    faces = {"pupil": [], "iris": [], "eye_white": []}
    for i, degrees in enumerate([*EYE_RINGS_DEGREES, 180]):
        material = "pupil" if degrees <= PUPIL_DEGREES else "iris" if degrees <= IRIS_DEGREES else "eye_white"
        for s in range(EYE_SEGMENTS):
            t = (s + 1) % EYE_SEGMENTS
            inner, outer = 1 + (i - 1) * EYE_SEGMENTS, 1 + i * EYE_SEGMENTS
            if i == 0:
                faces[material].append([0, outer + s, outer + t])
            elif degrees == 180:
                faces[material].append([inner + s, len(points) - 1, inner + t])
            else:
                faces[material] += [[inner + s, outer + s, outer + t], [inner + s, outer + t, inner + t]]
    return Part(name, points, {k: np.array(v) for k, v in faces.items()})


def teeth(name: str, measured: np.ndarray, upper: bool) -> Part:
    """A row of teeth in its gum: a profile swept along a half ellipse and narrowed between the teeth."""
    front, back = measured[:, 2].max(), measured[:, 2].min() + 0.4
    width = np.percentile(np.abs(measured[:, 0]), 98)
    edge = np.percentile(measured[:, 1], 2 if upper else 98)
    inward = 1.0 if upper else -1.0
    # (depth behind the outer face, height above the biting edge), centimetres.
    profile = np.array(
        [
            [0.14, 0.0],
            [0.03, 0.07],
            [0.0, 0.35],
            [0.04, 0.75],
            [0.10, 0.95],
            [0.22, 1.80],
            [0.75, 1.80],
            [0.65, 0.95],
            [0.62, 0.5],
            [0.34, 0.04],
        ]
    )
    t = np.linspace(-0.5 * np.pi, 0.5 * np.pi, TEETH_STEPS + 1)
    waist = np.abs(np.cos(np.linspace(0, np.pi * TEETH_PER_ARCH, len(t))))
    points = []
    for angle, thin in zip(t, waist, strict=True):
        for depth, height in profile:
            gap = 0.10 * (1 - (1 - thin) ** 0.6) if height < 0.9 else 0.0
            inset = depth + (gap if depth < 0.3 else -gap)
            y = edge + inward * (height + 0.05 * thin * (height < 0.2))
            points.append([(width - inset) * np.sin(angle), y, back + (front - back - inset) * np.cos(angle)])
    faces = tube_faces(len(t), len(profile), upper)
    row = faces % len(profile)
    gums = ((row >= 4) & (row <= 7)).all(1)
    return Part(name, np.array(points), {"teeth": faces[~gums], "gums": faces[gums]})


def tube_faces(steps: int, ring: int, flip: bool) -> np.ndarray:
    """Triangles of a closed tube of `steps` rings with both ends capped."""
    faces = []
    for i in range(steps - 1):
        for k in range(ring):
            a, b = i * ring + k, i * ring + (k + 1) % ring
            faces += [[a, a + ring, b], [b, a + ring, b + ring]]
    last = (steps - 1) * ring
    for k in range(1, ring - 1):
        faces += [[0, k, k + 1], [last, last + k + 1, last + k]]
    faces = np.array(faces)
    return faces if flip else faces[:, ::-1]


def tongue(measured_lower_teeth: np.ndarray) -> Part:
    """A flat ellipsoid lying within the lower arch."""
    front, back = measured_lower_teeth[:, 2].max(), measured_lower_teeth[:, 2].min()
    top = np.percentile(measured_lower_teeth[:, 1], 98)
    rings, around = 9, 16
    theta = np.linspace(0, np.pi, rings + 2)[1:-1, None]
    phi = np.linspace(0, 2 * np.pi, around, endpoint=False)[None]
    unit = np.stack(
        [np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta) + 0 * phi], -1
    ).reshape(-1, 3)
    unit = np.concatenate([unit, [[0, 0, 1], [0, 0, -1]]])
    radii = np.array([1.45, 0.45, 0.5 * (front - 0.9 - back)])
    points = unit * radii + [0, top - 0.55, 0.5 * (front - 0.9 + back)]
    faces = []
    for i in range(rings - 1):
        for s in range(around):
            a, b = i * around + s, i * around + (s + 1) % around
            faces += [[a, a + around, b + around], [a, b + around, b]]
    tip, root = rings * around, rings * around + 1
    for s in range(around):
        b = (s + 1) % around
        faces += [[tip, s, b], [root, (rings - 1) * around + b, (rings - 1) * around + s]]
    return Part("tongue", points, {"tongue": np.array(faces)})
