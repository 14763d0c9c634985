"""Writes the trained Sparse-To-Mesh decoders as the model folders that Rust reads.

    python -m training.export_stm --runs runs/stm --models rust-core/models

`static_weights/` and `stm_paper/` (whichever has been trained) each get model.safetensors, f16 except
the statistics, and config.json. The model card, README.md, is written by hand.
"""

from __future__ import annotations

import argparse
import json
from dataclasses import asdict
from pathlib import Path

import torch
from safetensors.torch import save_file

from training.deform import static_weights
from training.systems.freetalk.stm import paper

EXACT = ("feature_mean", "feature_scale", "shape_mean", "shape_basis")


def write_model(folder: Path, state: dict[str, torch.Tensor], config: dict) -> Path:
    """`model.safetensors` and `config.json` of one model."""
    folder.mkdir(parents=True, exist_ok=True)
    stored = {k: v.contiguous() if k in EXACT else v.half().contiguous() for k, v in state.items()}
    save_file(stored, folder / "model.safetensors")
    (folder / "model.safetensors").chmod(0o644)
    (folder / "config.json").write_text(json.dumps(config, indent=2) + "\n")
    return folder


def main() -> None:
    """Entry of the command."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--runs", type=Path, default=Path("runs/stm"))
    parser.add_argument("--models", type=Path, default=Path("rust-core/models"))
    args = parser.parse_args()
    shipped = {
        "static_weights": ("static", asdict(static_weights.CONFIGS["static"])),
        "stm_paper": ("paper", asdict(paper.CONFIGS["compact"])),
    }
    for name, (kind, config) in shipped.items():
        trained = args.runs / f"{kind}_both.pt"
        if trained.exists():
            state = torch.load(trained, map_location="cpu")
            print(write_model(args.models / name, state, config))


if __name__ == "__main__":
    main()
