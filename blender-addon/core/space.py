"""Between the object's own space and the frame in which the library sees the face.

The library wants a face that looks along -Y with +Z up. Artists scale, mirror and turn objects,
so positions are taken into the world (every scale, also uneven, becomes real) and, if the face
does not look along -Y there, turned back by the object's own rotation.
"""

from dataclasses import dataclass

import numpy as np

from .errors import AnyfaceError

# In the order in which AUTO tries them.
AXES = ("WORLD", "LOCAL", "LOCAL_Y_UP")

# +Y up and +Z forward (OBJ, glTF) to +Z up and -Y forward.
_Y_UP_TO_Z_UP = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])


@dataclass
class FaceSpace:
    """An affine map from object space: `face = matrix @ object + offset`, in metres or not."""

    matrix: np.ndarray
    offset: np.ndarray

    def points(self, positions: np.ndarray) -> np.ndarray:
        """Positions `[N, 3]` from object space, float32."""
        return (positions @ self.matrix.T + self.offset).astype(np.float32)

    def to_object(self, displacements: np.ndarray) -> np.ndarray:
        """Displacements `[..., 3]` back to object space, float32."""
        inverse = np.linalg.inv(self.matrix).astype(np.float32)
        return displacements @ inverse.T

    @property
    def mirrored(self) -> bool:
        """True where triangles change their winding."""
        return float(np.linalg.det(self.matrix)) < 0.0


def face_space(matrix_world: np.ndarray, axes: str) -> FaceSpace:
    """The map for one of `AXES`.

    Raises `AnyfaceError("mesh")` where the object is flattened to nothing.
    """
    linear = np.asarray(matrix_world, dtype=np.float64)[:3, :3]
    offset = np.asarray(matrix_world, dtype=np.float64)[:3, 3]
    if not np.isfinite(linear).all() or np.linalg.cond(linear) > 1e6:
        raise AnyfaceError(
            "mesh", "the object is scaled to zero along an axis: give it a scale first"
        )
    turn = np.eye(3)
    if axes in ("LOCAL", "LOCAL_Y_UP"):
        turn = _rotation(linear).T
    if axes == "LOCAL_Y_UP":
        turn = _Y_UP_TO_Z_UP @ turn
    return FaceSpace(turn @ linear, turn @ offset)


def candidates(matrix_world: np.ndarray, axes: str) -> list[FaceSpace]:
    """The maps to try, in order, without repeating equal ones."""
    names = AXES if axes == "AUTO" else (axes,)
    found: list[FaceSpace] = []
    for name in names:
        space = face_space(matrix_world, name)
        if not any(np.allclose(space.matrix, other.matrix, atol=1e-6) for other in found):
            found.append(space)
    return found


def _rotation(linear: np.ndarray) -> np.ndarray:
    """The rotation nearest to `linear` (polar decomposition).

    A mirrored object is taken as mirrored from left to right, the way in which a head stays a
    head.
    """
    mirror = np.diag([np.sign(np.linalg.det(linear)), 1.0, 1.0])
    left, _, right = np.linalg.svd(linear @ mirror)
    return left @ right
