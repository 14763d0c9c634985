"""Trains FaceTalk's head: the mean head's distance field, the map to it, then both expression deformations.

    python -m training.systems.facetalk.train template --out runs/template
    python -m training.systems.facetalk.train identity --start runs/template/head.pt --out runs/identity
    python -m training.systems.facetalk.train expression --start runs/identity/head.pt --out runs/facetalk

Heads are ICT identities with coefficients from N(0, 1). A pool of them stays in memory, and every draw
replaces some; evaluation draws its coefficients from other seeds. `expression --corpus DIR` takes poses from
corpus folders instead of facegood_zh and grid_s1. Seeded; resumes from `--out/last.pt` bit for bit. The
networks compute on `--device` in `--precision`; the positions of points are computed on the CPU in float32.
"""

import argparse
from collections.abc import Callable
from pathlib import Path

import torch
from torch import Tensor

from training.corpus import arkit
from training.corpus.faces import CHANNELS
from training.corpus.heads import COEFFICIENTS, IctHeads, vertex_normals
from training.corpus.poses import Poses
from training.machine import Machine, add_arguments
from training.nn.checkpoint import save
from training.run import begin, descend, seeded, trainer_parser
from training.systems.facetalk.codes import set_bounds, set_codes, set_directions
from training.systems.facetalk.config import CONFIGS
from training.systems.facetalk.expression_loss import ExpressionLoss
from training.systems.facetalk.head import Head
from training.systems.facetalk.stored import load_head

FAR_SHARE = 0.3
FAR_WEIGHT = 0.15
NORMAL_WEIGHT = 4.0
EVEN_M = 1e-4
"""Errors far below this (metres) count by their square, far larger ones in proportion to their length."""
EIKONAL, EIKONAL_EVERY = 0.02, 8
REFRESHED = 1
OUT_RATE = 0.05
"""Share of the learning rate for the slow layers of `by_rate`: those that output displacements and those that
sum over many numbers of a code.
"""
RATES = {"template": 3e-3, "identity": 3e-3, "expression": 3e-3}


