"""Measures FaceTalk's head on ICT identities that training never drew.

    python -m training.evaluate_facetalk --head runs/facetalk/head.pt

Prints, for codes from known coefficients and for the code of the mean head beside them, how far points of
the true surface lie from the field's zero (one Newton step) and the cosine of normals; for expressions the
error of the forward field, of its way back, and what no motion would give.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import torch

from training.corpus.heads import COEFFICIENTS, IctHeads
from training.systems.facetalk.head import Head
from training.train_facetalk import load, pairs, random_weights

UNSEEN_SEED = 9_000_000
"""Training's own generator is seeded by small numbers."""


def surface_error(
    head: Head, heads: IctHeads, count: int, points: int, mean: bool
) -> tuple[float, float, float]:
    """Mean distance in mm, mean cosine of normals, and the share of far points with the wrong sign."""
    random = torch.Generator().manual_seed(UNSEEN_SEED)
    batch = heads.batch(torch.randn(count, COEFFICIENTS, generator=random), points, points, random)
    scale = head.config.scale_m
    x = (batch.surface / scale).flatten(0, 1).requires_grad_()
    z = head.identity_code(torch.zeros_like(batch.coefficients) if mean else batch.coefficients).detach()
    number = torch.arange(count).repeat_interleave(points)
    s = head.identity(x, z, number)
    slope = torch.autograd.grad(s.sum(), x)[0]
    distance = s.abs() / slope.norm(dim=1).clamp_min(0.2)
    cosine = torch.nn.functional.cosine_similarity(slope, batch.normals.flatten(0, 1), dim=1)
    with torch.no_grad():
        far = head.identity((batch.far / scale).flatten(0, 1), z, number)
    wrong = (far.sign() != batch.far_sign.flatten()).float().mean()
    return 1e3 * scale * distance.mean().item(), cosine.mean().item(), wrong.item()


@torch.no_grad()
def expression_error(head: Head, heads: IctHeads, count: int, points: int) -> dict[str, float]:
    """Means in mm over heads, expressions and vertices, those that move drawn more often."""
    random = torch.Generator().manual_seed(UNSEEN_SEED + 1)
    coefficients = torch.randn(count, COEFFICIENTS, generator=random)
    weights = random_weights(count, random)
    canonical, posed = pairs(head, heads, coefficients, weights, points, random)
    canonical, posed = canonical.flatten(0, 1), posed.flatten(0, 1)
    number = torch.arange(count).repeat_interleave(points)
    z, code = head.identity_code(coefficients), head.expression(weights)
    ahead = head.posed(canonical, z, code, number)
    errors = {
        "no motion": canonical - posed,
        "forward": ahead - posed,
        "backward": head.canonical(posed, z, code, number) - canonical,
        "there and back": head.canonical(ahead, z, code, number) - canonical,
    }
    return {name: 1e3 * head.config.scale_m * e.norm(dim=1).mean().item() for name, e in errors.items()}


def main() -> None:
    """Entry of the command."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--head", type=Path, default=Path("runs/facetalk/head.pt"))
    parser.add_argument("--data", type=Path, default=Path("../shared/data"))
    parser.add_argument("--cache", type=Path, default=Path("runs/cache"))
    parser.add_argument("--heads", type=int, default=10)
    parser.add_argument("--points", type=int, default=1000)
    arguments = parser.parse_args()
    head = load(arguments.head)
    heads = IctHeads(arguments.data, arguments.cache, head.config.open_jaw)
    for name, mean in (("known coefficients", False), ("mean head", True)):
        distance, cosine, wrong = surface_error(head, heads, arguments.heads, arguments.points, mean)
        print(f"{name}: {distance:.2f} mm to the surface, normals {cosine:.3f}, far signs wrong {wrong:.4f}")
    for name, error in expression_error(head, heads, arguments.heads, arguments.points).items():
        print(f"expression, {name}: {error:.2f} mm")


if __name__ == "__main__":
    main()
