"""Writes a finished EmoFace run as the model folder that Rust reads.

    python -m training.export_emoface --run runs/emoface/emoface.pt --models rust-core/models

Weights are stored as f16; the template's vertices and the numbers of its spirals and triangles stay f32. The
project's own template also gets what its skin does between the landmarks (`systems.emoface.between`), measured
against the static weights and creases in `--models`; to be exported again after a change of these.
"""

import argparse
from pathlib import Path

import torch

from training.export import write_model
from training.systems.emoface.between import between


def export(run: Path, models: Path, data: Path = Path("../shared/data")) -> Path:
    """Writes `emoface_<name>/` and returns it."""
    saved = torch.load(run, map_location="cpu")
    state = {key: value for key, value in saved["state"].items() if not key.endswith("spirals")}
    state |= {key: saved[key].float() for key in ("vertices", "triangles", "spirals")}
    config = saved["config"] | {"triangles": len(saved["triangles"])}
    if config["template"] == "ict":
        shapes, read = between(data, models, saved["vertices"].numpy())
        state |= {"between.shapes": torch.from_numpy(shapes), "between.read": torch.from_numpy(read)}
        config |= {"between": shapes.shape[2], "between_read": read.shape[1] // 3}
    return write_model(models / f"emoface_{config['name']}", state, config)


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--run", type=Path, required=True, help="emoface.pt of training.train_emoface")
    parser.add_argument("--models", type=Path, default=Path("rust-core/models"))
    parser.add_argument("--data", type=Path, default=Path("../shared/data"))
    arguments = parser.parse_args()
    print(export(arguments.run, arguments.models, arguments.data))


if __name__ == "__main__":
    main()
