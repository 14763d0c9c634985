"""Golden of packed arrays: Rust must read the same floats from them as Python, to the last bit."""

from pathlib import Path

import torch

from training.goldens import write_golden
from training.nn.checkpoint import as_shipped, in_floats


def write(out: Path, shared: Path) -> Path:
    """Writes `weights.*` as shipped, and `floats.*`, the same arrays as read.

    They are `matrix` [70, 40] with a zero row, `kernel` [16, 48, 3], and `whole` [3, 900] with whole numbers.
    `shared` is not used.
    """
    torch.manual_seed(11)
    weights = {
        "matrix": torch.randn(70, 40),
        "kernel": torch.randn(16, 48, 3) * torch.logspace(-6, 2, 16)[:, None, None],
    }
    weights["matrix"][3] = 0
    weights["whole"] = (torch.randn(3, 900) * torch.tensor([[2.0], [100.0], [9000.0]])).half().round()
    stored = as_shipped({name: value.half() for name, value in weights.items()})
    arrays = {f"weights.{name}": value for name, value in stored.items()}
    floats = {f"floats.{name}": value for name, value in in_floats(stored).items()}
    return write_golden(out / "eight_bits.safetensors", arrays | floats, "eight_bits", tolerance="0")
