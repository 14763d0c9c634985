"""Swaps left and right of the 68 iBUG landmarks."""

import numpy as np

PAIRS = (
    [(i, 16 - i) for i in range(8)]
    + [(17 + i, 26 - i) for i in range(5)]
    + [(31, 35), (32, 34)]
    + [(36, 45), (37, 44), (38, 43), (39, 42), (40, 47), (41, 46)]
    + [(48, 54), (49, 53), (50, 52), (55, 59), (56, 58), (60, 64), (61, 63), (65, 67)]
)


def permutation() -> np.ndarray:
    """For each landmark [68] its partner on the other side. Landmarks on the midline map to themselves."""
    other = np.arange(68)
    for a, b in PAIRS:
        other[a], other[b] = b, a
    return other


def mirror(motion: np.ndarray) -> np.ndarray:
    """Displacements [..., 68, 3] seen in a mirror (x is the subject's left)."""
    return motion[..., permutation(), :] * np.array([-1.0, 1.0, 1.0], motion.dtype)


def symmetrise(motion: np.ndarray) -> np.ndarray:
    """Mean of a motion and its mirror image: removes a speaker's lopsidedness and some noise."""
    return 0.5 * (motion + mirror(motion))
