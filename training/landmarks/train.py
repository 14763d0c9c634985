"""Trains the landmark network on a rendered pool.

    python -m training.landmarks.train --runs runs/landmarks --steps 1800

Writes `network.pt` and a line of the log every 100 steps, and resumes from `last.pt`. `--from` starts with
the weights of another run or with shipped weights. Shipped weights have a folded normalisation, and it stays
folded.
"""

import argparse
import math
from functools import partial
from pathlib import Path

import numpy as np
import torch
from torch.nn import functional as F

from training.corpus.mirror import permutation
from training.landmarks.network import Config, LandmarkNetwork, decode, start_from
from training.run import begin, descend, seeded


def heat_targets(places: torch.Tensor, size: int = 64, sigma: float = 1.0) -> torch.Tensor:
    """Gaussians that sum to one, `[B, 68, size, size]`; all zero for a place outside the picture."""
    grid = torch.arange(size) + 0.5
    x = torch.exp(-0.5 * ((grid - places[..., :1] * size) / sigma) ** 2)
    y = torch.exp(-0.5 * ((grid - places[..., 1:] * size) / sigma) ** 2)
    maps = y[..., :, None] * x[..., None, :]
    inside = ((places > 0.0) & (places < 1.0)).all(-1)
    return maps / maps.sum((2, 3), keepdim=True).clamp_min(1e-6) * inside[..., None, None]


def loss_of(model, pictures, places, face) -> tuple[torch.Tensor, torch.Tensor]:
    """Cross entropy of heat maps (where there is a face) and of presence."""
    heat, presence = model(pictures)
    targets = heat_targets(places) * face[:, None, None, None]
    log_chance = heat.float().flatten(2).log_softmax(-1)
    cross = -(targets.flatten(2) * log_chance).sum(-1)
    where = F.binary_cross_entropy_with_logits(presence.float(), face)
    return cross.sum() / (targets.sum((1, 2, 3)).sum().clamp_min(1.0)) + 0.5 * where, heat


def batch(pool, chosen: np.ndarray, rng: np.random.Generator):
    """Pictures, places and presence of the chosen samples, half of them mirrored."""
    pictures, targets, kinds = pool
    x = torch.from_numpy(np.asarray(pictures[np.sort(chosen)], np.float32))
    places = torch.from_numpy(targets[np.sort(chosen)].copy())
    face = torch.from_numpy((kinds[np.sort(chosen)] > 0).astype(np.float32))
    flip = torch.from_numpy(rng.random(len(chosen)) < 0.5)
    x[flip] = x[flip].flip(-1)
    x[flip, 1] *= -1
    mirrored = places[:, permutation()].clone()
    mirrored[..., 0] = 1 - mirrored[..., 0]
    places[flip] = mirrored[flip]
    return x, places, face


def train(arguments) -> None:
    """Runs the training; writes `network.pt`."""
    seeded(arguments)
    draws = np.random.default_rng(arguments.seed)
    folder = arguments.pool or arguments.out
    pool = (
        np.load(folder / "pictures.npy", mmap_mode="r"),
        np.load(folder / "targets.npy"),
        np.load(folder / "kind.npy"),
    )
    model = LandmarkNetwork(Config()).to(memory_format=torch.channels_last)
    if arguments.origin:
        start_from(arguments.origin, model, "views.")

    def loss(_step: int) -> tuple[torch.Tensor, dict]:
        x, places, face = batch(pool, draws.choice(len(pool[2]), arguments.batch, replace=False), draws)
        x = x.contiguous(memory_format=torch.channels_last)
        with torch.autocast("cpu", torch.bfloat16):
            value, heat = loss_of(model, x, places, face)
        predicted, _ = decode(heat.detach().float())
        off = (predicted - places).norm(dim=-1)[face > 0] * 64
        return value, {"median heat-map pixels": off.median().item()}

    def judge(model: LandmarkNetwork) -> dict:
        torch.save({"model": model.state_dict()}, arguments.out / "network.pt")
        return {}

    factor = partial(share_of_rate, steps=arguments.steps)
    run = begin(arguments, model, {"draws": draws}, decay=1e-4, average=None, factor=factor)
    descend(arguments, run, loss, judge, clip=5.0)


def share_of_rate(step: int, steps: int) -> float:
    """Warm-up over 50 steps, then a half cosine down to 2 %; steps count from 0."""
    fall = 0.02 + 0.98 * 0.5 * (1 + math.cos(math.pi * (step + 1) / steps))
    return min(1.0, (step + 1) / 50) * fall


def parser() -> argparse.ArgumentParser:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--runs", type=Path, dest="out", default=Path("runs/landmarks"))
    parser.add_argument("--pool", type=Path, help="folder of the pool; default: the runs folder")
    parser.add_argument("--from", type=Path, dest="origin", help="network.pt, or the folder of a model")
    parser.add_argument("--steps", type=int, default=1800)
    parser.add_argument("--batch", type=int, default=24)
    parser.add_argument("--rate", type=float, default=2e-3)
    parser.add_argument("--seed", type=int, default=0)
    parser.set_defaults(threads=1, log_every=100, save_every=100)
    return parser


if __name__ == "__main__":
    train(parser().parse_args())
