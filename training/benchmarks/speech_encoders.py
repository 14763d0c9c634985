"""The engine's time and memory with HuBERT base and large and wav2vec2 XLSR: full size, random weights.

    python -m training.benchmarks.speech_encoders --binary target/release/anyface

Writes each checkpoint as a Hugging Face folder (HuBERT large as pytorch_model.bin, the others as safetensors)
with a random denoiser of `debug` size that takes its features. The binary then animates a small mesh with
10 s of noise that swells like speech.
"""

import json
import os
import subprocess
from pathlib import Path

import numpy as np
import soundfile
import torch
from transformers import HubertConfig, HubertModel, Wav2Vec2Config, Wav2Vec2Model

from training.corpus.tracks import SOUND_HZ
from training.flags import run_command
from training.nn.checkpoint import write_model
from training.systems.freetalk.ats import AtsDenoiser, SpeechInput, debug_config
from training.tests.made_up import face_mesh, spoken

LARGE = {"hidden_size": 1024, "num_hidden_layers": 24, "num_attention_heads": 16, "intermediate_size": 4096,
         "feat_extract_norm": "layer", "conv_bias": True, "do_stable_layer_norm": True}  # fmt: skip
ENCODERS = {
    "hubert_base": (HubertModel, HubertConfig()),
    "hubert_large": (HubertModel, HubertConfig(**LARGE)),
    "wav2vec2_xlsr": (Wav2Vec2Model, Wav2Vec2Config(**LARGE)),
}
"""Class and config of each encoder.

The sizes are those of facebook/hubert-base-ls960, hubert-large-ll60k and wav2vec2-large-xlsr-53.
"""


def write_encoder(folder: Path, name: str) -> int:
    """Writes a Hugging Face folder with a denoiser for it. Returns the encoder's number of weights."""
    kind, config = ENCODERS[name]
    encoder = kind(config)
    encoder.save_pretrained(folder)
    if name == "hubert_large":
        torch.save(encoder.state_dict(), folder / "pytorch_model.bin")
        (folder / "model.safetensors").unlink()
    ats = debug_config()
    ats.speech = SpeechInput(config.model_type, config.hidden_size)
    denoiser = AtsDenoiser(ats)
    denoiser.std.fill_(1e-3)
    write_model(folder / "models" / "ats_debug", denoiser.state_dict(), ats.to_json())
    return encoder.num_parameters()


def write_scene(out: Path, seconds: float) -> list[str]:
    """Writes mesh, landmarks and sound. Returns the flags that name them."""
    vertices, triangles = face_mesh()
    lines = ["v {:.6f} {:.6f} {:.6f}".format(*v) for v in vertices]
    lines += ["f {} {} {}".format(*(t + 1)) for t in triangles]
    (out / "head.obj").write_text("\n".join(lines) + "\n")
    (out / "marks.json").write_text(json.dumps(list(range(68))))
    soundfile.write(out / "talk.wav", spoken(seconds, 0), SOUND_HZ)
    return ["--mesh", f"{out}/head.obj", "--landmarks", f"{out}/marks.json", "--audio", f"{out}/talk.wav"]


def animate(binary: Path, out: Path, scene: list[str], encoder: Path) -> tuple[float, float]:
    """Processor time in seconds and peak memory in GB, loading included."""
    flags = [*scene, "--weights", encoder / "models", "--speech", encoder, "--out", out / "talk.npz"]
    child = subprocess.Popen([binary, "animate", *flags, "--no-cache"], stdout=subprocess.DEVNULL)
    _, status, usage = os.wait4(child.pid, 0)
    if status != 0:
        raise RuntimeError(f"{binary}: expected status 0, got {status}")
    if not np.isfinite(np.load(out / "talk.npz")["displacements"]).all():
        raise RuntimeError(f"{binary}: expected finite motion, got some that is not")
    return usage.ru_utime + usage.ru_stime, usage.ru_maxrss / 2**20


def main(binary: Path, out: Path = Path("runs/speech_encoders")) -> None:
    """Prints a line for each encoder."""
    torch.manual_seed(0)
    out.mkdir(parents=True, exist_ok=True)
    scene = write_scene(out, 10.0)
    for name in ENCODERS:
        count = write_encoder(out / name, name)
        processor_s, memory_gb = animate(binary, out, scene, out / name)
        print(f"{name}: {count / 1e6:.0f} M weights, {processor_s:.1f} s of processor, {memory_gb:.2f} GB")


if __name__ == "__main__":
    run_command(main)
