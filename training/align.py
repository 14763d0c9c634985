"""Aligns one face to another: the canonical landmarks, how steady each is, and the best similarity."""

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch

REPOSITORY = Path(__file__).resolve().parents[1]
CANONICAL = REPOSITORY / "rust-core/src/mesh/canonical_landmarks.json"


def canonical_landmarks() -> np.ndarray:
    """The landmarks that define the canonical frame. [68, 3] m."""
    return np.array(json.loads(CANONICAL.read_text())["landmarks"])


def stability() -> np.ndarray:
    """How well each landmark tells where the head is. [68], sums to 1.

    Mirrors `stability` of `rust-core/src/mesh/canonical.rs`, so that meshes are rotated and scaled the same
    way in training and in use.
    """
    weight = np.full(68, 0.7)
    weight[:17], weight[17:27], weight[27:36], weight[36:48] = 0.15, 0.4, 1.5, 1.0
    weight[[36, 39, 42, 45]] = 2.0
    return weight / weight.sum()


def steady() -> np.ndarray:
    """`stability` of the nose and the eyes alone, [68], sums to 1. Speech does not move them."""
    weight = stability() * (np.arange(68) >= 27) * (np.arange(68) < 48)
    return weight / weight.sum()


@dataclass(frozen=True)
class Similarity:
    """p ↦ scale · R (p − centre) + goal; arrays of NumPy or PyTorch, with leading axes for a batch."""

    stretch: np.ndarray | torch.Tensor
    spread: np.ndarray | torch.Tensor
    rotation: np.ndarray | torch.Tensor
    centre: np.ndarray | torch.Tensor
    goal: np.ndarray | torch.Tensor

    @property
    def scale(self) -> np.ndarray | torch.Tensor:
        """Size of the target relative to the source; NaN where all source points coincide."""
        return self.stretch / self.spread

    def __call__(self, points):
        """Moves points [..., N, 3]."""
        scale = self.scale[..., None, None]
        return scale * (points - self.centre[..., None, :]) @ self.rotation.swapaxes(-1, -2) + self.goal


def similarity(source, target, weight=None) -> Similarity:
    """The similarity that brings `source` [..., N, 3] nearest to `target` [N, 3] (Umeyama 1991).

    `weight` [N] weighs the squared distance of every point; its sum is 1. Without it all points count alike.
    For a rigid motion, ignore the scale.
    """
    backend = torch if isinstance(source, torch.Tensor) else np
    if weight is None:
        weight = backend.ones(len(target), dtype=target.dtype) / len(target)
    weight = weight[:, None]
    centre, goal = (weight * source).sum(-2), (weight * target).sum(-2)
    moved = source - centre[..., None, :]
    u, s, vt = backend.linalg.svd((weight * (target - goal)).swapaxes(-1, -2) @ moved)
    flip = backend.ones_like(s)
    flip[..., 2] = backend.sign(backend.linalg.det(u @ vt))
    rotation = (u * flip[..., None, :]) @ vt
    return Similarity((s * flip).sum(-1), (weight * moved**2).sum((-2, -1)), rotation, centre, goal)
