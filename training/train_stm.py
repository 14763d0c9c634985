"""Trains the learned part of Sparse-To-Mesh.

    python -m training.train_stm static --data ../shared/data --runs runs/stm
    python -m training.train_stm paper  --data ../shared/data --runs runs/stm

Each command trains three times: on both faces (shipped), on ICT alone and on MakeHuman alone (for
the leave-one-face-out errors), seeded, one thread by default. Results are
`RUNS/{static,paper}_{both,ict,makehuman}.pt`; `training.evaluate_stm` prints their errors and
`training.export_stm` writes the shipped one.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path

import numpy as np
import torch

from training.corpus.expressions import load_speech, training_frames
from training.corpus.prepared import Corpus, PreparedMesh, landmark_shapes, load_or_build
from training.deform.static_weights import (
    CONFIGS,
    FLIP,
    MIRROR,
    StaticWeights,
    VertexGeometry,
)
from training.systems.freetalk.stm.paper import CONFIGS as PAPER
from training.systems.freetalk.stm.train_paper import paper_mesh, train_paper

SHAPES = 1500
"""Neutral faces of each kind by which a familiar one is told."""

FACES = {"both": ("ict", "makehuman"), "ict": ("ict",), "makehuman": ("makehuman",)}


def sample(rng: np.random.Generator, mesh: PreparedMesh, speech: np.ndarray, frames: int):
    """Some vertices of a mesh, more at the lips, in some frames, at times seen in the mirror.

    Returns the vertices' geometry, landmark displacements [T, N, 3] and true displacements
    [T, P, 3], decimetres.
    """
    vertices, lips = len(mesh.lips), mesh.lips.nonzero()[:, 0]
    pick = torch.cat(
        [torch.randint(vertices, (500,)), lips[torch.randint(len(lips), (150,))], mesh.landmarks]
    )
    weights = torch.from_numpy(training_frames(rng, speech, frames)).float()
    g = mesh.geometry
    motion = torch.einsum("tm,mvx->tvx", weights, mesh.modes[:, pick])
    motion = restyle(motion, g.positions[pick], strength=0.15)
    geometry = VertexGeometry(g.positions[pick], g.landmarks, g.base[pick], g.remoteness[pick])
    landmarks = motion[:, -len(mesh.landmarks) :]
    if rng.random() < 0.5:
        return geometry.mirrored(), landmarks[:, MIRROR] * FLIP, motion * FLIP
    return geometry, landmarks, motion


def restyle(motion: torch.Tensor, positions: torch.Tensor, strength: float) -> torch.Tensor:
    """Multiplies motion by a smooth random field of matrices near one, another one each frame.

    Real faces differ in how they move, the corpus does not: this keeps the network from taking
    one face's habits for a law. motion: [T, P, 3]; positions: [P, 3] dm.
    """
    bumps = 6
    centres = positions[torch.randint(len(positions), (bumps,))] + 0.1 * torch.randn(bumps, 3)
    width = torch.empty(bumps).uniform_(0.2, 0.6)
    amount = torch.exp(-0.5 * (torch.cdist(positions, centres) / width) ** 2)
    field = torch.einsum(
        "pk,tkij->tpij", amount, strength * torch.randn(len(motion), bumps, 3, 3)
    )
    return motion + torch.einsum("tpij,tpj->tpi", field, motion)


def train_static(corpus: Corpus, faces: tuple[str, ...], speech: np.ndarray, steps: int, seed: int):
    """Minimises the mean distance to the true place, at full strength of the correction."""
    torch.manual_seed(seed)
    rng = np.random.default_rng(seed)
    model = StaticWeights(CONFIGS["static"])
    rows = torch.cat([m.geometry.features()[::7] for f in faces for m in corpus.train[f]])
    model.feature_mean.copy_(rows.mean(0))
    model.feature_scale.copy_(rows.std(0) + 1e-3)
    optimiser = torch.optim.AdamW(model.parameters(), lr=2e-3, weight_decay=1e-2)
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimiser, 2e-3, steps, pct_start=0.1)
    started = time.monotonic()
    for step in range(steps):
        loss = torch.zeros(())
        for face in faces * (2 // len(faces)):
            mesh = corpus.train[face][rng.integers(len(corpus.train[face]))]
            geometry, landmarks, truth = sample(rng, mesh, speech, frames=12)
            base = torch.einsum("vn,tnx->tvx", geometry.base, landmarks)
            error = base + model.one_sided_correction(geometry, landmarks) - truth
            loss = loss + (100.0 * error.square().sum(-1) + 1e-4).sqrt().mean()
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
        schedule.step()
        if step % 250 == 0:
            seconds = time.monotonic() - started
            print(f"static {faces} {step}: {loss.item():.4f} {seconds:.0f} s", flush=True)
    return model


def learn_shapes(model: StaticWeights, faces: tuple[str, ...], data: Path, seed: int) -> None:
    """Shows the model the landmarks of many neutral faces; one face takes all kinds of the model."""
    rng = np.random.default_rng(seed)
    for kind in range(model.config.kinds):
        shapes = landmark_shapes(rng, data, faces[kind % len(faces)], SHAPES)
        model.learn_shapes(kind, torch.from_numpy(shapes).float())


def coarsest(meshes: list[PreparedMesh], count: int) -> list[PreparedMesh]:
    """The `count` meshes with the fewest vertices: a step costs as much as its vertices."""
    return sorted(meshes, key=lambda mesh: len(mesh.lips))[:count]


def main() -> None:
    """Entry of the command."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("model", choices=["static", "paper"])
    parser.add_argument("--data", type=Path, default=Path("../shared/data"))
    parser.add_argument("--runs", type=Path, default=Path("runs/stm"))
    parser.add_argument("--faces", nargs="*", choices=list(FACES), default=list(FACES))
    parser.add_argument("--steps", type=int, default=5000)
    parser.add_argument("--seconds", type=float, default=180.0, help="processor time, paper")
    parser.add_argument("--meshes", type=int, default=14, help="of each face, the coarsest, for paper")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--threads", type=int, default=1)
    args = parser.parse_args()
    torch.set_num_threads(args.threads)
    corpus = load_or_build(args.data, args.runs / "corpus.pkl", 70, 45)
    speech = load_speech(args.data).train
    for name in args.faces:
        if args.model == "static":
            model = train_static(corpus, FACES[name], speech, args.steps, args.seed)
            learn_shapes(model, FACES[name], args.data, args.seed)
        else:
            meshes = {f: coarsest(corpus.train[f], args.meshes) for f in FACES[name]}
            seen = {f: [paper_mesh(m, PAPER["compact"]) for m in meshes[f]] for f in meshes}
            faces = FACES[name]
            model = train_paper(PAPER["compact"], faces, speech, args.seconds, args.seed, seen)
        torch.save(model.state_dict(), args.runs / f"{args.model}_{name}.pt")


if __name__ == "__main__":
    main()
