"""Writes the trained rig as the model folder that Rust reads.

    python -m training.export_rig --data ../shared/data --runs runs/rig --models weights/shared

model.safetensors is f16 except the feature statistics; config.json holds sizes, names and the
mixtures of the visemes. The model card, README.md, is written by hand.
"""

from __future__ import annotations

import argparse
import json
from dataclasses import asdict
from pathlib import Path

import torch
from safetensors.torch import save_file

from training.corpus.faces import CHANNELS
from training.rig.network import CONFIGS
from training.rig.visemes import solve

EXACT = ("feature_mean", "feature_scale")


def main() -> None:
    """Entry of the command."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--data", type=Path, default=Path("../shared/data"))
    parser.add_argument("--runs", type=Path, default=Path("runs/rig"))
    parser.add_argument("--models", type=Path, default=Path("weights/shared"))
    args = parser.parse_args()
    folder = args.models / "rig"
    folder.mkdir(parents=True, exist_ok=True)
    state = torch.load(args.runs / "rig_both.pt", map_location="cpu")
    stored = {k: v.contiguous() if k in EXACT else v.half().contiguous() for k, v in state.items()}
    save_file(stored, folder / "model.safetensors")
    (folder / "model.safetensors").chmod(0o644)
    mixtures, errors = solve(args.data)
    config = asdict(CONFIGS["rig"]) | {"shapes": CHANNELS, "visemes": mixtures}
    (folder / "config.json").write_text(json.dumps(config, indent=1) + "\n")
    for viseme, (error, motion) in errors.items():
        print(f"{viseme}: mixture is {error:.2f} mm from the true viseme, which moves {motion:.2f} mm")


if __name__ == "__main__":
    main()
