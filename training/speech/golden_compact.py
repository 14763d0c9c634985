"""Golden of the compact encoder with tiny random weights."""

import json
from pathlib import Path

import torch
from safetensors.torch import save_file

from training.speech.compact import CompactEncoder, debug_config, normalise
from training.speech.golden_log_mel import chirp_signal
from training.speech.log_mel import log_mel

COMMAND = "python -m training.goldens compact_speech"


@torch.no_grad()
def write(out: Path, shared: Path) -> Path:
    """`weights.*`, `input` [T, 64] raw log-mel, `output` [T', C], `closed` [T'] probabilities.

    `shared` is not used.
    """
    torch.manual_seed(11)
    config = debug_config()
    model = CompactEncoder(config).eval()
    randomise_norms(model)
    torch.nn.init.normal_(model.closure.weight)
    torch.nn.init.zeros_(model.closure.bias)
    mel = log_mel(chirp_signal())
    tensors = {f"weights.{key}": value for key, value in model.state_dict().items()}
    tensors["input"] = mel
    tensors["output"] = model(normalise(mel)[None])[0].contiguous()
    tensors["closed"] = model.closed(tensors["output"]).contiguous()
    path = out / "compact_speech_debug.safetensors"
    metadata = {"config": json.dumps(config.to_json()), "tolerance": "1e-4", "command": COMMAND}
    save_file(tensors, path, metadata)
    return path


def randomise_norms(model: torch.nn.Module) -> None:
    """Gives every LayerNorm a weight and bias that are not 1 and 0, so that a swap shows."""
    for module in model.modules():
        if isinstance(module, torch.nn.LayerNorm):
            torch.nn.init.uniform_(module.weight, 0.5, 1.5)
            torch.nn.init.uniform_(module.bias, -0.5, 0.5)
