"""Golden of the instants of speech features: HuBERT's features interpolated at motion frames."""

from pathlib import Path

import torch

from training.goldens import write_golden
from training.speech.hubert import at_motion_frames, instants

FPS = 30.0


def write(out: Path, shared: Path) -> Path:
    """`features` [40, 3] → `sampled` [26, 3] at 30 fps. `shared` is not used."""
    torch.manual_seed(3)
    config = {"conv_kernel": [10, 3, 3, 3, 3, 2, 2], "conv_stride": [5, 2, 2, 2, 2, 2, 2]}
    rate_hz, first_s = instants(config)
    features = torch.randn(40, 3)
    tensors = {"features": features, "sampled": at_motion_frames(features, rate_hz, first_s, 26, FPS)}
    about = {"rate_hz": str(rate_hz), "first_s": str(first_s), "fps": str(FPS), "tolerance": "1e-5"}
    return write_golden(out / "instants.safetensors", tensors, "instants", None, config, **about)
