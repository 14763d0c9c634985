"""Rotations of head and eyes as quaternions; no bpy.

Quaternions are (w, x, y, z); rotation vectors are axis times angle in radians.
"""

import numpy as np

# Distance to the imagined partner whom the library's gaze looks at, metres on a human-size head.
_PARTNER_M = 1.2


def of_vectors(vectors: np.ndarray) -> np.ndarray:
    """Quaternions `[T, 4]` of rotation vectors `[T, 3]`."""
    half = 0.5 * np.linalg.norm(vectors, axis=1, keepdims=True)
    # sin(x) / x, also at 0.
    share = 0.5 * np.sinc(half / np.pi)
    return np.concatenate([np.cos(half), share * vectors], axis=1)


def of_gaze(angles: np.ndarray) -> np.ndarray:
    """Rotation vectors `[T, 3]`, canonical axes, of angles `[T, 2]`: yaw to the left, pitch up."""
    zeros = np.zeros(len(angles))
    yaw = of_vectors(np.column_stack([zeros, angles[:, 0], zeros]))
    pitch = of_vectors(np.column_stack([-angles[:, 1], zeros, zeros]))
    return to_vectors(times(yaw, pitch))


def to_vectors(turns: np.ndarray) -> np.ndarray:
    """Rotation vectors `[T, 3]` of quaternions `[T, 4]`, angles within a half turn."""
    turns = turns * np.where(turns[:, :1] < 0.0, -1.0, 1.0)
    size = np.linalg.norm(turns[:, 1:], axis=1, keepdims=True)
    angle = 2.0 * np.arctan2(size, turns[:, :1])
    return turns[:, 1:] * np.where(size > 1e-12, angle / np.maximum(size, 1e-12), 2.0)


def times(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """The products `[T, 4]`, which turn by `second` and then by `first`."""
    a, b = first, second
    w = a[:, 0] * b[:, 0] - (a[:, 1:] * b[:, 1:]).sum(axis=1)
    rest = a[:, :1] * b[:, 1:] + b[:, :1] * a[:, 1:] + np.cross(a[:, 1:], b[:, 1:])
    return np.column_stack([w, rest])


def matrices(turns: np.ndarray) -> np.ndarray:
    """Rotation matrices `[T, 3, 3]` of quaternions `[T, 4]`."""
    w, x, y, z = turns.T
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return np.moveaxis(np.array(rows), 2, 0)


def angles_to(points: np.ndarray, eye: np.ndarray) -> np.ndarray:
    """Yaw to the left and pitch up `[T, 2]` from an eye `[3]` to points `[T, 3]`, all canonical."""
    x, y, z = (points - eye).T
    return np.column_stack([np.arctan2(x, z), np.arctan2(y, np.hypot(x, z))])


def to_object(gaze: np.ndarray, points: np.ndarray, eye: np.ndarray) -> np.ndarray:
    """The gaze `[T, 2]` of one eye `[3]` at points `[T, 3]` instead of the library's partner.

    All values are canonical, in metres and radians. Leaps of the eye and looks away remain.
    """
    partner = np.array([[0.0, eye[1], eye[2] + _PARTNER_M]])
    return gaze + angles_to(points, eye) - angles_to(partner, eye)
