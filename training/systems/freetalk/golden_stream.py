"""Golden of the streaming student: samples to normalised mel and motion."""

from pathlib import Path

import torch
import torch.nn.functional as F

from training.goldens import randomise_norms, write_golden
from training.speech.causal import StreamNet, debug_config, normalise_running, speak
from training.speech.golden_log_mel import chirp_signal
from training.speech.log_mel import HOP, log_mel


@torch.no_grad()
def write(out: Path, shared: Path) -> Path:
    """`weights.*`, `input` [S] → `normalised` [R, 64], `output` [T, 3N] metres.

    `sooner_0` and `sooner_1` are the output of the further heads. `shared` is not used.
    """
    torch.manual_seed(17)
    config = debug_config()
    config.sooner = [3, 5]
    model = StreamNet(config).eval()
    randomise_norms(model)
    model.mean.copy_(torch.randn(model.mean.shape))
    model.std.copy_(torch.rand(model.std.shape) + 0.5)
    samples = torch.cat([chirp_signal(9000), 0.05 * chirp_signal(3345)])
    frames = -(-len(samples) // 640)
    rows = config.mel_rows(frames)
    mel = log_mel(F.pad(samples, (0, HOP * rows - len(samples))))[None, :rows]
    tensors = {"input": samples}
    tensors["normalised"] = normalise_running(mel, config.normaliser)[0]
    tensors["output"] = speak(model, samples, frames)
    for head in range(len(config.sooner)):
        tensors[f"sooner_{head}"] = speak(model, samples, frames, head)
    return write_golden(out / "stream_debug.safetensors", tensors, "stream", model, config.to_json())
