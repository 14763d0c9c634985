"""Fits a head's codes to points: z_id to a scan, and z_ex to a sequence of clouds (eq. 16 to 18).

`fit_identity` searches z_id among coefficients: z = W c + b, with the prior N(0, 1) on c. It takes
Gauss-Newton steps on distances and landmarks. Slopes are finite differences, so it also works without
automatic differentiation. `fit_free` then lets z leave the range of the coefficients.
"""

from dataclasses import dataclass

import torch
from torch import Tensor

from training.run import downhill
from training.systems.facetalk.head import COEFFICIENTS, Head

SDF, TEMPORAL, EXPRESSION = 10.0, 0.1, 0.0025
"""Weights of the terms of eq. 16: distances, changes from frame to frame, size of expression codes."""
DISTANCE_M, LANDMARK_M = 4e-4, 3e-3
"""Standard deviations, in metres, of points and of landmarks from a head of the model.

Points are not independent, so only the share `POINT_SHARE` of their number counts.
"""
POINT_SHARE = 0.05
ROBUST_M = 3e-3
"""A point farther off than about this (metres) counts less the farther it is (Cauchy)."""
DIFFERENCE = 0.05
ITERATIONS, POINTS = 8, 1200
DAMPING = 0.1


def distances(head: Head, points: Tensor, z: Tensor) -> Tensor:
    """Signed distances [B, P] in metres of points [B, P, 3] metres."""
    return head.identity(points / head.config.scale_m, z) * head.config.scale_m


@torch.no_grad()
def fit_identity(
    head: Head, points: Tensor, landmarks: Tensor | None = None, iterations: int = ITERATIONS, seed: int = 0,
    which: list[int] | None = None,
) -> Tensor:  # fmt: skip
    """Coefficients [100] whose head passes through points [P, 3] (metres, canonical frame and pose).

    `landmarks` [68, 3] in metres start the fit and keep their weight in it. `which` lists the landmarks that
    exist; None means all.
    """
    random = torch.Generator().manual_seed(seed)
    chosen = list(range(68)) if which is None else which
    c = torch.zeros(COEFFICIENTS)
    step = DIFFERENCE * torch.eye(COEFFICIENTS)
    for number in range(-1 if landmarks is not None else 0, iterations):
        rows, residuals = [], []
        tried = torch.cat([c[None], c + step])
        z = head.identity_code(tried)
        if landmarks is not None:
            places = head.identity.places(z)[:, chosen] * head.config.scale_m
            off = (places - landmarks[chosen]).flatten(1) / LANDMARK_M
            rows.append((off[1:] - off[:1]) / DIFFERENCE)
            residuals.append(off[0])
        if number >= 0:
            some = points[torch.randint(0, len(points), (POINTS,), generator=random)]
            s = torch.cat([distances(head, some.expand(len(part), -1, -1), part) for part in z.split(26)])
            trust = (POINT_SHARE / (1.0 + (s[0] / ROBUST_M).square())).sqrt() / DISTANCE_M
            rows.append((s[1:] - s[:1]) / DIFFERENCE * trust)
            residuals.append(s[0] * trust)
        slope, residual = torch.cat(rows, 1).T, torch.cat(residuals)
        gram = slope.T @ slope + (1.0 + DAMPING) * torch.eye(COEFFICIENTS)
        c = c - torch.linalg.solve(gram, slope.T @ residual + c)
    return c


def fit_free(head: Head, points: Tensor, z: Tensor, steps: int, stay: float, seed: int = 0) -> Tensor:
    """Fits z_id [Z] near `z` [Z] by eq. 17, with Adam on the distances of random points.

    `stay` is the weight of the squared change of z.
    """
    random = torch.Generator().manual_seed(seed)
    start, z = z.detach(), z.detach().clone().requires_grad_()
    optimiser = torch.optim.Adam([z], 2e-2)
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimiser, steps)
    for _ in range(steps):
        some = points[torch.randint(0, len(points), (POINTS,), generator=random)]
        s = distances(head, some[None], z[None])[0]
        lost = (ROBUST_M * (1.0 + (s / ROBUST_M).square()).log()).mean() / DISTANCE_M
        loss = lost + stay * (z - start).square().mean()
        downhill(loss, optimiser, schedule)
    return z.detach()


@dataclass
class SequenceFit:
    """Settings for minimising eq. 16. The defaults are the paper's numbers."""

    group: int = 10
    shared: int = 2
    iterations: int = 500
    points: int = 5000
    rate: float = 1e-3
    late_rate: float = 1e-4
    late_from: int = 300


def fit_sequence(
    head: Head, clouds: list[Tensor], z: Tensor, fit: SequenceFit, start: Tensor, seed: int = 0
) -> Tensor:
    """Fits z_ex [T, X] to clouds [P_i, 3] in metres (canonical frame).

    `z` [Z] is the known z_id. The codes start from `start` [X].
    """
    random = torch.Generator().manual_seed(seed)
    frames, scale = len(clouds), head.config.scale_m
    codes = start.expand(frames, -1).clone()
    first = 0
    while True:
        last = min(first + fit.group, frames)
        if first > 0:
            codes[first + fit.shared : last] = codes[first + fit.shared - 1]
        window = codes[first:last].clone().requires_grad_()
        optimiser = torch.optim.Adam([window], fit.rate)
        identity = z.expand(last - first, -1)
        for number in range(fit.iterations):
            if number == fit.late_from:
                optimiser.param_groups[0]["lr"] = fit.late_rate
            drawn = [c[torch.randint(0, len(c), (fit.points,), generator=random)] for c in clouds[first:last]]
            s = head(torch.stack(drawn) / scale, identity, window)
            change = torch.nn.functional.huber_loss(window[1:], window[:-1], reduction="sum")
            loss = (
                SDF * s.abs().mean()
                + TEMPORAL * change / window.numel()
                + EXPRESSION * window.square().mean()
            )
            optimiser.zero_grad()
            loss.backward()
            if first > 0:
                window.grad[: fit.shared] = 0.0
            optimiser.step()
        codes[first:last] = window.detach()
        if last == frames:
            return codes
        first = last - fit.shared