class Pool:
    """Heads in memory: coefficients [N, 100], vertices and normals [N, V, 3] in metres, scales [N]."""

    def __init__(self, heads: IctHeads, count: int, random: torch.Generator):
        self.heads, self.random = heads, random
        self.coefficients = torch.randn(count, COEFFICIENTS, generator=random)
        parts = [self._made(part) for part in self.coefficients.split(20)]
        self.vertices, self.normals, self.scales = (torch.cat(part) for part in zip(*parts, strict=True))

    def _made(self, coefficients: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        vertices, scales = self.heads.canonical(coefficients)
        return vertices, vertex_normals(vertices, self.heads.triangles), scales

    def state_dict(self) -> dict[str, Tensor]:
        """State for the checkpoint. Everything else is computed from the coefficients."""
        return {"coefficients": self.coefficients}

    def load_state_dict(self, state: dict[str, Tensor]) -> None:
        """Restores the heads. Rebuilds replaced heads one by one, as `draw` did: sums over several heads at
        once would differ in their last bits."""
        for number in (state["coefficients"] != self.coefficients).any(1).nonzero()[:, 0]:
            self._replace(number[None], state["coefficients"][number][None])

    def _replace(self, old: Tensor, fresh: Tensor) -> None:
        self.coefficients[old] = fresh
        self.vertices[old], self.normals[old], self.scales[old] = self._made(fresh)

    def draw(self, count: int) -> Tensor:
        """Replaces some heads of the pool with new ones, then returns the numbers of `count` random heads."""
        old = torch.randint(0, len(self.scales), (REFRESHED,), generator=self.random)
        fresh = torch.randn(REFRESHED, COEFFICIENTS, generator=self.random)
        self._replace(old, fresh)
        return torch.randperm(len(self.scales), generator=self.random)[:count]


def drawn(count: int, among: int, random: torch.Generator) -> Tensor:
    """`count` random row numbers below `among`."""
    return torch.randint(0, among, (count,), generator=random)


def template_loss(head: Head, heads: IctHeads, points: int, step: int, random: torch.Generator):
    """Loss of distances near the surface and around it; in some steps also of the gradient's length."""
    scale, device = head.config.scale_m, head.identity_code.weight.device
    places = heads.places[drawn(points, len(heads.places), random)]
    near = (heads.at(heads.opened[None], heads.normals[None], places)[0] / scale).to(device)
    far = drawn(int(FAR_SHARE * points), len(heads.volume.points), random)
    error = (head.identity.template(near) - (places.away / scale).to(device)).abs()
    truth = (heads.volume.distance[far] / scale).to(device)
    off = (head.identity.template((heads.volume.points[far] / scale).to(device)) - truth).abs()
    off = off / (1.0 + truth.abs() / 0.04)
    total = error.mean() + FAR_WEIGHT * off.mean()
    if step % EIKONAL_EVERY == 0:
        x = near[: points // 8].clone().requires_grad_()
        slope = torch.autograd.grad(head.identity.template(x).sum(), x, create_graph=True)[0]
        total = total + EIKONAL * (slope.norm(dim=1) - 1.0).square().mean()
    return total, {"near mm": 1e3 * scale * error.mean().item(), "far mm": 1e3 * scale * off.mean().item()}


def uneven(error: Tensor, normals: Tensor, scale: float) -> Tensor:
    """Lengths [B, P] of errors [B, P, 3]. The part along the normal weighs more."""
    along = (error * normals).sum(-1)
    floor = EVEN_M / scale
    return (error.square().sum(-1) + NORMAL_WEIGHT * along.square() + floor**2).sqrt() - floor


def identity_loss(head: Head, heads: IctHeads, pool: Pool, count: int, points: int, random: torch.Generator):
    """Loss of the map to the mean head, for points on, near and around the surface."""
    scale, device = head.config.scale_m, head.identity_code.weight.device
    chosen = pool.draw(count)
    vertices, normals = pool.vertices[chosen], pool.normals[chosen]
    z = head.identity_code(pool.coefficients[chosen].to(device))
    places = heads.places[drawn(points, len(heads.places), random)]
    on = heads.normal(heads.normals[None], places)
    goal = (heads.on(heads.opened[None], places) + places.away[:, None] * on) / scale
    here = heads.at(vertices, normals, places) / scale
    rows = drawn(int(FAR_SHARE * points), len(heads.volume.points), random)
    far_goal = heads.volume.points[rows] / scale
    corners = heads.volume.carriers[rows]
    moves = vertices[:, corners] - heads.opened[corners]
    far = far_goal + (heads.volume.share[rows][..., None] * moves).sum(2) / scale
    x, goal, far_goal, on = (t.to(device) for t in (torch.cat([here, far], 1), goal, far_goal, on))
    predicted = x + head.identity.to_mean(x, z)
    error, off = predicted[:, :points] - goal, predicted[:, points:] - far_goal
    near = uneven(error, on, scale).mean()
    calm = (1.0 / (1.0 + heads.volume.distance[rows].abs() / 0.01)).to(device)
    total = near + FAR_WEIGHT * (off.norm(dim=-1) * calm).mean()
    mm = 1e3 * scale
    return total, {
        "along mm": mm * (error * on).sum(-1).abs().mean().item(),
        "whole mm": mm * error.norm(dim=-1).mean().item(),
        "far mm": mm * off.norm(dim=-1).mean().item(),
    }


def by_rate(head: Head, learned: list[Tensor], rate: float) -> list[dict]:
    """Parameter groups for the optimiser.

    Layers that output displacements learn more slowly, because displacements are small. So do layers that
    sum over many numbers of a code, because a step changes all terms of the sum at once.
    """
    chosen = {id(p) for p in learned}
    slow = (".out", ".press.", ".code.", "expression_code")
    last = {id(p) for name, p in head.named_parameters() if any(part in name for part in slow)}
    return [
        {"params": [p for p in head.parameters() if id(p) in chosen - last], "lr": rate},
        {"params": [p for p in head.parameters() if id(p) in chosen & last], "lr": OUT_RATE * rate},
    ]


def compute_on(machine: Machine, head: Head) -> None:
    """Moves a head to the machine. From here on its networks multiply in the machine's precision."""
    head.to(machine.device)
    if machine.dtype is None:
        return
    fields = (head.identity.template, *head.identity.locals, head.backward_field, head.forward_field)
    for field in fields:
        field.forward = _rounded(machine, field.forward)


def _rounded(machine: Machine, forward: Callable[..., Tensor]) -> Callable[..., Tensor]:
    def rounded(*inputs: Tensor) -> Tensor:
        with machine.autocast():
            return forward(*inputs).float()

    return rounded


def poses_of(arguments) -> Poses:
    """Poses from the training clips of the corpus folders, or else from the project's own recordings."""
    if not arguments.corpus:
        return Poses(arguments.data)
    entries = arkit.of_folders(arguments.corpus, 1, arguments.seed)
    rows = [entry.motion for entry in entries if not entry.held_out]
    if not rows:
        raise ValueError("--corpus: expected training clips with motion, got none")
    return Poses.of(torch.cat(rows))


def train(arguments) -> Path:
    """Runs the training; writes `head.pt` and returns its path."""
    if arguments.corpus and arguments.part != "expression":
        alone = "the part expression, which alone learns from recordings"
        raise ValueError(f"--corpus: expected {alone}, got {arguments.part}")
    seeded(arguments)
    machine = Machine(arguments.device, arguments.precision)
    if arguments.start is None:
        config = CONFIGS[arguments.config]()
        config.channels = list(CHANNELS)
        config.expression_octaves = arguments.octaves or config.expression_octaves
        head = Head(config)
    else:
        head = load_head(arguments.start, arguments.octaves)
        config = head.config
    heads = IctHeads(arguments.data, arguments.cache, config.open_jaw)
    random = torch.Generator().manual_seed(machine.seed(arguments.seed) + 1)
    if arguments.part == "template":
        set_bounds(head, heads)
        set_directions(head, heads)
        if arguments.start is None:
            print({name: round(value, 3) for name, value in set_codes(head, heads).items()})
        learned = list(head.identity.template.parameters())
    elif arguments.part == "identity":
        learned = list(head.identity.locals.parameters())
    else:
        learned = [*head.backward_field.parameters(), *head.forward_field.parameters()]
        learned += [] if arguments.keep_codes else list(head.expression_code.parameters())
    expression = ExpressionLoss(heads, poses_of(arguments)) if arguments.part == "expression" else None
    pool = Pool(heads, arguments.pool, random) if arguments.part != "template" else None
    compute_on(machine, head)
    machine.place(head, arguments.seed)
    rate = arguments.rate or RATES[arguments.part]
    groups = by_rate(head, learned, rate)
    run = begin(
        arguments, head, {"random": random}, groups=groups, decay=0.0, warm=0.05, average=None, name="head",
        machine=machine, extra={} if pool is None else {"pool": pool}, final_div_factor=100.0,
    )  # fmt: skip

    def loss(step: int) -> tuple[Tensor, dict[str, float]]:
        if arguments.part == "template":
            return template_loss(head, heads, arguments.points, step, random)
        if arguments.part == "identity":
            return identity_loss(head, heads, pool, arguments.heads, arguments.points, random)
        exact, cycle = step < arguments.exact * arguments.steps, step % 2 == 1
        return expression(head, pool, arguments.heads, arguments.points, exact, cycle, random)

    def judge(head: Head) -> dict[str, float]:
        save(run.out / "head.pt", head)
        return {}

    descend(arguments, run, loss, judge, 0.1, torch.nn.ParameterList(learned))
    return arguments.out / "head.pt"


def parser() -> argparse.ArgumentParser:
    """Command line."""
    parser = trainer_parser(__doc__, "runs/facetalk", 3000, None, log_every=100, save_every=500, corpus=False)
    parser.add_argument("part", choices=list(RATES))
    parser.add_argument(
        "--corpus", type=Path, nargs="*", default=[], help="corpus folders, for the part expression only"
    )
    add_arguments(parser, "float32")
    parser.add_argument("--stop-at", type=int, help="stop after this step; the same command goes on")
    parser.add_argument("--start", type=Path, help="head.pt of the part before, or of this one to go on")
    parser.add_argument("--config", choices=list(CONFIGS), default="compact")
    parser.add_argument("--heads", type=int, default=24, help="heads in a batch")
    parser.add_argument("--pool", type=int, default=400, help="heads held in memory")
    parser.add_argument("--points", type=int, default=512, help="points of each head")
    parser.add_argument("--exact", type=float, default=0.6,
                        help="share of steps before places come from the identity field")  # fmt: skip
    parser.add_argument("--keep-codes", action="store_true", help="do not train the map of expressions")
    parser.add_argument("--octaves", type=int,
                        help="octaves of places for deformations; few at first, later more")  # fmt: skip
    parser.add_argument("--rate", type=float)
    return parser


if __name__ == "__main__":
    train(parser().parse_args())
