"""Writes a finished EmoFace run as the model folder that Rust reads.

    python -m training.export_emoface --run runs/emoface/emoface.pt --models weights/emoface

Weights are stored as f16; the template's vertices and the numbers of its spirals and triangles stay f32.
"""

import argparse
from pathlib import Path

import torch

from training.export import write_model


def export(run: Path, models: Path) -> Path:
    """Writes `emoface_<name>/` and returns it."""
    saved = torch.load(run, map_location="cpu")
    state = {key: value for key, value in saved["state"].items() if not key.endswith("spirals")}
    state |= {key: saved[key].float() for key in ("vertices", "triangles", "spirals")}
    config = saved["config"] | {"triangles": len(saved["triangles"])}
    return write_model(models / f"emoface_{config['name']}", state, config)


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        "--run", type=Path, required=True, help="emoface.pt of training.systems.emoface.train"
    )
    parser.add_argument("--models", type=Path, default=Path("weights/emoface"))
    arguments = parser.parse_args()
    print(export(arguments.run, arguments.models))


if __name__ == "__main__":
    main()
