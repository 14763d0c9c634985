"""Prints the errors of generated ARKit shapes on faces they were not trained on.

    python -m training.rig.evaluate --data ../shared/data --runs runs/rig --corpus runs/stm/corpus.pkl

An error is the mean distance in millimetres over the vertices that truly move more than 0.5 mm, each
shape at strength 1. It is measured on test identities, warps and triangulations of ICT and on the
MakeHuman head as it is and remeshed. All shapes have the same weight. The mean over all vertices and the
true motion are printed too.
"""

import argparse
from pathlib import Path

import numpy as np
import torch

from training.corpus.faces import CHANNELS
from training.corpus.prepared import COUNTS, PreparedMesh, load_or_build
from training.rig.network import CONFIGS, RigNetwork
from training.rig.train import MOVING_DM, skin
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


def trained(path: Path):
    """Two functions from a mesh to its shapes, by the weights at `path`: the network, and landmarks alone."""
    model = RigNetwork(CONFIGS["rig"])
    model.load_state_dict(torch.load(path))
    return (lambda mesh: model(skin(mesh))), (lambda mesh: model.spread(skin(mesh)))


def main() -> None:
    """Entry of the command."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--data", type=Path, default=Path("../shared/data"))
    parser.add_argument("--runs", type=Path, default=Path("runs/rig"))
    parser.add_argument("--corpus", type=Path, default=Path("runs/stm/corpus.pkl"))
    parser.add_argument("--anyface", type=Path, help="the command, to measure whole heads too")
    parser.add_argument("--table", action="store_true", help="each shape, for the model card")
    args = parser.parse_args()
    torch.set_num_threads(1)
    if args.anyface:
        print_errors(args.anyface, args.data)
    corpus = load_or_build(args.data, args.corpus, COUNTS)
    results = {}
    with torch.no_grad():
        for name in ("both", "ict", "makehuman"):
            path = args.runs / f"rig_{name}.pt"
            if not path.exists():
                continue
            for kind, shapes in zip(("network", "landmarks alone"), trained(path), strict=True):
                for face, meshes in corpus.test.items():
                    table = errors(shapes, meshes)
                    results[name, kind, face] = table
                    moving, motion, every = table.mean(0)
                    print(
                        f"trained on {name:10} {kind:16} on {face:10} moving {moving:.3f} mm "
                        f"(motion {motion:.2f}), all vertices {every:.3f} mm, "
                        f"shapes under 0.6 mm: {(table[:, 0] < 0.6).sum()} of {len(table)}",
                        flush=True,
                    )
    if args.table:
        print("| shape | ICT unseen, error (motion) | MakeHuman left out, error (motion) |")
        print("| --- | --- | --- |")
        for i, channel in enumerate(CHANNELS):
            a, b = results["both", "network", "ict"][i], results["ict", "network", "makehuman"][i]
            print(f"| {channel} | {a[0]:.2f} ({a[1]:.2f}) | {b[0]:.2f} ({b[1]:.2f}) |")


if __name__ == "__main__":
    main()
