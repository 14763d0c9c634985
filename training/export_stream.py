"""Writes a finished causal student as the model folder that Rust reads.

    python -m training.export_stream --run runs/stream/stream.pt --models weights/freetalk

Weights are stored as f16; the motion's mean and deviation stay f32. The model card, README.md, is
written by hand.
"""

import argparse
import json
from pathlib import Path

import torch
from safetensors.torch import load_file

from training.export import write_model
from training.speech.causal import StreamConfig, StreamNet


def export(run: Path, models: Path) -> Path:
    """Writes the folder of the model, `stream` or `causal_speech`, and returns it."""
    saved = torch.load(run, map_location="cpu")
    return write_model(models / saved["config"]["model"], saved["state"], saved["config"])


def load_stream(models: Path) -> StreamNet:
    """The shipped student, ready for inference."""
    folder = models / "stream"
    model = StreamNet(StreamConfig.from_json(json.loads((folder / "config.json").read_text())))
    state = load_file(folder / "model.safetensors")
    model.load_state_dict({key: value.float() for key, value in state.items()})
    return model.eval()


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        "--run",
        type=Path,
        required=True,
        help="stream.pt of training.systems.freetalk.train_stream or train_causal_speech",
    )
    parser.add_argument("--models", type=Path, default=Path("weights/freetalk"))
    arguments = parser.parse_args()
    print(export(arguments.run, arguments.models))


if __name__ == "__main__":
    main()
