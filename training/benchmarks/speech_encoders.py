"""HuBERT base and large and wav2vec2 XLSR at full size with random weights: the engine's time and memory.

    python -m training.benchmarks.speech_encoders --binary target/release/anyface --out /tmp/encoders

Writes each checkpoint as a Hugging Face folder (large as pytorch_model.bin, the others as safetensors) with
a random denoiser of `debug` size that hears it, and lets the binary animate a small mesh with 10 s of noise
that swells like speech. With `--spans S` it also encodes S seconds whole and in the engine's spans (30 s
with 2 s of context on either side), in PyTorch, and prints how far the two lie apart.
"""

import argparse
import json
import os
import subprocess
import time
from pathlib import Path

import numpy as np
import soundfile
import torch
from safetensors.torch import save_file
from torch import Tensor

from training.nn.checkpoint import write_model
from training.speech.hubert import HubertFeatures, instants
from training.systems.freetalk.ats import AtsDenoiser, SpeechInput, debug_config
from training.tests.made_up import face_mesh, spoken

COMMON = {
    "hidden_act": "gelu", "feat_extract_activation": "gelu", "layer_norm_eps": 1e-5, "conv_dim": [512] * 7,
    "conv_stride": [5, 2, 2, 2, 2, 2, 2], "conv_kernel": [10, 3, 3, 3, 3, 2, 2],
    "num_conv_pos_embeddings": 128, "num_conv_pos_embedding_groups": 16,
}  # fmt: skip
BASE = {"hidden_size": 768, "num_hidden_layers": 12, "num_attention_heads": 12, "intermediate_size": 3072,
        "feat_extract_norm": "group", "conv_bias": False, "do_stable_layer_norm": False}  # fmt: skip
LARGE = {"hidden_size": 1024, "num_hidden_layers": 24, "num_attention_heads": 16, "intermediate_size": 4096,
         "feat_extract_norm": "layer", "conv_bias": True, "do_stable_layer_norm": True}  # fmt: skip
ENCODERS = {
    "hubert_base": COMMON | BASE | {"model_type": "hubert"},
    "hubert_large": COMMON | LARGE | {"model_type": "hubert"},
    "wav2vec2_xlsr": COMMON | LARGE | {"model_type": "wav2vec2"},
}
"""Sizes of facebook/hubert-base-ls960, hubert-large-ll60k and wav2vec2-large-xlsr-53."""
SPAN, CONTEXT = 1500, 100
"""Frames encoded at once and on either side, as in rust-core/src/speech/transformer_encoder.rs."""


def random_weights(config: dict) -> dict[str, Tensor]:
    """Weights of deviation 0.02 as before any training, norms at one; convolutions keep the signal's size."""
    width, inner = config["hidden_size"], config["intermediate_size"]
    state: dict[str, Tensor] = {}

    def linear(name: str, outputs: int, inputs: int) -> None:
        state[f"{name}.weight"] = 0.02 * torch.randn(outputs, inputs)
        state[f"{name}.bias"] = torch.zeros(outputs)

    def norm(name: str, size: int) -> None:
        state[f"{name}.weight"], state[f"{name}.bias"] = torch.ones(size), torch.zeros(size)

    before = 1
    for i, (size, taps) in enumerate(zip(config["conv_dim"], config["conv_kernel"], strict=True)):
        name = f"feature_extractor.conv_layers.{i}"
        state[f"{name}.conv.weight"] = torch.randn(size, before, taps) * (2.0 / (before * taps)) ** 0.5
        if config["conv_bias"]:
            state[f"{name}.conv.bias"] = torch.zeros(size)
        if config["feat_extract_norm"] == "layer" or i == 0:
            norm(f"{name}.layer_norm", size)
        before = size
    norm("feature_projection.layer_norm", before)
    linear("feature_projection.projection", width, before)
    taps, groups = config["num_conv_pos_embeddings"], config["num_conv_pos_embedding_groups"]
    name = "encoder.pos_conv_embed.conv"
    state[f"{name}.weight_v"] = 0.02 * torch.randn(width, width // groups, taps)
    state[f"{name}.weight_g"] = state[f"{name}.weight_v"].norm(dim=(0, 1), keepdim=True)
    state[f"{name}.bias"] = torch.zeros(width)
    norm("encoder.layer_norm", width)
    for i in range(config["num_hidden_layers"]):
        for part in ("q_proj", "k_proj", "v_proj", "out_proj"):
            linear(f"encoder.layers.{i}.attention.{part}", width, width)
        linear(f"encoder.layers.{i}.feed_forward.intermediate_dense", inner, width)
        linear(f"encoder.layers.{i}.feed_forward.output_dense", width, inner)
        norm(f"encoder.layers.{i}.layer_norm", width)
        norm(f"encoder.layers.{i}.final_layer_norm", width)
    return state


def write_encoder(folder: Path, config: dict, pickled: bool) -> int:
    """A Hugging Face folder; returns the number of weights."""
    state = random_weights(config)
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "config.json").write_text(json.dumps(config))
    if pickled:
        torch.save(state, folder / "pytorch_model.bin")
    else:
        save_file(state, folder / "model.safetensors")
    return sum(value.numel() for value in state.values())


