"""Writes the trained Sparse-To-Mesh decoders as the model folders that Rust reads.

    python -m training.export_stm --runs runs/stm --models weights

`static_weights/` and `stm_paper/` (whichever has been trained) each get model.safetensors, f16 except
the statistics, and config.json; `--trained corpus` takes the decoder of corpus folders. The model
card, README.md, is written by hand.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path

import torch
from safetensors.torch import save_file

from training.export import model_folder

EXACT = ("feature_mean", "feature_scale", "shape_mean", "shape_basis")


def write_model(folder: Path, state: dict[str, torch.Tensor], config: dict) -> Path:
    """`model.safetensors` and `config.json` of one model."""
    folder.mkdir(parents=True, exist_ok=True)
    stored = {k: v.contiguous() if k in EXACT else v.half().contiguous() for k, v in state.items()}
    save_file(stored, folder / "model.safetensors")
    (folder / "model.safetensors").chmod(0o644)
    (folder / "config.json").write_text(json.dumps(config, indent=2) + "\n")
    return folder


def main(arguments: list[str] | None = None) -> None:
    """Entry of the command."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--runs", type=Path, default=Path("runs/stm"))
    parser.add_argument("--models", type=Path, default=Path("weights"))
    parser.add_argument("--trained", choices=["both", "corpus"], default="both")
    args = parser.parse_args(arguments)
    for name, kind in (("static_weights", "static"), ("stm_paper", "paper")):
        trained = args.runs / f"{kind}_{args.trained}.pt"
        if trained.exists():
            saved = torch.load(trained, map_location="cpu")
            print(write_model(model_folder(args.models, name), saved["state"], saved["config"]))


if __name__ == "__main__":
    main()
