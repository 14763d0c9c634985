"""Trains FaceTalk's head: identity (canonical field), then expression (both deformations).

    python -m training.train_facetalk identity --out runs/facetalk_identity
    python -m training.train_facetalk expression --identity runs/facetalk_identity/head.pt

Heads are made as they are needed, ICT identities from N(0, 1); those of `held_out` are never drawn. Seeded;
resumes from `--out/last.pt` with the same bits.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import torch
import torch.nn.functional as F
from torch import Tensor

from training.corpus.faces import CHANNELS
from training.corpus.heads import COEFFICIENTS, Batch, IctHeads
from training.run import Run
from training.systems.facetalk.anchors import numbers
from training.systems.facetalk.config import CONFIGS, HeadConfig
from training.systems.facetalk.head import Head

SURFACE, NORMALS, EIKONAL, FAR, ANCHORS, CODES = 2.0, 0.3, 0.1, 0.01, 7.5, 1e-4
"""As published for NPHM but for codes (0.01 there, of sums over tables of codes; here of means); points near
the surface, whose distance is known here, count as those on it."""
FAR_SHARPNESS = 100.0
MOTION, EXPRESSION_CODES, CYCLE = 100.0, 5e-5, 10.0


def gradient(x: Tensor, s: Tensor) -> Tensor:
    """∂s/∂x at points [Q, 3]."""
    return torch.autograd.grad(s.sum(), x, create_graph=True)[0]


def identity_loss(head: Head, batch: Batch) -> tuple[Tensor, dict[str, float]]:
    """Distances, normals, eikonal term, far points, anchors and codes."""
    scale, count = head.config.scale_m, len(batch.coefficients)
    z = head.identity_code(batch.coefficients)
    number = torch.arange(count)[:, None]

    def field(x: Tensor) -> tuple[Tensor, Tensor]:
        flat = (x / scale).flatten(0, 1).requires_grad_()
        return flat, head.identity(flat, z, number.expand(-1, x.shape[1]).flatten())

    on, s = field(batch.surface)
    slope = gradient(on, s)
    near, t = field(batch.near)
    far, u = field(batch.far)
    near_slope = gradient(near, t)
    sign = batch.far_sign.flatten()
    landmarks = batch.landmarks[:, numbers(head.config)] / scale
    anchors = head.identity.anchors(head.identity.codes(z)[0])
    parts = {
        "surface": s.abs().mean(),
        "near": (t - batch.near_distance.flatten() / scale).abs().mean(),
        "normals": (slope - batch.normals.flatten(0, 1)).norm(dim=1).mean(),
        "eikonal": (near_slope.norm(dim=1) - 1.0).square().mean(),
        "far": F.softplus(-FAR_SHARPNESS * sign * u).mean(),
        "anchors": (anchors - landmarks).square().sum(-1).mean(),
        "codes": z.square().mean(),
    }
    total = SURFACE * (parts["surface"] + parts["near"]) + NORMALS * parts["normals"]
    total = total + EIKONAL * parts["eikonal"] + FAR * parts["far"] + ANCHORS * parts["anchors"]
    total = total + CODES * parts["codes"]
    report = {name: value.item() for name, value in parts.items()}
    report["surface mm"] = report["surface"] * scale * 1e3
    return total, report


def random_weights(count: int, random: torch.Generator) -> Tensor:
    """ARKit weights [count, 51]: a few channels each, the jaw often; some heads at rest."""
    weights = torch.rand(count, len(CHANNELS), generator=random)
    few = torch.rand(count, len(CHANNELS), generator=random) < 0.12
    weights = weights * few
    jaw = CHANNELS.index("jawOpen")
    talks = torch.rand(count, generator=random) < 0.5
    weights[talks, jaw] = torch.rand(int(talks.sum()), generator=random) * 0.7
    still = torch.rand(count, generator=random) < 0.2
    weights[still] = 0.0
    return weights


def pairs(head: Head, heads: IctHeads, coefficients: Tensor, weights: Tensor, points: int,
          random: torch.Generator) -> tuple[Tensor, Tensor]:  # fmt: skip
    """Canonical and posed points [B, P, 3] in units of the field, a part of them off the surface."""
    people, scales = heads.people(coefficients)
    open_heads = heads.posed(people, scales, heads.rest.expand(len(people), -1))
    posed = heads.posed(people, scales, weights)
    moves = (heads.modes.norm(dim=-1) > 1e-3).any(0).float() + 0.15
    chosen = torch.multinomial(moves, points, replacement=True, generator=random)
    return open_heads[:, chosen] / head.config.scale_m, posed[:, chosen] / head.config.scale_m


def expression_loss(head: Head, heads: IctHeads, arguments, random: torch.Generator):
    """Both directions on exact pairs, and the way there and back."""
    count, points = arguments.heads, arguments.points
    coefficients = torch.randn(count, COEFFICIENTS, generator=random)
    weights = random_weights(count, random)
    canonical, posed = pairs(head, heads, coefficients, weights, points, random)
    number = torch.arange(count).repeat_interleave(points)
    with torch.no_grad():
        z = head.identity_code(coefficients)
        anchors = head.identity.anchors(head.identity.codes(z)[0])
    code = head.expression(weights)
    canonical, posed = canonical.flatten(0, 1), posed.flatten(0, 1)
    ahead = canonical + head.forward_field(canonical, z, anchors, code, number)
    back = posed + head.backward_field(posed, z, anchors, code, number)
    again = ahead + head.backward_field(ahead, z, anchors, code, number)
    parts = {
        "forward": (ahead - posed).square().sum(1).mean(),
        "backward": (back - canonical).square().sum(1).mean(),
        "cycle": (again - canonical).square().sum(1).mean(),
    }
    total = MOTION * (parts["forward"] + parts["backward"]) + CYCLE * parts["cycle"]
    total = total + EXPRESSION_CODES * code.square().mean()
    millimetres = 1e3 * head.config.scale_m
    return total, {
        "forward mm": millimetres * (ahead - posed).norm(dim=1).mean().item(),
        "backward mm": millimetres * (back - canonical).norm(dim=1).mean().item(),
        "cycle mm": millimetres * (again - canonical).norm(dim=1).mean().item(),
    }


def train(arguments) -> Path:
    """Runs the training; writes `head.pt` and returns its path."""
    torch.manual_seed(arguments.seed)
    torch.set_num_threads(arguments.threads)
    if arguments.part == "identity":
        config = CONFIGS[arguments.config]()
        config.channels = list(CHANNELS)
        head = Head(config)
        learned = [*head.identity.parameters(), *head.identity_code.parameters()]
    else:
        head = load(arguments.identity)
        config = head.config
        learned = [*head.backward_field.parameters(), *head.forward_field.parameters(),
                   *head.expression_code.parameters()]  # fmt: skip
    heads = IctHeads(arguments.data, arguments.cache, config.open_jaw)
    if arguments.part == "identity":
        with torch.no_grad():
            middle = heads.opened[heads.landmarks][numbers(config)] / config.scale_m
            head.identity.anchors.out.bias.copy_(middle.flatten())
    optimiser = torch.optim.Adam(learned, arguments.rate)
    schedule = torch.optim.lr_scheduler.OneCycleLR(
        optimiser, arguments.rate, arguments.steps + 1, pct_start=0.05, final_div_factor=30.0
    )
    random = torch.Generator().manual_seed(arguments.seed + 1)
    parts = {"head": head, "optimiser": optimiser, "schedule": schedule}
    run = Run(arguments.out, parts, arguments.steps, arguments.save_every, {"random": random})
    for step in range(run.first, arguments.steps):
        if arguments.part == "identity":
            coefficients = torch.randn(arguments.heads, COEFFICIENTS, generator=random)
            batch = heads.batch(coefficients, arguments.points, arguments.points // 2, random)
            loss, report = identity_loss(head, batch)
        else:
            loss, report = expression_loss(head, heads, arguments, random)
        optimiser.zero_grad()
        loss.backward()
        torch.nn.utils.clip_grad_norm_(learned, 1.0)
        optimiser.step()
        schedule.step()
        run.after(step, loss.item())
        if step % arguments.log_every == arguments.log_every - 1 or step == arguments.steps - 1:
            run.log({"step": step + 1, "s": run.seconds(), **report})
            save(run.out / "head.pt", head)
    return arguments.out / "head.pt"


def save(path: Path, head: Head) -> None:
    """Weights and configuration in one file."""
    torch.save({"state": head.state_dict(), "config": head.config.to_json()}, path)


def load(path: Path) -> Head:
    """Reads what `save` wrote."""
    kept = torch.load(path, map_location="cpu", weights_only=True)
    head = Head(HeadConfig.from_json(kept["config"]))
    head.load_state_dict(kept["state"])
    return head


def parser() -> argparse.ArgumentParser:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("part", choices=["identity", "expression"])
    parser.add_argument("--data", type=Path, default=Path("../shared/data"))
    parser.add_argument("--out", type=Path, default=Path("runs/facetalk"))
    parser.add_argument("--cache", type=Path, default=Path("runs/cache"))
    parser.add_argument("--identity", type=Path, default=Path("runs/facetalk_identity/head.pt"))
    parser.add_argument("--config", choices=list(CONFIGS), default="compact")
    parser.add_argument("--heads", type=int, default=4, help="in a batch")
    parser.add_argument("--points", type=int, default=600, help="of each head on the surface")
    parser.add_argument("--steps", type=int, default=3000)
    parser.add_argument("--rate", type=float, default=2e-3)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--log-every", type=int, default=200)
    parser.add_argument("--save-every", type=int, default=500)
    return parser


if __name__ == "__main__":
    train(parser().parse_args())
