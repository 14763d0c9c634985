"""The default decoder: per-vertex weights over the 68 landmarks, fixed for a mesh.

Mirrors `rust-core/src/deform/static_weights.rs`. Attributes have the names of its layers.

    dV = W dL + alpha f (A dL + B C dL)

W are the training-free weights of `training.deform.tension_screened_biharmonic`; A [V, N] mixes
landmarks as W does, and B [V, 3, R] with C [R, 3N] lets axes mix (an opening jaw pushes the lip
back). `f` is the familiarity. The network knows two kinds of faces and takes their habits for
laws, which harms any other kind. So the correction counts only as far as the 68 landmarks of the
neutral face resemble those of the faces it learned. A and B come from a network on features that
relate each vertex to the landmarks. It is pointwise, because a DiffusionNet measured no better here.
It runs on the mesh and on its mirror image. The average makes a symmetric face move symmetrically.

Lengths are decimetres in the canonical frame. Shapes: `V` vertices, `T` frames, `N` = 68, `R` rank.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor, nn

from training.corpus.mirror import permutation
from training.nn.config import Config

LANDMARKS = 68
CORRECTION_SCALE = 0.1
"""Outputs of the network are multiplied by this, so that training starts near zero."""

FADED_AT = 3.0
"""At this remoteness the correction has faded to nothing. Up to one less it is full."""

KNOWN, UNKNOWN = 0.9, 1.3
"""Distances of a face from the learned faces (`strangeness`).

