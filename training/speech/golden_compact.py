"""Golden of the compact encoder with tiny random weights."""

from pathlib import Path

import torch

from training.goldens import write_golden
from training.speech.compact import CompactEncoder, debug_config, normalise
from training.speech.golden_log_mel import chirp_signal
from training.speech.log_mel import log_mel


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
    tensors = {"input": mel}
    tensors["output"] = model(normalise(mel)[None])[0].contiguous()
    tensors["closed"] = model.closed(tensors["output"]).contiguous()
    return write_golden(
        out / "compact_speech_debug.safetensors", tensors, "compact_speech", model, config.to_json()
    )


def randomise_norms(model: torch.nn.Module) -> None:
    """Gives every LayerNorm a random weight and bias instead of 1 and 0, so that swapped norms show."""
    for module in model.modules():
        if isinstance(module, torch.nn.LayerNorm):
            torch.nn.init.uniform_(module.weight, 0.5, 1.5)
            torch.nn.init.uniform_(module.bias, -0.5, 0.5)
