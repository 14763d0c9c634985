"""Makes the attention of the `paper` decoder local before training begins, and keeps it so.

With random weights every vertex attends equally to all landmarks, and the gradients of such a flat softmax
are too small to change that within a day. So in the first four channels of every head, `query · key` of eq.
13 starts as `(2 x·l - l·l) / (2 σ²)`. Up to a constant of the vertex, this is `-|x - l|² / (2 σ²)`: a
Gaussian over the landmarks around the vertex. Linear layers estimate the positions `x` from the vertex's
feature and `l` from the landmark's index. They are fitted to the training faces.

Eq. 15 alone then leads away from it: after 36,000 steps the vertices of the lips gave 46 % of their attention
to the jaw and 10 % to the lips. So `locality` draws every head back to its Gaussian while it trains.
"""

import numpy as np
import torch
import torch.nn.functional as F
from torch import Tensor

from training.nn.diffusion_net import SurfaceOperators
from training.systems.freetalk.stm.paper import PaperDecoder

PLACE = 4
"""Channels that hold a position: three coordinates and one for the term `-l·l / 2`."""
SIGMAS_DM = (0.15, 0.4)
"""σ of the first and of the last attention head in dm. The heads between form a geometric series."""
ONE_VERTEX_IN = 5
GROUPS = {
    "jaw": slice(0, 17), "brows": slice(17, 27), "nose": slice(27, 36), "eyes": slice(36, 48),
    "lips": slice(48, 68),
}  # fmt: skip
"""The landmarks of each part of the face."""


@torch.no_grad()
def attend_nearby(
    model: PaperDecoder, faces: list[tuple[Tensor, SurfaceOperators]], landmarks: Tensor
) -> None:
    """Sets φ of eq. 12, queries and keys.

    faces: vertex inputs [V, 6] dm, positions first, and operators. landmarks: mean positions [N, 3] dm.
    """
    attention, latent = model.attention, model.config.latent
    per_head = latent // attention.heads
    features = torch.cat([model.encode(*face)[::ONE_VERTEX_IN] for face in faces])
    positions = torch.cat([inputs[::ONE_VERTEX_IN, :3] for inputs, _ in faces])
    centre = landmarks.mean(0)
    ask = torch.cat([positions - centre, torch.ones(len(positions), 1)], dim=1)
    of_vertex, offset = fit(features, ask, 1e-7)
    answer = landmarks - centre
    answer = torch.cat([answer, -0.5 * answer.square().sum(1, keepdim=True)], dim=1)
    of_index, shift = fit(model.index, answer, 1e-6)
    phi = model.landmark_projection
    phi.weight[-PLACE:] = 0.0
    phi.weight[-PLACE:, latent:] = of_index
    phi.bias[-PLACE:] = shift
    for head, sigma in enumerate(np.geomspace(*SIGMAS_DM, attention.heads)):
        gain = per_head**0.25 / sigma
        rows = slice(head * per_head, head * per_head + PLACE)
        attention.query.weight[rows], attention.query.bias[rows] = gain * of_vertex, gain * offset
        attention.key.weight[rows], attention.key.bias[rows] = 0.0, 0.0
        attention.key.weight[rows, -PLACE:] = gain * torch.eye(PLACE)


def locality(
    model: PaperDecoder, features: Tensor, places: Tensor, landmarks: Tensor, rest: Tensor
) -> Tensor:
    """How far the attention is from the Gaussians of `attend_nearby`: cross-entropy less entropy, mean.

    features: [V, C] of the vertices at `places` [V, 3] dm. landmarks: motion of one frame [1, N, 3] dm about
    `rest` [N, 3] dm.
    """
    sigmas = torch.as_tensor(np.geomspace(*SIGMAS_DM, model.attention.heads)).to(places)
    squares = torch.cdist(places, rest).square()
    nearby = torch.softmax(-squares / (2.0 * sigmas[:, None, None].square()), dim=-1)
    shares = model.attention.shares(features, model.nodes(landmarks))[0]
    return F.kl_div(shares.clamp_min(1e-8).log(), nearby, reduction="sum") / shares[..., 0].numel()


@torch.no_grad()
def group_shares(
    model: PaperDecoder, inputs: Tensor, operators: SurfaceOperators, landmarks: Tensor
) -> dict[str, Tensor]:
    """Share of each vertex's attention that a part of the face gets, the heads' mean, [V] by part.

    inputs: [V, 6]. landmarks: motion of one frame [1, N, 3] dm.
    """
    shares = model.attention.shares(model.encode(inputs, operators), model.nodes(landmarks))[0].mean(0)
    return {name: shares[:, part].sum(-1) for name, part in GROUPS.items()}


def fit(inputs: Tensor, targets: Tensor, ridge: float) -> tuple[Tensor, Tensor]:
    """Weight [O, I] and bias [O] of a layer from inputs [R, I] to targets [R, O]; least squares."""
    rows = torch.cat([inputs, torch.ones(len(inputs), 1)], dim=1).double()
    penalty = ridge * torch.eye(rows.shape[1], dtype=torch.float64)
    penalty[-1, -1] = 0.0
    solved = torch.linalg.solve(rows.T @ rows / len(rows) + penalty, rows.T @ targets.double() / len(rows))
    return solved[:-1].T.float(), solved[-1].float()


@torch.no_grad()
def effective_landmarks(
    model: PaperDecoder, inputs: Tensor, operators: SurfaceOperators, landmarks: Tensor
) -> Tensor:
    """How many landmarks a vertex attends to: exp of the entropy of the heads' mean attention. [T, V]."""
    shares = model.attention.shares(model.encode(inputs, operators), model.nodes(landmarks)).mean(1)
    return torch.exp(-(shares * (shares + 1e-12).log()).sum(-1))
