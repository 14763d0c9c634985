"""Trains the landmark network on a rendered pool.

    python -m training.landmarks.train --runs runs/landmarks --steps 1800 [--without-makehuman]

Writes `network.pt` every 100 steps with a log line, and resumes from it. `--from` starts with the
weights of another run, or with shipped ones, whose normalisation is folded and stays so.
"""

import argparse
import math
import time
from pathlib import Path

import numpy as np
import torch
from torch.nn import functional as F

from training.corpus.mirror import permutation
from training.landmarks.network import Config, LandmarkNetwork, decode, start_from


def heat_targets(places: torch.Tensor, size: int = 64, sigma: float = 1.0) -> torch.Tensor:
    """Gaussians that sum to one, `[B, 68, size, size]`; zero where the place is outside."""
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


def main() -> None:
    """Entry of the command."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=Path, default=Path("runs/landmarks"))
    parser.add_argument("--pool", type=Path, help="default: the runs folder")
    parser.add_argument("--from", type=Path, dest="origin", help="weights to start with")
    parser.add_argument("--steps", type=int, default=1800)
    parser.add_argument("--batch", type=int, default=24)
    parser.add_argument("--rate", type=float, default=2e-3)
    parser.add_argument("--without-makehuman", action="store_true")
    parser.add_argument("--seed", type=int, default=0)
    args = parser.parse_args()
    torch.set_num_threads(1)
    torch.manual_seed(args.seed)
    rng = np.random.default_rng(args.seed)
    args.runs.mkdir(parents=True, exist_ok=True)
    folder = args.pool or args.runs
    pool = (
        np.load(folder / "pictures.npy", mmap_mode="r"),
        np.load(folder / "targets.npy"),
        np.load(folder / "kind.npy"),
    )
    usable = np.flatnonzero(pool[2] != 2) if args.without_makehuman else np.arange(len(pool[2]))
    model = LandmarkNetwork(Config()).to(memory_format=torch.channels_last)
    if args.origin:
        start_from(args.origin, model, "views.")
    optimiser = torch.optim.AdamW(model.parameters(), args.rate, weight_decay=1e-4)
    first = resume(args, model, optimiser)
    start, running = time.monotonic(), 0.0
    for step in range(first + 1, args.steps + 1):
        for group in optimiser.param_groups:
            group["lr"] = args.rate * schedule(step, args.steps)
        x, places, face = batch(pool, rng.choice(usable, args.batch, replace=False), rng)
        x = x.contiguous(memory_format=torch.channels_last)
        with torch.autocast("cpu", torch.bfloat16):
            loss, heat = loss_of(model, x, places, face)
        optimiser.zero_grad()
        loss.backward()
        torch.nn.utils.clip_grad_norm_(model.parameters(), 5.0)
        optimiser.step()
        running += loss.item()
        if step % 100 == 0 or step == args.steps:
            found, _ = decode(heat.detach().float())
            off = (found - places).norm(dim=-1)[face > 0] * 64
            print(
                f"step {step} loss {running / 100:.3f} median {off.median():.2f} heat-map pixels "
                f"after {time.monotonic() - start:.0f} s",
                flush=True,
            )
            running = 0.0
            state = {"model": model.state_dict(), "optimiser": optimiser.state_dict(), "step": step}
            torch.save(state, args.runs / "network.pt")


def schedule(step: int, steps: int) -> float:
    """Warm-up over 50 steps, then a half cosine down to 2 %."""
    fall = 0.02 + 0.98 * 0.5 * (1 + math.cos(math.pi * step / steps))
    return min(1.0, step / 50) * fall


def resume(args, model, optimiser) -> int:
    """Continues this run if it has begun; returns the steps done."""
    if not (args.runs / "network.pt").exists():
        return 0
    state = torch.load(args.runs / "network.pt")
    model.load_state_dict(state["model"])
    optimiser.load_state_dict(state["optimiser"])
    return state["step"]


if __name__ == "__main__":
    main()
