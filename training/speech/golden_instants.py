"""Golden of the instants of speech features: HuBERT's features at the frames of a motion."""

import json
from pathlib import Path

import torch
from safetensors.torch import save_file

from training.speech.hubert import at_motion_frames, instants

COMMAND = "python -m training.goldens instants"
FPS = 30.0


def write(out: Path, shared: Path) -> Path:
    """`features` [40, 3] → `sampled` [26, 3] at 30 fps. `shared` is not used."""
    torch.manual_seed(3)
    config = {"conv_kernel": [10, 3, 3, 3, 3, 2, 2], "conv_stride": [5, 2, 2, 2, 2, 2, 2]}
    rate_hz, first_s = instants(config)
    features = torch.randn(40, 3)
    tensors = {"features": features, "sampled": at_motion_frames(features, rate_hz, first_s, 26, FPS)}
    about = {"rate_hz": str(rate_hz), "first_s": str(first_s), "fps": str(FPS), "config": json.dumps(config)}
    path = out / "instants.safetensors"
    save_file(tensors, path, about | {"tolerance": "1e-5", "command": COMMAND})
    return path
