"""Names of the shapes, their mirror images, and what each does to the 68 landmarks.

Shapes: `S` = 51 shapes with motion of skin (`faces.CHANNELS`), `N` = 68 landmarks.
"""

import numpy as np

from training.corpus.faces import CHANNELS, Face
from training.deform.static_weights import MIRROR


def mirrored_name(name: str) -> str:
    """`mouthSmileLeft` for `mouthSmileRight`; a shape of both sides keeps its name."""
    if name.endswith("Left"):
        return name.removesuffix("Left") + "Right"
    if name.endswith("Right"):
        return name.removesuffix("Right") + "Left"
    return name


SHAPE_MIRROR = np.array([CHANNELS.index(mirrored_name(name)) for name in CHANNELS])
"""For each shape, the number of its mirror image, [S]."""


def symmetrised(motion: np.ndarray) -> np.ndarray:
    """Mean of each shape and the mirrored motion of its counterpart. motion: [S, N, 3]."""
    reflected = motion[SHAPE_MIRROR][:, MIRROR.numpy()] * [-1.0, 1.0, 1.0]
    return 0.5 * (motion + reflected)


def templates(faces: list[Face]) -> np.ndarray:
    """Landmark motion of each shape: mean of faces in the canonical frame. [S, N, 3] m."""
    return symmetrised(np.mean([face.modes[:, face.landmarks] for face in faces], axis=0))
