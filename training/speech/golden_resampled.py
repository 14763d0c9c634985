"""Golden of encoders whose convolution outputs are resampled to motion frames before the transformer."""

import json
import math
from pathlib import Path

from safetensors import safe_open
from safetensors.torch import load_file
from torch import Tensor

from training.goldens import write_golden
from training.speech.hubert import encode, transformer

FPS = 30.0
NAMES = ("hubert_tiny", "wav2vec2_tiny", "wav2vec2_stable_tiny")


def encoded(path: Path, fps: float) -> Tensor:
    """Output [T, C] of Hugging Face's own modules, with resampling between the first and the second."""
    with safe_open(path, "pt") as file:
        config = json.loads(file.metadata()["config"])
    tensors = load_file(path)
    weights = {k.removeprefix("weights."): v for k, v in tensors.items() if k.startswith("weights.")}
    samples = tensors["input"].flatten()
    frames = math.ceil(len(samples) / 16000 * fps)
    return encode(transformer(config, weights), config, samples, frames, fps)


def write(out: Path, shared: Path) -> Path:
    """`NAME` [T, C] at 30 fps for each of `NAMES`; `shared/parity/NAME.safetensors` has weights and input."""
    tensors = {name: encoded(shared / "parity" / f"{name}.safetensors", FPS) for name in NAMES}
    return write_golden(out / "resampled_speech.safetensors", tensors, "resampled_speech", fps=str(FPS))
