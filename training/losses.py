"""Losses on landmark motion."""

import torch
from torch import Tensor

LIPS = list(range(48, 68))
JAW = list(range(4, 13))
VELOCITY = 0.3
ACCELERATION = 0.1
SCALE_M = {"grid_s1": 3.2e-3, "grid_five": 3.2e-3, "facegood_zh": 4.0e-3, "taught": 3.2e-3}
LEAST_SCALE_M = 5e-4


def landmark_weights() -> Tensor:
    """Weight of each landmark, [204]: the mouth counts most, then the jaw."""
    weight = torch.full((68,), 0.3)
    weight[JAW] = 1.0
    weight[LIPS] = 2.0
    return weight.repeat_interleave(3)


def motion_loss(
    error: Tensor, weight: Tensor, velocity: float = VELOCITY, acceleration: float = ACCELERATION
) -> Tensor:
    """FreeTalk eq. 15: position + 0.3 velocity + 0.1 acceleration, weighted means of squares.

    `error` [B, T, D] is prediction − truth in any unit; `weight` [B, T, D].
    """
    total = weighted_mean(error, weight)
    for order, share in ((1, velocity), (2, acceleration)):
        total = total + share * weighted_mean(error.diff(n=order, dim=1), weight[:, order:])
    return total


def weighted_mean(error: Tensor, weight: Tensor) -> Tensor:
    """Mean of squares under a weight."""
    return (weight * error.square()).sum() / weight.sum().clamp_min(1e-6)


def lip_gap(motion: Tensor) -> Tensor:
    """Vertical opening of the inner lips, landmark 62 over 66, [..., 204] → [...]."""
    return motion[..., 3 * 62 + 1] - motion[..., 3 * 66 + 1]


def chin_drop(motion: Tensor) -> Tensor:
    """Downward motion of the chin, landmark 8, [..., 204] → [...]."""
    return -motion[..., 3 * 8 + 1]


def mouth_width(motion: Tensor) -> Tensor:
    """Distance of the mouth's corners along x, landmark 54 from 48, [..., 204] → [...]."""
    return motion[..., 3 * 54] - motion[..., 3 * 48]


def protrusion(motion: Tensor) -> Tensor:
    """Mean forward motion of all lip landmarks, [..., 204] → [...]."""
    return motion[..., 3 * LIPS[0] + 2 : 3 * LIPS[-1] + 3 : 3].mean(dim=-1)


FEATURES = {"gap": lip_gap, "width": mouth_width, "chin": chin_drop, "protrusion": protrusion}
"""Features of a speaking mouth that viewers see. Each maps [..., 204] → [...] in the motion's unit."""
SHARES = {"gap": 1.0, "width": 0.7, "chin": 0.5, "protrusion": 0.5}


def feature_concordance(prediction: Tensor, truth: Tensor) -> tuple[Tensor, dict[str, float]]:
    """Weighted sum of `concordance_loss` of every feature, [B, T, 204] in millimetres or a similar unit."""
    parts = {name: concordance_loss(of(prediction), of(truth)) for name, of in FEATURES.items()}
    total = sum(SHARES[name] * part for name, part in parts.items())
    return total, {name: part.item() for name, part in parts.items()}


def concordance_loss(prediction: Tensor, truth: Tensor) -> Tensor:
    """1 − Lin's concordance (1989) along the last axis, mean over rows that move.

    At its optimum the prediction deviates as much as the truth. At that of a squared error it deviates less.
    """
    p, t = prediction - prediction.mean(-1, True), truth - truth.mean(-1, True)
    moving = t.square().mean(-1) > 1e-8
    if not moving.any():
        return prediction.sum() * 0.0
    p, t = p[moving], t[moving]
    bias = (prediction.mean(-1) - truth.mean(-1))[moving].square()
    covariance = (p * t).mean(-1)
    scale = p.square().mean(-1) + t.square().mean(-1) + bias
    return (1.0 - 2.0 * covariance / scale.clamp_min(1e-9)).mean()


def source_scale(sources: list[str], index: Tensor, measured: dict[str, float] = SCALE_M) -> Tensor:
    """Typical lip motion of each row's source in metres, [B, 1, 1]."""
    return torch.tensor([measured[s] for s in sources])[index][:, None, None]


def lip_scale(motions: list[Tensor]) -> float:
    """Typical lip motion of a source in metres: RMS distance of the lips from rest, [T, 204] each."""
    lips = torch.cat([m[:, 3 * LIPS[0] : 3 * LIPS[-1] + 3] for m in motions]).unflatten(1, (-1, 3))
    return max(float(lips.square().sum(-1).mean().sqrt()), LEAST_SCALE_M)


def feature_scores(pairs) -> dict[str, float]:
    """For every feature, the mean r over clips and the slope of prediction over truth within clips.

    `pairs`: predicted and true motion [T, 204] of each clip.
    """
    report = {}
    for name, of in FEATURES.items():
        centred = [[of(x) - of(x).mean() for x in pair] for pair in pairs]
        each = torch.stack([torch.corrcoef(torch.stack(pair))[0, 1] for pair in centred])
        predicted, true = (torch.cat(x) for x in zip(*centred, strict=True))
        report[f"{name} r"] = float(each.nanmean())
        report[f"{name} slope"] = float((predicted * true).mean() / true.square().mean())
    return report