Up to the first a face is fully familiar. From the second on only `floor` of the correction is left.
95 % of unseen identities and warps lie below 0.75. A face of another kind lies at 1.45 or more.
"""

SHAPE_NOISE_DM = 0.007
"""Standard deviation of the error in each coordinate of a landmark."""


@dataclass(frozen=True)
class StaticConfig(Config):
    """Sizes; saved beside the weights as config.json.

    kinds: number of kinds of faces learned. shape_modes: number K of shape modes of each kind's landmarks.
    floor: share of the correction that is left on a face of another kind.
    """

    width: int = 128
    rank: int = 12
    kinds: int = 2
    shape_modes: int = 64
    floor: float = 0.2


CONFIGS = {"static": StaticConfig(), "debug": StaticConfig(8, 2, 2, 3, 0.3)}

FEATURES = 3 + 3 * LANDMARKS + LANDMARKS + LANDMARKS + 1


MIRROR = torch.from_numpy(permutation())
"""For each iBUG landmark, the number of its mirror image on the other side. [N]."""
FLIP = torch.tensor([-1.0, 1.0, 1.0])


@dataclass
class VertexGeometry:
    """The network's input: geometry of the vertices.

    positions: [V, 3] dm. landmarks: [N, 3] dm, of the neutral mesh. base: [V, N], the training-free weights.
    remoteness: [V], surface distance to a landmark divided by its reach, least over the landmarks.
    """

    positions: Tensor
    landmarks: Tensor
    base: Tensor
    remoteness: Tensor

    def mirrored(self) -> VertexGeometry:
        """The same geometry in a mirror: x changes sign, left and right landmarks swap numbers."""
        return VertexGeometry(
            self.positions * FLIP.to(self.positions.device),
            self.landmarks[MIRROR] * FLIP.to(self.positions.device),
            self.base[:, MIRROR],
            self.remoteness,
        )

    def to(self, device: torch.device) -> VertexGeometry:
        """The same geometry on another device."""
        return VertexGeometry(*(value.to(device) for value in vars(self).values()))

    def features(self) -> Tensor:
        """Position, offset from and distance to each landmark, base weights, nearness. [V, 344]."""
        offsets = self.positions[:, None] - self.landmarks
        distances = offsets.norm(dim=-1)
        nearness = torch.exp(-self.remoteness)[:, None]
        return torch.cat([self.positions, offsets.flatten(1), distances, self.base, nearness], dim=1)


class StaticWeights(nn.Module):
    """The network behind A, B and C."""

    def __init__(self, config: StaticConfig):
        super().__init__()
        self.config = config
        w = config.width
        self.layer_0 = nn.Linear(FEATURES, w)
        self.layer_1 = nn.Linear(w, w)
        self.layer_2 = nn.Linear(w, w)
        self.mix = nn.Linear(w, LANDMARKS)
        self.cross = nn.Linear(w, 3 * config.rank)
        self.motion = nn.Linear(3 * LANDMARKS, config.rank, bias=False)
        self.register_buffer("feature_mean", torch.zeros(FEATURES))
        self.register_buffer("feature_scale", torch.ones(FEATURES))
        self.register_buffer("shape_mean", torch.zeros(config.kinds, 3 * LANDMARKS))
        shape_basis = torch.zeros(config.kinds, config.shape_modes, 3 * LANDMARKS)
        self.register_buffer("shape_basis", shape_basis)
        for layer in (self.mix, self.cross):
            nn.init.zeros_(layer.weight)
            nn.init.zeros_(layer.bias)

    def learn_shapes(self, kind: int, shapes: Tensor) -> None:
        """Learns one kind of face from the landmarks of its neutral faces, [S, N, 3] dm.

        With principal axes u_k and variances l_k, the Mahalanobis distance under noise s is
        |x|²/s² - sum_k (w_k u_k·x)²/s², w_k² = l_k / (l_k + s²); the rows of the basis are w_k u_k.
        """
        rows = shapes.flatten(1)
        self.shape_mean[kind] = rows.mean(0)
        _, singular, axes = torch.linalg.svd(rows - rows.mean(0), full_matrices=False)
        variance = singular[: self.config.shape_modes].square() / len(rows)
        weight = (variance / (variance + SHAPE_NOISE_DM**2)).sqrt()
        self.shape_basis[kind] = weight[:, None] * axes[: self.config.shape_modes]

    def strangeness(self, landmarks: Tensor) -> float:
        """Distance from the nearest kind, about 0.5 for faces of that kind. landmarks: [N, 3] dm."""
        x = landmarks.flatten() - self.shape_mean
        explained = torch.einsum("ckn,cn->ck", self.shape_basis, x).square().sum(1)
        squared = (x.square().sum(1) - explained).clamp(min=0.0) / SHAPE_NOISE_DM**2
        return (squared.min() / x.shape[1]).sqrt().item()

    def familiarity(self, landmarks: Tensor) -> float:
        """`f`, from `floor` to 1. landmarks: [N, 3] dm, of the neutral face."""
        near = (UNKNOWN - self.strangeness(landmarks)) / (UNKNOWN - KNOWN)
        return self.config.floor + (1.0 - self.config.floor) * min(max(near, 0.0), 1.0)

    def one_sided(self, geometry: VertexGeometry) -> tuple[Tensor, Tensor]:
        """A [V, N] and B [V, 3, R], not averaged with the mirror image."""
        x = (geometry.features() - self.feature_mean) / self.feature_scale
        for layer in (self.layer_0, self.layer_1, self.layer_2):
            x = torch.nn.functional.silu(layer(x))
        scale = CORRECTION_SCALE * (FADED_AT - geometry.remoteness).clamp(0.0, 1.0)[:, None]
        cross = (scale * self.cross(x)).unflatten(1, (3, self.config.rank))
        return scale * self.mix(x), cross

    def one_sided_correction(self, geometry: VertexGeometry, landmarks: Tensor) -> Tensor:
        """`A dL + B C dL`, not averaged with the mirror image.

        landmarks: [T, N, 3]. Returns [T, V, 3], same unit.
        """
        mix, cross = self.one_sided(geometry)
        motion = self.motion(landmarks.flatten(1))
        return torch.einsum("vn,tnx->tvx", mix, landmarks) + torch.einsum("vxr,tr->tvx", cross, motion)

    def forward(self, geometry: VertexGeometry, landmarks: Tensor) -> Tensor:
        """The correction, averaged with the mirror image. landmarks: [T, N, 3]. Returns [T, V, 3]."""
        direct = self.one_sided_correction(geometry, landmarks)
        reflected = self.one_sided_correction(geometry.mirrored(), landmarks[:, MIRROR] * FLIP)
        return 0.5 * (direct + reflected * FLIP)


def deform(model: StaticWeights, geometry: VertexGeometry, landmarks: Tensor, learned: float) -> Tensor:
    """Displacement of every vertex. learned: 0 training-free, 1 as shipped. Returns [T, V, 3]."""
    base = torch.einsum("vn,tnx->tvx", geometry.base, landmarks)
    return base + learned * model.familiarity(geometry.landmarks) * model(geometry, landmarks)
