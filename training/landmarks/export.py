"""Writes a trained network as the model files that Rust embeds.

python -m training.landmarks.export --runs runs/landmarks --out rust-core/models/landmarks
"""

import argparse
from pathlib import Path

import torch

from training.landmarks.network import Config, LandmarkNetwork, save


def main() -> None:
    """Entry of the command."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--runs", type=Path, default=Path("runs/landmarks"))
    parser.add_argument("--out", type=Path, default=Path("rust-core/models/landmarks"))
    args = parser.parse_args()
    model = LandmarkNetwork(Config())
    model.load_state_dict(torch.load(args.runs / "network.pt")["model"])
    model.fold()
    save(model, args.out)


if __name__ == "__main__":
    main()
