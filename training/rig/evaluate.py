"""Prints the errors of generated ARKit shapes on faces they were not trained on.

    python -m training.rig.evaluate --data ../shared/data --runs runs/rig --corpus runs/stm/corpus.pkl

It measures the shipped network and those that `training.rig.train` left in `--runs`. An error is the mean
distance in millimetres over the vertices that truly move more than 0.5 mm, each shape at strength 1. It is
measured on test identities, warps and triangulations of ICT and on the MakeHuman head as it is and remeshed.
All shapes have the same weight. The mean over all vertices and the true motion are printed too. So are the
errors of the visemes, which are mixtures of shapes.
"""

import argparse
from pathlib import Path

import numpy as np
import torch

from training import shipped
from training.corpus.faces import CHANNELS
from training.corpus.prepared import COUNTS, PreparedMesh, load_or_build
from training.nn.checkpoint import load_model, restored
from training.rig.network import CONFIGS, RigConfig, RigNetwork
from training.rig.train import FACES, MOVING_DM, skin
from training.rig.visemes import solve
from training.rig.whole_heads import print_errors


def errors(shapes, meshes: list[PreparedMesh]) -> np.ndarray:
    """Per shape: error over moving vertices, their true motion, error over all vertices. [S, 3] mm.

    shapes: function from a mesh to [S, V, 3] dm.
    """
    rows = []
    for mesh in meshes:
        truth = mesh.modes
        length = truth.norm(dim=-1)
        moving = length > MOVING_DM
        error = (shapes(mesh) - truth).norm(dim=-1)
        count = moving.sum(1).clamp_min(1)
        row = [(error * moving).sum(1) / count, (length * moving).sum(1) / count, error.mean(1)]
        rows.append(100.0 * torch.stack(row, 1).numpy())
    return np.mean(rows, axis=0)


def shipped_network() -> RigNetwork:
    """The network of the repository."""
    return load_model(shipped("rig"), lambda config: RigNetwork(RigConfig(config["width"])))


def networks(runs: Path) -> dict[str, RigNetwork]:
    """The shipped network and those in `runs`, by name."""
    models = {"shipped": shipped_network()}
    for name in FACES:
        if (path := runs / f"rig_{name}.pt").exists():
            models[name] = restored(RigNetwork(CONFIGS["rig"]), torch.load(path))
    return models


def print_visemes(data: Path) -> None:
    """Prints how far mixtures of shapes are from MakeHuman's visemes: range and means."""
    _, errors = solve(data)
    error, motion = np.mean(list(errors.values()), axis=0)
    order = sorted(errors, key=lambda name: errors[name])
    least, most = (f"{name} {errors[name][0]:.2f} mm" for name in (order[0], order[-1]))
    print(f"visemes: {error:.2f} mm of {motion:.2f} mm in the mean, from {least} to {most}")


def main() -> None:
    """Entry of the command."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--data", type=Path, default=Path("../shared/data"))
    parser.add_argument("--runs", type=Path, default=Path("runs/rig"))
    parser.add_argument("--corpus", type=Path, default=Path("runs/stm/corpus.pkl"))
    parser.add_argument("--anyface", type=Path, help="the command, to measure whole heads too")
    of_shapes = "each shape, for the model card; needs rig_ict.pt in --runs"
    parser.add_argument("--table", action="store_true", help=of_shapes)
    args = parser.parse_args()
    torch.set_num_threads(1)
    if args.anyface:
        print_errors(args.anyface, args.data)
    corpus = load_or_build(args.data, args.corpus, COUNTS)
    print_visemes(args.data)
    results = {}
    with torch.no_grad():
        for name, model in networks(args.runs).items():
            for kind, shapes in (("network", model), ("landmarks alone", model.spread)):
                for face, meshes in corpus.test.items():
                    table = errors(lambda mesh, shapes=shapes: shapes(skin(mesh)), meshes)
                    results[name, kind, face] = table
                    moving, motion, every = table.mean(0)
                    print(
                        f"{name:10} {kind:16} on {face:10} moving {moving:.3f} mm "
                        f"(motion {motion:.2f}), all vertices {every:.3f} mm",
                        flush=True,
                    )
    if args.table:
        print("| shape | ICT unseen, error (motion) | MakeHuman left out, error (motion) |")
        print("| --- | --- | --- |")
        for i, channel in enumerate(CHANNELS):
            a, b = results["shipped", "network", "ict"][i], results["ict", "network", "makehuman"][i]
            print(f"| {channel} | {a[0]:.2f} ({a[1]:.2f}) | {b[0]:.2f} ({b[1]:.2f}) |")


if __name__ == "__main__":
    main()
