"""Where a run computes: `--device`, `--precision`, and the processes of several GPUs.

A single process needs only PyTorch. `accelerate launch --num_processes N -m
training.systems.freetalk.train …` starts several. Each draws its own batches, and gradients are averaged
before every step, so that N processes train on N times the batch. Only the first process writes, logs and
judges.
"""

import argparse
import os

import torch
from torch import Tensor, nn

PRECISIONS = {"float32": None, "bfloat16": torch.bfloat16, "float16": torch.float16}


def add_arguments(parser: argparse.ArgumentParser, precision: str) -> None:
    """Adds `--device` and `--precision`; each trainer has its own default `precision`."""
    parser.add_argument("--device", choices=["auto", "cpu", "cuda"], default="auto")
    parser.add_argument(
        "--precision", choices=list(PRECISIONS), default=precision, help="precision of products"
    )


class Machine:
    """Device, mixed precision and the number of this process."""

    def __init__(self, device: str = "auto", precision: str = "float32"):
        if device == "cuda" and not torch.cuda.is_available():
            raise ValueError("--device: expected a GPU that PyTorch sees for cuda, got none")
        self.accelerator = _accelerator(device) if int(os.environ.get("WORLD_SIZE", "1")) > 1 else None
        kind = "cuda" if device != "cpu" and torch.cuda.is_available() else "cpu"
        self.device = self.accelerator.device if self.accelerator else torch.device(kind)
        self.dtype = PRECISIONS[precision]
        if self.dtype == torch.float16 and self.device.type == "cpu":
            raise ValueError("--precision: expected float32 or bfloat16 on a processor, got float16")
        self.scaler = torch.amp.GradScaler(self.device.type, enabled=self.dtype == torch.float16)

    @property
    def rank(self) -> int:
        """Number of this process, from 0."""
        return self.accelerator.process_index if self.accelerator else 0

    @property
    def processes(self) -> int:
        """How many processes train together."""
        return self.accelerator.num_processes if self.accelerator else 1

    def seed(self, seed: int) -> int:
        """Seed for this process's random numbers: different in every process, `seed` itself in the first."""
        return seed + 1_000_003 * self.rank

    def place(self, model: nn.Module, seed: int) -> None:
        """Moves a model to the device and gives every process the weights of the first one.

        From then on each process draws its own random numbers.
        """
        model.to(self.device)
        if self.accelerator is None:
            return
        from accelerate.utils import broadcast

        for value in model.state_dict().values():
            value.copy_(broadcast(value))
        if self.rank > 0:
            torch.manual_seed(self.seed(seed))

    def autocast(self) -> torch.autocast:
        """Computes products in the chosen precision."""
        dtype = self.dtype or torch.bfloat16
        return torch.autocast(self.device.type, dtype, enabled=self.dtype is not None)

    def step(self, loss: Tensor, model: nn.Module, optimiser: torch.optim.Optimizer, clip: float) -> None:
        """One optimiser step. Gradients are averaged over processes; their norm is at most `clip`."""
        optimiser.zero_grad()
        self.scaler.scale(loss).backward()
        self.average_gradients(model)
        self.scaler.unscale_(optimiser)
        nn.utils.clip_grad_norm_(model.parameters(), clip)
        self.scaler.step(optimiser)
        self.scaler.update()

    def average_gradients(self, model: nn.Module) -> None:
        """Replaces every gradient by its mean over all processes, in one message.

        A missing gradient counts as zero.
        """
        if self.accelerator is None:
            return
        for parameter in model.parameters():
            if parameter.requires_grad and parameter.grad is None:
                parameter.grad = torch.zeros_like(parameter)
        gradients = [p.grad for p in model.parameters() if p.requires_grad]
        flat = self.accelerator.reduce(torch.cat([g.flatten() for g in gradients]), reduction="mean")
        for gradient, mean in zip(gradients, flat.split([g.numel() for g in gradients]), strict=True):
            gradient.copy_(mean.view_as(gradient))

    def gathered(self, value: object) -> list:
        """`value` of every process, in order."""
        if self.accelerator is None:
            return [value]
        from accelerate.utils import gather_object

        return gather_object([value])


def in_bfloat16() -> torch.autocast:
    """Multiplies in bfloat16 on a processor that has it. Others imitate it several times slower than they
    multiply in float32, which they do here."""
    return torch.autocast("cpu", torch.bfloat16, enabled=torch.cpu._is_avx512_bf16_supported())


def _accelerator(device: str):
    try:
        from accelerate import Accelerator
    except ImportError:
        expected = "accelerate for several processes: pip install -r training/requirements.txt"
        raise ImportError(f"expected {expected}, got none") from None
    return Accelerator(cpu=device == "cpu")
