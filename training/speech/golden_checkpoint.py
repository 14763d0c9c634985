"""Golden of a PyTorch checkpoint: the weights of the tiny HuBERT as `pytorch_model.bin`."""

from pathlib import Path

import torch
from safetensors.torch import load_file


def write(out: Path, shared: Path) -> Path:
    """Saves `weights.*` of `shared/parity/hubert_tiny.safetensors` with `torch.save`.

    The transformer's layers are in half precision and everything else is in single precision, so that the
    file covers both and stays small.
    """
    tensors = load_file(shared / "parity" / "hubert_tiny.safetensors")
    state = {
        name.removeprefix("weights."): value.half() if ".layers." in name else value
        for name, value in tensors.items()
        if name.startswith("weights.")
    }
    path = out / "hubert_tiny.bin"
    torch.save(state, path)
    return path
