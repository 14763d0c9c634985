"""HuBERT and wav2vec2 features for the `paper` configuration, from a checkpoint folder of the user's.

Mirrors `rust-core/src/speech/transformer_encoder.rs`, checkpoint name for attribute name, so that both
sides hear the same. Nothing is downloaded: a Hugging Face folder has config.json, model.safetensors or
pytorch_model.bin, and where it is there preprocessor_config.json.
"""

import json
import math
from pathlib import Path

import torch
import torch.nn.functional as F
from safetensors.torch import load_file
from torch import Tensor

SAMPLE_HZ = 16000
FPS = 25.0
"""Motion frames a second of every clip that is trained on."""
MODELS = ("hubert", "wav2vec2")


class HubertFeatures:
    """The output of the encoder, brought to the motion's frames.

    With `transformer_fps` what the convolutions hear is brought to that rate instead, before projection and
    transformer, as FaceFormer does (Fan et al. 2022, section 3.2).
    """

    def __init__(self, folder: Path | None, transformer_fps: float | None = None):
        if folder is None:
            raise ValueError("--hubert: expected a folder with a HuBERT or wav2vec2 checkpoint, got nothing")
        self.config = json.loads((folder / "config.json").read_text())
        self.kind = self.config.get("model_type")
        if self.kind not in MODELS:
            raise ValueError(f"{folder}/config.json: model_type: expected {MODELS}, got {self.kind}")
        preprocessor = folder / "preprocessor_config.json"
        about = json.loads(preprocessor.read_text()) if preprocessor.exists() else {}
        self.normalise = about.get("do_normalize", True)
        self.state = read_checkpoint(folder, self.kind)
        self.channels = self.config["hidden_size"]
        self.transformer_fps = transformer_fps

    @torch.no_grad()
    def __call__(self, samples: Tensor, frames: int) -> Tensor:
        """`samples` [S] at 16 kHz → [frames, C], linear between neighbours; frame i is second i / 25."""
        if self.normalise:
            samples = (samples - samples.mean()) / (samples.var(correction=0) + 1e-7).sqrt()
        if self.transformer_fps is None:
            rate_hz, first_s = instants(self.config)
            return at_motion_frames(self.encode(samples), rate_hz, first_s, frames, FPS)
        count = max(math.ceil(len(samples) / SAMPLE_HZ * self.transformer_fps - 1e-6), 1)
        return at_motion_frames(self.encode(samples, count), self.transformer_fps, 0.0, frames, FPS)

    @torch.no_grad()
    def encode(self, samples: Tensor, frames: int | None = None) -> Tensor:
        """The encoder's output, [T, C], at its own rate, or in so many `frames` at `transformer_fps`.

        `samples` [S] as they are.
        """
        x = self._convolve(samples[None, None])[0].T
        if frames is not None:
            x = at_motion_frames(x, *instants(self.config), frames, self.transformer_fps)
        if self.config.get("feat_proj_layer_norm", True):
            x = self._norm(x, "feature_projection.layer_norm")
        x = self._linear(x, "feature_projection.projection")
        x = x + self._positions(x)
        stable = self.config.get("do_stable_layer_norm", False)
        x = x if stable else self._norm(x, "encoder.layer_norm")
        for layer in range(self.config["num_hidden_layers"]):
            x = self._layer(x, f"encoder.layers.{layer}", stable)
        return self._norm(x, "encoder.layer_norm") if stable else x

    def _convolve(self, x: Tensor) -> Tensor:
        """[1, 1, S] → [1, C, T]."""
        kinds = zip(self.config["conv_kernel"], self.config["conv_stride"], strict=True)
        for i, (_, stride) in enumerate(kinds):
            name = f"feature_extractor.conv_layers.{i}"
            x = F.conv1d(x, self.state[f"{name}.conv.weight"], self.state.get(f"{name}.conv.bias"), stride)
            if f"{name}.layer_norm.weight" in self.state:
                gain, bias = self.state[f"{name}.layer_norm.weight"], self.state[f"{name}.layer_norm.bias"]
                if self.config["feat_extract_norm"] == "group":
                    x = F.group_norm(x, len(gain), gain, bias)
                else:
                    x = F.layer_norm(x.transpose(1, 2), gain.shape, gain, bias).transpose(1, 2)
            x = F.gelu(x)
        return x

    def _positions(self, x: Tensor) -> Tensor:
        taps, groups = self.config["num_conv_pos_embeddings"], self.config["num_conv_pos_embedding_groups"]
        weight, bias = position_weight(self.state), self.state["encoder.pos_conv_embed.conv.bias"]
        moved = F.conv1d(x.T[None], weight, bias, padding=taps // 2, groups=groups)[0].T
        return F.gelu(moved[: len(x)])

    def _layer(self, x: Tensor, name: str, stable: bool) -> Tensor:
        """A transformer layer, post-norm, or pre-norm in the stable variant."""
        if stable:
            x = x + self._attend(self._norm(x, f"{name}.layer_norm"), f"{name}.attention")
            return x + self._feed(self._norm(x, f"{name}.final_layer_norm"), f"{name}.feed_forward")
        x = self._norm(x + self._attend(x, f"{name}.attention"), f"{name}.layer_norm")
        return self._norm(x + self._feed(x, f"{name}.feed_forward"), f"{name}.final_layer_norm")

    def _attend(self, x: Tensor, name: str) -> Tensor:
        heads = self.config["num_attention_heads"]
        q, k, v = (self._linear(x, f"{name}.{p}").unflatten(1, (heads, -1)).transpose(0, 1)
                   for p in ("q_proj", "k_proj", "v_proj"))  # fmt: skip
        mixed = F.scaled_dot_product_attention(q[None], k[None], v[None])[0]
        return self._linear(mixed.transpose(0, 1).flatten(1), f"{name}.out_proj")

    def _feed(self, x: Tensor, name: str) -> Tensor:
        return self._linear(F.gelu(self._linear(x, f"{name}.intermediate_dense")), f"{name}.output_dense")

    def _linear(self, x: Tensor, name: str) -> Tensor:
        return F.linear(x, self.state[f"{name}.weight"], self.state[f"{name}.bias"])

    def _norm(self, x: Tensor, name: str) -> Tensor:
        gain, bias = self.state[f"{name}.weight"], self.state[f"{name}.bias"]
        return F.layer_norm(x, gain.shape, gain, bias, self.config.get("layer_norm_eps", 1e-5))


def read_checkpoint(folder: Path, kind: str) -> dict[str, Tensor]:
    """Weights by name; checkpoints of models with a head hold the encoder one level down."""
    safe, pickled = folder / "model.safetensors", folder / "pytorch_model.bin"
    if not safe.exists() and not pickled.exists():
        raise ValueError(f"{folder}: expected model.safetensors or pytorch_model.bin, got neither")
    state = load_file(safe) if safe.exists() else torch.load(pickled, map_location="cpu", weights_only=True)
    state = {name.removeprefix(f"{kind}."): value.float() for name, value in state.items()}
    if "feature_projection.projection.weight" not in state:
        raise ValueError(f"{folder}: expected the weights of {kind}, got {', '.join(list(state)[:3])}, …")
    return state


def position_weight(state: dict[str, Tensor]) -> Tensor:
    """`g v / ‖v‖` over everything but the taps (Salimans & Kingma 2016), under any of three names."""
    name = "encoder.pos_conv_embed.conv"
    if f"{name}.weight" in state:
        return state[f"{name}.weight"]
    old = f"{name}.weight_v" in state
    parts = ("weight_g", "weight_v") if old else tuple(f"parametrizations.weight.original{i}" for i in (0, 1))
    gain, direction = (state[f"{name}.{part}"] for part in parts)
    return gain * direction / direction.norm(dim=(0, 1), keepdim=True)


def instants(config: dict) -> tuple[float, float]:
    """Features a second, and the second at which the first stands: the middle of what it hears.

    With HuBERT's strides (a feature every 320 samples, each of 400) 50 Hz and 12.5 ms.
    """
    hop, field = 1, 1
    for kernel, stride in zip(config["conv_kernel"], config["conv_stride"], strict=True):
        field += (kernel - 1) * hop
        hop *= stride
    return SAMPLE_HZ / hop, 0.5 * field / SAMPLE_HZ


def at_motion_frames(features: Tensor, rate_hz: float, first_s: float, frames: int, fps: float) -> Tensor:
    """Features [T, C] at seconds t / fps, linear between neighbours, held beyond the ends: [frames, C].

    Mirrors `rust-core/src/speech/resample.rs`: feature i stands at `first_s` + i / `rate_hz` seconds.
    """
    position = (torch.arange(frames, dtype=torch.float64) / fps - first_s) * rate_hz
    position = position.clamp(0, len(features) - 1)
    below = position.floor().long()
    share = (position - below)[:, None].to(features.dtype)
    above = (below + 1).clamp_max(len(features) - 1)
    return features[below] + (features[above] - features[below]) * share
