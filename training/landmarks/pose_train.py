"""Trains the pose network on its pool.

    python -m training.landmarks.pose_train --runs runs/pose --steps 4500

Writes `network.pt` and a line of the log every 250 steps, and resumes from `last.pt`.
"""

import argparse
from pathlib import Path

import numpy as np
import torch
from torch.nn import functional as F

from training.landmarks.network import start_from
from training.landmarks.pose_network import CELLS, PoseConfig, PoseNetwork
from training.landmarks.pose_pool import QUANTUM
from training.run import begin, descend, seeded


def orthonormal(axes: torch.Tensor) -> torch.Tensor:
    """Turns raw x and z axes `[..., 6]` into a rotation `[..., 3, 3]`, rows x, y, z (z kept, x fitted)."""
    z = F.normalize(axes[..., 3:], dim=-1)
    x = axes[..., :3] - (axes[..., :3] * z).sum(-1, keepdim=True) * z
    x = F.normalize(x, dim=-1)
    return torch.stack([x, torch.linalg.cross(z, x), z], -2)


def loss_of(model, pictures: torch.Tensor, poses: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
    """Focal loss of presence in every cell, plus loss of the pose near a face's centre; and the output."""
    out = model(pictures).float()
    there = poses[:, 0]
    grid = (torch.arange(CELLS) + 0.5) / CELLS
    place = poses[:, 1:3]
    radius = (0.25 * poses[:, 3].exp()).clamp(0.75 / CELLS, 0.12)[:, None, None]
    d2 = (grid - place[:, :1])[:, None, :] ** 2 + (grid - place[:, 1:])[:, :, None] ** 2
    near = torch.exp(-0.5 * d2 / radius**2) * (there > 0)[:, None, None]
    weight = (there >= 0)[:, None, None].float() * (1 + 6 * near)
    logit = out[:, 0]
    chance = logit.sigmoid()
    cross = F.binary_cross_entropy_with_logits(logit, near, reduction="none")
    presence = (weight * (chance - near).abs() ** 1.5 * cross).sum((1, 2)).mean()
    share = near * (near > 0.4)
    total = share.sum().clamp_min(1.0)
    off = place[:, :, None, None] - torch.stack(torch.meshgrid(grid, grid, indexing="xy"))[None]
    target = torch.cat([off * CELLS, poses[:, 3:10, None, None].expand(-1, -1, CELLS, CELLS)], 1)
    scale = torch.tensor([0.3, 0.3, 2.0, *[3.0] * 6])[None, :, None, None]
    miss = F.smooth_l1_loss(scale * out[:, 1:], scale * target, reduction="none", beta=0.3).sum(1)
    return presence + 0.5 * (miss * share).sum() / total, out


def decode(out: torch.Tensor) -> tuple[torch.Tensor, ...]:
    """The best cell of each picture: presence, place, log size, rotation (rows: face axes)."""
    best = out[:, 0].flatten(1).argmax(1)
    values = out.flatten(2).gather(2, best[:, None, None].expand(-1, out.shape[1], 1))[..., 0]
    cell = torch.stack([best % CELLS, best // CELLS], 1) + 0.5
    return values[:, 0].sigmoid(), (cell + values[:, 1:3]) / CELLS, values[:, 3], orthonormal(values[:, 4:])


def measured(out: torch.Tensor, poses: torch.Tensor) -> dict[str, float]:
    """Pose errors where there is a face, and how often a face is seen where there is one and where not."""
    chance, place, size, turn = decode(out)
    yes, no = poses[:, 0] > 0, poses[:, 0] == 0
    true = orthonormal(poses[:, 4:10])
    cosine = ((turn * true).sum((1, 2)) - 1) / 2
    angle = torch.rad2deg(cosine.clamp(-1, 1).acos())[yes]
    shift = ((place - poses[:, 1:3]).norm(dim=1) / poses[:, 3].exp())[yes]
    scores = {
        "degrees": angle.median(),
        "degrees 90 %": angle.quantile(0.9),
        "place": shift.median(),
        "size": (size - poses[:, 3]).abs()[yes].median(),
        "seen": (chance[yes] > 0.5).float().mean(),
        "false": (chance[no] > 0.5).float().mean(),
    }
    return {name: value.item() for name, value in scores.items()}


def batch(pool, chosen: np.ndarray, flip: np.ndarray) -> tuple[torch.Tensor, torch.Tensor]:
    """Pictures and poses, some mirrored."""
    x = torch.from_numpy(np.asarray(pool[0][np.sort(chosen)], np.float32) / QUANTUM)
    poses = torch.from_numpy(pool[1][np.sort(chosen)].copy())
    flip = torch.from_numpy(flip)
    x[flip] = x[flip].flip(-1)
    x[flip, 1] *= -1
    poses[flip, 1] = 1 - poses[flip, 1]
    # In a mirrored face, the z axis is mirrored in x. The x axis is mirrored, too, then reversed.
    poses[flip] *= torch.tensor([1.0, 1, 1, 1, 1, -1, -1, -1, 1, 1, 1])
    return x.contiguous(memory_format=torch.channels_last), poses


def open_pool(folder: Path):
    """The pictures of a pool, left on the disk, and its poses."""
    poses = np.load(folder / "poses.npy")
    return np.load(folder / "pictures.npy", mmap_mode="r"), poses


def train(arguments) -> None:
    """Runs the training; writes `network.pt`."""
    seeded(arguments)
    draws = np.random.default_rng(arguments.seed)
    model = PoseNetwork(PoseConfig()).to(memory_format=torch.channels_last)
    if arguments.origin:
        start_from(arguments.origin, model, "pose.")
    pool = open_pool(arguments.out)

    def factor(step: int) -> float:
        fall = 0.02 + 0.98 * (1 - step / arguments.steps) ** 1.2 if step < arguments.steps else 0.02
        return min(1.0, (step + 1) / 100) * fall

    def loss(_step: int) -> tuple[torch.Tensor, dict]:
        # The last 800 pictures (50 heads) are reserved for the log line.
        chosen = draws.choice(len(pool[1]) - 800, arguments.batch, replace=False)
        x, poses = batch(pool, chosen, draws.random(arguments.batch) < 0.5)
        with torch.autocast("cpu", torch.bfloat16):
            return loss_of(model, x, poses)[0], {}

    def judge(model: PoseNetwork) -> dict[str, float]:
        torch.save({"model": model.state_dict()}, arguments.out / "network.pt")
        model.eval()
        with torch.no_grad():
            x, poses = batch(pool, np.arange(len(pool[1]) - 800, len(pool[1])), np.zeros(800, bool))
            scores = measured(torch.cat([model(part) for part in x.split(100)]), poses)
        model.train()
        return scores

    run = begin(arguments, model, {"draws": draws}, decay=1e-3, average=None, factor=factor)
    descend(arguments, run, loss, judge, clip=3.0)


def parser() -> argparse.ArgumentParser:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--runs", type=Path, dest="out", default=Path("runs/pose"))
    parser.add_argument("--from", type=Path, dest="origin", help="network.pt, or the folder of a model")
    parser.add_argument("--steps", type=int, default=4500)
    parser.add_argument("--batch", type=int, default=48)
    parser.add_argument("--rate", type=float, default=3e-3)
    parser.add_argument("--seed", type=int, default=0)
    parser.set_defaults(threads=1, log_every=250, save_every=250)
    return parser


if __name__ == "__main__":
    train(parser().parse_args())
