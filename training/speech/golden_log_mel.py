"""Golden of the log-mel front end."""

import math
from pathlib import Path

import torch
from torch import Tensor

from training.goldens import write_golden
from training.speech.log_mel import SAMPLE_RATE_HZ, log_mel


def write(out: Path, shared: Path) -> Path:
    """`input` [S], `output` [T, 64] log-mel. `shared` is not used."""
    samples = chirp_signal()
    tensors = {"input": samples, "output": log_mel(samples)}
    return write_golden(out / "log_mel_debug.safetensors", tensors, "log_mel", tolerance="1e-3")


def chirp_signal(samples: int = 12345) -> Tensor:
    """A rising chirp, silence in the middle, a little noise; [S] in −1 … 1."""
    time = torch.arange(samples, dtype=torch.float64) / SAMPLE_RATE_HZ
    chirp = 0.5 * torch.sin(2 * math.pi * (100.0 * time + 2000.0 * time**2))
    generator = torch.Generator().manual_seed(7)
    noise = 0.01 * torch.randn(samples, generator=generator, dtype=torch.float64)
    silent = (time > 0.3) & (time < 0.4)
    return torch.where(silent, torch.zeros_like(chirp), chirp + noise).float()
