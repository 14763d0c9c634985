"""HuBERT, wav2vec2 and Whisper features for any configuration, from the user's checkpoint folder.

HuBERT and wav2vec2 run in Hugging Face's own modules, which `rust-core/src/speech/transformer_encoder.rs`
mirrors. Whisper runs in `training.speech.whisper`. Nothing is downloaded. The folder contains config.json,
model.safetensors or pytorch_model.bin, and optionally preprocessor_config.json.
"""

import json
import math
from pathlib import Path

import torch
from safetensors.torch import load_file
from torch import Tensor, nn

from training.speech import whisper

SAMPLE_HZ = 16000
FPS = 25.0
"""Frame rate of training clips, unless a trainer sets another."""
MODELS = ("hubert", "wav2vec2")
WHISPER = "whisper"


class HubertFeatures:
    """The output of the encoder, resampled to the motion's frame rate `fps`.

    With `transformer_fps` the output of the convolutions is first resampled to that rate, before projection
    and transformer, as in FaceFormer (Fan et al. 2022, section 3.2). Whisper ignores `transformer_fps`, since
    its position encodings fit only its own rate.
    """

    def __init__(self, folder: Path | None, transformer_fps: float | None = None, fps: float = FPS):
        if folder is None:
            raise ValueError(
                "--hubert: expected a folder with a HuBERT, wav2vec2 or Whisper checkpoint, got nothing"
            )
        self.config = json.loads((folder / "config.json").read_text())
        self.kind = self.config.get("model_type")
        if self.kind not in (*MODELS, WHISPER):
            expected = f"{', '.join(MODELS)} or {WHISPER}"
            raise ValueError(f"{folder}/config.json: model_type: expected {expected}, got {self.kind}")
        self.fps = fps
        if self.kind == WHISPER:
            self.model, self.transformer_fps = whisper.load_hugging_face(folder), None
            self.channels = self.model.config.width
            return
        preprocessor = folder / "preprocessor_config.json"
        about = json.loads(preprocessor.read_text()) if preprocessor.exists() else {}
        self.normalise = about.get("do_normalize", True)
        self.model = transformer(self.config, read_checkpoint(folder, self.kind))
        self.channels = self.config["hidden_size"]
        self.transformer_fps = transformer_fps

    @torch.no_grad()
    def __call__(self, samples: Tensor, frames: int) -> Tensor:
        """`samples` [S] at 16 kHz → [frames, C], interpolated linearly; frame i is at i / `fps` seconds."""
        return self.hear(samples, frames)

    def hear(self, samples: Tensor, frames: int) -> Tensor:
        """The same as a call, but with gradients. Whisper gives none."""
        if self.kind == WHISPER:
            (heard,) = self.model.hear(whisper.whisper_mel(samples), [self.model.config.layers])
            return at_motion_frames(heard, whisper.RATE_HZ, 0.0, frames, self.fps)
        if self.normalise:
            samples = (samples - samples.mean()) / (samples.var(correction=0) + 1e-7).sqrt()
        if self.transformer_fps is None:
            heard = run_encoder(self.model, self.config, samples, None, self.fps)
            return at_motion_frames(heard, *instants(self.config), frames, self.fps)
        count = max(math.ceil(len(samples) / SAMPLE_HZ * self.transformer_fps - 1e-6), 1)
        heard = run_encoder(self.model, self.config, samples, count, self.transformer_fps)
        return at_motion_frames(heard, self.transformer_fps, 0.0, frames, self.fps)


@torch.no_grad()
def encode(
    model: nn.Module, config: dict, samples: Tensor, frames: int | None = None, fps: float = FPS
) -> Tensor:
    """`run_encoder` without gradients."""
    return run_encoder(model, config, samples, frames, fps)


def run_encoder(model: nn.Module, config: dict, samples: Tensor, frames: int | None, fps: float) -> Tensor:
    """Output [T, C] of `model` for `samples` [S], which are not normalised here, at the model's own rate.

    With `frames` the output of the convolutions is first resampled to that many frames at `fps`.
    """
    heard = model.feature_extractor(samples[None])[0].T
    if frames is not None:
        heard = at_motion_frames(heard, *instants(config), frames, fps)
    projected = model.feature_projection(heard[None])
    projected = projected[0] if isinstance(projected, tuple) else projected
    return model.encoder(projected).last_hidden_state[0]


def transformer(config: dict, state: dict[str, Tensor]) -> nn.Module:
    """Builds Hugging Face's model from a config.json and these weights, ready for inference."""
    from transformers import AutoConfig, AutoModel

    model = AutoModel.from_config(AutoConfig.for_model(**config)).eval()
    name = "encoder.pos_conv_embed.conv"
    fused = state.pop(f"{name}.weight", None)
    if fused is not None:
        state |= {f"{name}.weight_g": fused.norm(dim=(0, 1), keepdim=True), f"{name}.weight_v": fused}
    missing, _ = model.load_state_dict(state, strict=False)
    if set(missing) - {"masked_spec_embed"}:
        raise ValueError(f"expected the weights of {config['model_type']}, got none for {', '.join(missing)}")
    return model


def read_checkpoint(folder: Path, kind: str) -> dict[str, Tensor]:
    """Weights by name. Checkpoints of models with a head prefix the encoder's names, so the prefix is cut."""
    safe, pickled = folder / "model.safetensors", folder / "pytorch_model.bin"
    if not safe.exists() and not pickled.exists():
        raise ValueError(f"{folder}: expected model.safetensors or pytorch_model.bin, got neither")
    state = load_file(safe) if safe.exists() else torch.load(pickled, map_location="cpu", weights_only=True)
    state = {name.removeprefix(f"{kind}."): value.float() for name, value in state.items()}
    if "feature_projection.projection.weight" not in state:
        raise ValueError(f"{folder}: expected the weights of {kind}, got {', '.join(list(state)[:3])}, …")
    return state


def instants(config: dict) -> tuple[float, float]:
    """Features per second, and the time of the first one in seconds: the middle of its receptive field.

    HuBERT's strides (a feature every 320 samples, each over 400) give 50 Hz and 12.5 ms.
    """
    hop, field = 1, 1
    for kernel, stride in zip(config["conv_kernel"], config["conv_stride"], strict=True):
        field += (kernel - 1) * hop
        hop *= stride
    return SAMPLE_HZ / hop, 0.5 * field / SAMPLE_HZ


def at_motion_frames(features: Tensor, rate_hz: float, first_s: float, frames: int, fps: float) -> Tensor:
    """Interpolates features [T, C] linearly at t / fps seconds; the ends are held: [frames, C].

    Mirrors `rust-core/src/speech/resample.rs`: feature i is at `first_s` + i / `rate_hz` seconds.
    """
    position = (torch.arange(frames, dtype=torch.float64) / fps - first_s) * rate_hz
    position = position.clamp(0, len(features) - 1)
    below = position.floor().long()
    share = (position - below)[:, None].to(features.dtype)
    above = (below + 1).clamp_max(len(features) - 1)
    return features[below] + (features[above] - features[below]) * share
