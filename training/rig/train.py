"""Trains the network for the part of the ARKit shapes that landmarks cannot express.

    python -m training.rig.train --data ../shared/data --runs runs/rig --corpus runs/stm/corpus.pkl

Trains three times, each seeded and on one thread: on both faces (shipped), on ICT alone and on MakeHuman
alone (to measure errors on the face left out). Results are `RUNS/rig_{both,ict,makehuman}.pt`;
`training.rig.evaluate` prints their errors and `training.export rig` writes the shipped one.
"""

import argparse
import time
from pathlib import Path

import numpy as np
import torch

from training.corpus.faces import load_ict, load_makehuman
from training.corpus.prepared import COUNTS, Corpus, PreparedMesh, load_or_build
from training.deform.static_weights import FLIP
from training.rig.network import CONFIGS, RigNetwork, SkinGeometry
from training.rig.shapes import SHAPE_MIRROR, templates
from training.run import downhill

FACES = {"both": ("ict", "makehuman"), "ict": ("ict",), "makehuman": ("makehuman",)}
STILL_WEIGHT = 0.3
"""Loss weight of a vertex that a shape leaves at rest. A vertex that moves weighs 1."""
MOVING_DM = 0.005
"""A vertex counts as moving if its true displacement exceeds this (in dm: 0.5 mm)."""


def skin(mesh: PreparedMesh, pick: torch.Tensor | slice = slice(None)) -> SkinGeometry:
    """The geometry of the vertices `pick` of a mesh."""
    g = mesh.geometry
    return SkinGeometry(g.positions[pick], g.landmarks, g.base[pick])


def sample(rng: np.random.Generator, mesh: PreparedMesh) -> tuple[SkinGeometry, torch.Tensor]:
    """Random vertices, more of them at lips and lids, and their true shapes [S, P, 3] dm.

    Half of the time both are mirrored.
    """
    lips = mesh.lips.nonzero()[:, 0]
    lids = torch.cdist(mesh.geometry.positions, mesh.geometry.landmarks[36:48]).min(1).values
    lids = (lids < 0.1).nonzero()[:, 0]
    pick = torch.cat(
        [
            torch.randint(len(mesh.lips), (700,)),
            lips[torch.randint(len(lips), (300,))],
            lids[torch.randint(len(lids), (200,))],
        ]
    )
    geometry, truth = skin(mesh, pick), mesh.modes[:, pick]
    if rng.random() < 0.5:
        return geometry.mirrored(), truth[SHAPE_MIRROR] * FLIP
    return geometry, truth


def loss_of(error: torch.Tensor, truth: torch.Tensor) -> torch.Tensor:
    """Mean distance in mm; moving vertices count more. Both [S, P, 3] dm."""
    distance = (1e4 * error.square().sum(-1) + 1e-4).sqrt()
    weight = torch.where(truth.norm(dim=-1) > MOVING_DM, 1.0, STILL_WEIGHT)
    return (weight * distance).sum() / weight.sum()


def train(
    corpus: Corpus,
    faces: tuple[str, ...],
    template: np.ndarray,
    steps: int,
    seed: int,
    init: Path | None,
):
    """Trains one network. template: [S, N, 3] m. init: weights to start from."""
    torch.manual_seed(seed)
    rng = np.random.default_rng(seed)
    model = RigNetwork(CONFIGS["rig"])
    model.templates.copy_(torch.from_numpy(10.0 * template))
    rows = torch.cat([skin(m).features()[::7] for f in faces for m in corpus.train[f]])
    model.feature_mean.copy_(rows.mean(0))
    model.feature_scale.copy_(rows.std(0) + 1e-2)
    if init is not None:
        model.load_state_dict(torch.load(init))
    optimiser = torch.optim.AdamW(model.parameters(), lr=2e-3, weight_decay=1e-2)
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimiser, 3e-3, steps, pct_start=0.1)
    started = time.monotonic()
    for step in range(steps):
        loss = torch.zeros(())
        for face in faces:
            mesh = corpus.train[face][rng.integers(len(corpus.train[face]))]
            geometry, truth = sample(rng, mesh)
            error = model.spread(geometry) + model.one_sided(geometry) - truth
            loss = loss + loss_of(error, truth) / len(faces)
        downhill(loss, optimiser, schedule)
        if step % 250 == 0:
            print(f"rig {faces} {step}: {loss.item():.4f} {time.monotonic() - started:.0f} s", flush=True)
    return model


def main() -> None:
    """Entry of the command."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--data", type=Path, default=Path("../shared/data"))
    parser.add_argument("--runs", type=Path, default=Path("runs/rig"))
    parser.add_argument("--corpus", type=Path, default=Path("runs/stm/corpus.pkl"))
    parser.add_argument("--faces", nargs="*", choices=list(FACES), default=list(FACES))
    parser.add_argument("--steps", type=int, default=6000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--init", type=Path, help="weights to go on from")
    args = parser.parse_args()
    torch.set_num_threads(1)
    corpus = load_or_build(args.data, args.corpus, COUNTS)
    known = {"ict": load_ict(args.data, "face").mean, "makehuman": load_makehuman(args.data)}
    args.runs.mkdir(parents=True, exist_ok=True)
    for name in args.faces:
        template = templates([known[face] for face in FACES[name]])
        model = train(corpus, FACES[name], template, args.steps, args.seed, args.init)
        torch.save(model.state_dict(), args.runs / f"rig_{name}.pt")


if __name__ == "__main__":
    main()
