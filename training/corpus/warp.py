"""Smooth warps of space that make stylised and caricature heads, with their motion.

The warp's Jacobian transforms the motion, so a warped face still moves linearly in its channels.
"""

from dataclasses import dataclass, replace

import numpy as np

from training.corpus.faces import Face, align


@dataclass(frozen=True)
class Warp:
    """`x -> A x + sum_k d_k exp(-|x - c_k|^2 / 2 s_k^2)`.

    linear: [3, 3]. centres, offsets: [K, 3] m. widths: [K] m.
    """

    linear: np.ndarray
    centres: np.ndarray
    offsets: np.ndarray
    widths: np.ndarray

    def points(self, x: np.ndarray) -> np.ndarray:
        """x: [V, 3] m. Returns [V, 3] m."""
        return x @ self.linear.T + self._bumps(x) @ self.offsets

    def jacobians(self, x: np.ndarray) -> np.ndarray:
        """dy/dx at each point. x: [V, 3] m. Returns [V, 3, 3]."""
        slope = -(x[:, None] - self.centres) * (self._bumps(x) / self.widths**2)[:, :, None]
        return self.linear + np.einsum("ki,vkj->vij", self.offsets, slope)

    def _bumps(self, x: np.ndarray) -> np.ndarray:
        squared = ((x[:, None] - self.centres) ** 2).sum(-1)
        return np.exp(-0.5 * squared / self.widths**2)


def random_warp(rng: np.random.Generator, strength: float) -> Warp:
    """Bumps of 2 to 6 cm and a stretch; strength 1 is a strong caricature, 0 changes nothing.

    Half of the warps are mirror-symmetric.
    """
    count = 10
    centres = rng.uniform([-0.08, -0.12, -0.02], [0.08, 0.10, 0.10], (count, 3))
    widths = rng.uniform(0.02, 0.06, count)
    offsets = strength * rng.normal(size=(count, 3)) * 0.28 * widths[:, None]
    if rng.random() < 0.5:
        mirror = np.array([-1.0, 1.0, 1.0])
        centres, offsets = np.r_[centres, centres * mirror], np.r_[offsets, offsets * mirror] * 0.7
        widths = np.r_[widths, widths]
    stretch = np.exp(strength * 0.18 * rng.normal(size=3))
    shear = strength * 0.05 * rng.normal(size=(3, 3))
    return Warp(np.diag(stretch) + shear, centres, offsets, widths)


def is_gentle(warp: Warp, x: np.ndarray) -> bool:
    """Whether the warp neither folds nor flattens space at any of the points [V, 3]."""
    singular = np.linalg.svd(warp.jacobians(x), compute_uv=False)
    upright = np.linalg.det(warp.jacobians(x)).min() > 0.0
    return bool(upright and singular.min() > 0.4 and singular.max() < 2.2)


def apply(warp: Warp, face: Face) -> Face:
    """The warped face, back in the canonical frame."""
    modes = np.einsum("vij,mvj->mvi", warp.jacobians(face.vertices), face.modes)
    return align(replace(face, vertices=warp.points(face.vertices), modes=modes))


def stylise(rng: np.random.Generator, face: Face, strength: float) -> Face:
    """Warps the face at random without folding it."""
    while True:
        warp = random_warp(rng, strength)
        if is_gentle(warp, face.vertices):
            return apply(warp, face)
        strength *= 0.9
