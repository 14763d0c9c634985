"""Golden of Whisper's encoder: random weights under Hugging Face's names, a second of sound."""

from pathlib import Path

import torch

from training.goldens import write_golden
from training.speech.whisper import WhisperConfig, WhisperEncoder, to_hugging_face, whisper_mel


def write(out: Path, shared: Path) -> Path:
    """`input` [S], `mel` [T, 80]; `layer_0`, `layer_1` and `output` [⌈T / 2⌉, C]."""
    torch.manual_seed(5)
    model = WhisperEncoder(WhisperConfig(layers=2, width=16, places=750, heads=2)).eval()
    with torch.no_grad():
        for parameter in model.parameters():
            parameter.add_(0.2 * torch.randn_like(parameter))
        for layer in model.layers:
            layer.query_key_value.bias[16:32] = 0.0
    samples = 0.1 * torch.randn(15900) * torch.linspace(0.1, 1.0, 15900)
    mel = whisper_mel(samples)
    states = [state.detach() for state in model.hear(mel, [0, 1, 2])]
    about, weights = to_hugging_face(model)
    tensors = {f"weights.{name}": value.detach() for name, value in weights.items()}
    tensors |= {"input": samples, "mel": mel}
    tensors |= dict(zip(("layer_0", "layer_1", "output"), states, strict=True))
    return write_golden(out / "whisper_tiny.safetensors", tensors, "whisper", config=about)
