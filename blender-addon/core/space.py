"""Maps between an object's own space and the frame in which the library sees the face.

Artists scale, mirror and turn objects. Positions therefore go to world space, where every scale,
even an uneven one, has taken effect. The library finds a face in any orientation. If several places
look like a face, it takes the one that looks along -Y with +Z up. For that case the artist may have
the object's own rotation undone.
"""

from dataclasses import dataclass

import numpy as np

from .errors import AnyfaceError

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

    def to_library(self, face) -> tuple:
        """The arrays of a `take.FaceMesh` in the frame of the library.

        Positions `[V, 3]`, triangles `[F, 3]` in their true winding, and the landmarks as positions
        `[68, 3]` and as vertex numbers `[68]`, or None where the artist has set none.
        """
        landmarks = None if face.landmarks is None else self.points(face.landmarks)
        triangles = face.triangles[:, ::-1] if self.mirrored else face.triangles
        return self.points(face.positions), triangles, landmarks, face.landmark_vertices

    def points_to_object(self, points: np.ndarray) -> np.ndarray:
        """Points `[N, 3]` back in object space, float64."""
        return (np.asarray(points, dtype=np.float64) - self.offset) @ np.linalg.inv(self.matrix).T

    def moved(self, displacements: np.ndarray) -> np.ndarray:
        """Displacements `[..., 3]` from object space, float32."""
        return (displacements @ self.matrix.T).astype(np.float32)

    def to_object(self, displacements: np.ndarray) -> np.ndarray:
        """Displacements `[..., 3]` back to object space, float32."""
        return displacements @ self.back.T

    @property
    def back(self) -> np.ndarray:
        """The matrix `[3, 3]` that takes displacements back to object space, float32."""
        return np.linalg.inv(self.matrix).astype(np.float32)

    def from_world(self, matrix_world: np.ndarray) -> np.ndarray:
        """The matrix `[4, 4]` from the world to the frame in which the library sees the face."""
        inverse = np.linalg.inv(np.asarray(matrix_world, dtype=np.float64))
        matrix = np.eye(4)
        matrix[:3, :3], matrix[:3, 3] = self.matrix, self.offset
        return matrix @ inverse

    @property
    def mirrored(self) -> bool:
        """True if the map mirrors, so that triangles change their winding."""
        return float(np.linalg.det(self.matrix)) < 0.0


def face_space(matrix_world: np.ndarray, axes: str) -> FaceSpace:
    """The map for `axes`: AUTO and WORLD, LOCAL or LOCAL_Y_UP.

    Raises `AnyfaceError("mesh")` if the object is flattened to nothing.
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


def _rotation(linear: np.ndarray) -> np.ndarray:
    """The rotation nearest to `linear` (polar decomposition).

    A mirrored object counts as mirrored from left to right, because a head mirrored this way is
    still a head.
    """
    mirror = np.diag([np.sign(np.linalg.det(linear)), 1.0, 1.0])
    left, _, right = np.linalg.svd(linear @ mirror)
    return left @ right
