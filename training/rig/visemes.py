"""The 15 Oculus visemes as mixtures of ARKit shapes.

They are solved on the MakeHuman head, the one face with true visemes, by bounded least squares over the
shapes of the mouth and jaw, left and right together. A small penalty on each weight's square keeps out
shapes that nearly cancel each other.
"""

import json
from pathlib import Path

import numpy as np
from safetensors import safe_open
from scipy.optimize import lsq_linear

from training.rig.shapes import mirrored_name

SIDEWAYS = ("jawLeft", "jawRight", "mouthLeft", "mouthRight")
RIDGE = 0.02
"""Strength of the ridge penalty, as a share of the mean energy of a shape."""
LEAST = 0.02
"""Weights below this become 0, so the mixture leaves out their shapes."""
MOVING_MM = 0.5


def solve(data: Path) -> tuple[dict[str, dict[str, float]], dict[str, tuple[float, float]]]:
    """Mixtures by viseme, and for each the mean error and mean motion of its moving vertices in mm."""
    with safe_open(data / "faces/makehuman_head.safetensors", "np") as file:
        names = json.loads(file.metadata()["names"])
        modes = dict(zip(names, 100.0 * file.get_tensor("deltas").astype(np.float64), strict=True))
    groups = sorted(
        {
            tuple(sorted({name, mirrored_name(name)}))
            for name in names
            if name.startswith(("jaw", "mouth", "cheekPuff")) and name not in SIDEWAYS
        }
    )
    columns = np.stack([sum(modes[name] for name in group).ravel() for group in groups], 1)
    ridge = np.sqrt(RIDGE * (columns**2).sum(0).mean()) * np.eye(len(groups))
    mixtures, errors = {}, {}
    for viseme in (name for name in names if name.startswith("viseme_")):
        truth = modes[viseme]
        right = np.concatenate([truth.ravel(), np.zeros(len(groups))])
        weights = lsq_linear(np.vstack([columns, ridge]), right, (0.0, 1.0)).x
        weights = np.where(weights < LEAST, 0.0, weights.round(2))
        mixtures[viseme] = {
            name: float(w) for w, group in zip(weights, groups, strict=True) if w > 0.0 for name in group
        }
        length = np.linalg.norm(truth, axis=1)
        moving = length > MOVING_MM
        if moving.any():
            left = np.linalg.norm((columns @ weights).reshape(-1, 3) - truth, axis=1)
            errors[viseme] = (float(left[moving].mean()), float(length[moving].mean()))
    return mixtures, errors
