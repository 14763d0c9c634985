"""Golden of encoders: what the convolutions hear is brought to the motion's frames before the transformer."""

import json
import math
from pathlib import Path

import torch
from safetensors import safe_open
from safetensors.torch import load_file
from torch import Tensor
from transformers import AutoConfig, AutoModel

from training.goldens import write_golden
from training.speech.hubert import at_motion_frames, instants

FPS = 30.0
NAMES = ("hubert_tiny", "wav2vec2_tiny", "wav2vec2_stable_tiny")


@torch.no_grad()
def encoded(path: Path, fps: float) -> Tensor:
    """The output of Hugging Face's own modules, [T, C], the interpolation between the first two of them."""
    with safe_open(path, "pt") as file:
        config = json.loads(file.metadata()["config"])
    tensors = load_file(path)
    model = AutoModel.from_config(AutoConfig.for_model(**config)).eval()
    weights = {k.removeprefix("weights."): v for k, v in tensors.items() if k.startswith("weights.")}
    missing, unknown = model.load_state_dict(weights, strict=False)
    if unknown or set(missing) - {"masked_spec_embed"}:
        raise ValueError(
            f"{path}: expected the weights of {config['model_type']}, got {unknown} for {missing}"
        )
    samples = tensors["input"].flatten()
    heard = model.feature_extractor(samples[None])[0].T
    frames = math.ceil(len(samples) / 16000 * fps)
    projected = model.feature_projection(at_motion_frames(heard, *instants(config), frames, fps)[None])
    projected = projected[0] if isinstance(projected, tuple) else projected
    return model.encoder(projected).last_hidden_state[0]


def write(out: Path, shared: Path) -> Path:
    """`NAME` [T, C] at 30 fps for each of `NAMES`; `shared/parity/NAME.safetensors` has weights and input."""
    tensors = {name: encoded(shared / "parity" / f"{name}.safetensors", FPS) for name in NAMES}
    return write_golden(out / "resampled_speech.safetensors", tensors, "resampled_speech", fps=str(FPS))