def write_denoiser(folder: Path, config: dict) -> None:
    """A random denoiser that hears the encoder."""
    ats = debug_config()
    ats.speech = SpeechInput(config["model_type"], config["hidden_size"])
    model = AtsDenoiser(ats)
    model.std.fill_(1e-3)
    write_model(folder / "ats_debug", model.state_dict(), ats.to_json())


def write_scene(out: Path, seconds: float) -> list[str]:
    """Mesh, landmarks and sound; returns the flags that name them."""
    vertices, triangles = face_mesh()
    lines = ["v {:.6f} {:.6f} {:.6f}".format(*v) for v in vertices]
    lines += ["f {} {} {}".format(*(t + 1)) for t in triangles]
    (out / "head.obj").write_text("\n".join(lines) + "\n")
    (out / "marks.json").write_text(json.dumps(list(range(68))))
    soundfile.write(out / "talk.wav", spoken(seconds, 0), 16000)
    return ["--mesh", f"{out}/head.obj", "--landmarks", f"{out}/marks.json", "--audio", f"{out}/talk.wav"]


def animate(binary: Path, out: Path, scene: list[str], encoder: Path) -> tuple[dict, float]:
    """Seconds of each part by the engine's report, and the most memory it held, GB."""
    report = out / "report.json"
    flags = [*scene, "--weights", f"{encoder}/models", "--speech", str(encoder), "--out", f"{out}/talk.npz"]
    flags += ["--no-cache", "--report", str(report)]
    child = subprocess.Popen([binary, "animate", *flags], stdout=subprocess.DEVNULL)
    _, status, usage = os.wait4(child.pid, 0)
    if status != 0:
        raise RuntimeError(f"{binary}: expected status 0, got {status}")
    seconds = json.loads(report.read_text())["seconds"]
    return seconds | {"processor": usage.ru_utime + usage.ru_stime}, usage.ru_maxrss / 2**20


def in_spans(encoder: HubertFeatures, samples: Tensor) -> Tensor:
    """[T, C], each span with its context alone, as the engine does it."""
    rate_hz, first_s = instants(encoder.config)
    hop, field = round(16000 / rate_hz), round(2 * first_s * 16000)
    frames, parts = (len(samples) - field) // hop + 1, []
    for start in range(0, frames, SPAN):
        end = min(start + SPAN, frames)
        first, last = max(start - CONTEXT, 0), min(end + CONTEXT, frames)
        found = encoder.encode(samples[first * hop : (last - 1) * hop + field])
        parts.append(found[start - first : end - first])
    return torch.cat(parts)


@torch.no_grad()
def spans_against_whole(folder: Path, seconds: float) -> str:
    """How far features of spans lie from those of the whole sound, in deviations of the latter."""
    encoder = HubertFeatures(folder)
    samples = torch.from_numpy(spoken(seconds, 0))
    samples = (samples - samples.mean()) / samples.std()
    whole, parts = encoder.encode(samples), in_spans(encoder, samples)
    error = (parts - whole).abs() / whole.std()
    return f"{error.mean():.4f} in the mean, {error.max():.4f} at most, of the features' deviation"


def main() -> None:
    """Entry of the command."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--binary", type=Path, required=True)
    parser.add_argument("--out", type=Path, default=Path("/tmp/encoders"))
    parser.add_argument("--encoders", nargs="*", choices=list(ENCODERS), default=list(ENCODERS))
    parser.add_argument("--spans", type=float, default=0.0, help="seconds of sound; more than 30")
    parser.add_argument("--threads", type=int, default=1)
    args = parser.parse_args()
    torch.set_num_threads(args.threads)
    torch.manual_seed(0)
    args.out.mkdir(parents=True, exist_ok=True)
    scene = write_scene(args.out, 10.0)
    for name in args.encoders:
        folder, config = args.out / name, ENCODERS[name]
        count = write_encoder(folder, config, pickled=name == "hubert_large")
        write_denoiser(folder / "models", config)
        started = time.monotonic()
        seconds, held_gb = animate(args.binary, args.out, scene, folder)
        told = ", ".join(f"{part} {value:.2f} s" for part, value in seconds.items())
        print(f"{name}: {count / 1e6:.0f} M weights, 10 s of sound in {time.monotonic() - started:.1f} s "
              f"({told}), {held_gb:.2f} GB", flush=True)  # fmt: skip
        moved = np.load(args.out / "talk.npz")["displacements"]
        print(f"{name}: {len(moved)} frames, finite: {bool(np.isfinite(moved).all())}", flush=True)
        if args.spans:
            print(f"{name}: {args.spans:g} s in spans: {spans_against_whole(folder, args.spans)}", flush=True)


if __name__ == "__main__":
    main()
