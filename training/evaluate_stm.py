"""Prints the errors of Sparse-To-Mesh on faces it did not see.

    python -m training.evaluate_stm --shared ../shared --runs runs/stm

Held-out take of facegood_zh plus upper face, at test identities, warps and triangulations of ICT
and at the MakeHuman head as it is and remeshed. Mean distance in millimetres over all vertices /
over the lips (within 1 cm of a lip landmark), frames and meshes weighted alike.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path

import numpy as np
import torch

from training.corpus.expressions import evaluation_frames, load_speech
from training.corpus.prepared import Corpus, PreparedMesh, load_or_build
from training.systems.freetalk.stm.static_weights import CONFIGS, StaticWeights, deform

Method = Callable[[PreparedMesh, torch.Tensor], torch.Tensor]


def errors(method: Method, meshes: list[PreparedMesh], speech: np.ndarray) -> tuple[float, float]:
    """Mean and lip error in mm of a method that takes a mesh and landmark motion [T, N, 3] dm."""
    rng = np.random.default_rng(9)
    mean, lips = [], []
    for mesh in meshes:
        weights = torch.from_numpy(evaluation_frames(rng, speech, 100)).float()
        truth = torch.einsum("tm,mvx->tvx", weights, mesh.modes)
        error = 100.0 * (method(mesh, truth[:, mesh.landmarks]) - truth).norm(dim=-1)
        mean.append(error.mean().item())
        lips.append(error[:, mesh.lips].mean().item())
    return float(np.mean(mean)), float(np.mean(lips))


def no_motion(mesh: PreparedMesh, landmarks: torch.Tensor) -> torch.Tensor:
    """The floor: nothing moves."""
    return torch.zeros(len(landmarks), len(mesh.lips), 3)


def static(path: Path, learned: float) -> Method:
    """The static decoder with the weights of `path`."""
    model = StaticWeights(CONFIGS["static"])
    model.load_state_dict(torch.load(path))
    return lambda mesh, landmarks: deform(model, mesh.geometry, landmarks, learned)


def training_free(mesh: PreparedMesh, landmarks: torch.Tensor) -> torch.Tensor:
    """The tension-screened biharmonic weights alone."""
    return torch.einsum("vn,tnx->tvx", mesh.geometry.base, landmarks)


def rows(runs: Path) -> list[tuple[str, Method]]:
    """Every method that `runs` has weights for."""
    table = [("no motion", no_motion), ("training-free (TSB)", training_free)]
    for faces in ("both", "ict", "makehuman"):
        path = runs / f"static_{faces}.pt"
        for learned in (1.0, 1.5, 2.0, 2.5) if path.exists() else ():
            table.append((f"static, trained on {faces}, learned {learned:g}", static(path, learned)))
    return table


def print_table(corpus: Corpus, speech: np.ndarray, runs: Path) -> None:
    """One line a method: ICT, then MakeHuman."""
    print(f"{'mm: mean / lips':44} {'ICT unseen':>16} {'MakeHuman':>16}")
    with torch.no_grad():
        for name, method in rows(runs):
            cells = [errors(method, corpus.test[f], speech) for f in ("ict", "makehuman")]
            print(f"{name:44} " + " ".join(f"{m:9.3f} /{lips:6.3f}" for m, lips in cells), flush=True)


def main() -> None:
    """Entry of the command."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--shared", type=Path, default=Path("../shared"))
    parser.add_argument("--runs", type=Path, default=Path("runs/stm"))
    args = parser.parse_args()
    torch.set_num_threads(1)
    corpus = load_or_build(args.shared, args.runs / "corpus.pkl", 70, 45)
    print_table(corpus, load_speech(args.shared).test, args.runs)


if __name__ == "__main__":
    main()
