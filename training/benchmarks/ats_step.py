"""One training step of ATS at the paper's size beside the same sizes in PyTorch's own layers.

    python -m training.benchmarks.ats_step --windows 4 --frames 64

Both take the same batch of random motion and HuBERT-sized features through forward, loss of eq. 15, backward,
clipping and AdamW. Plain is `nn.TransformerDecoder` (d 512, 6 layers, 8 heads, 2048) with the band as its
masks, between linear layers. Steps of the two alternate; the median of seconds of processor is printed (of
the GPU's clock with `--device cuda`).
"""

import argparse
import statistics
import time
from collections.abc import Callable

import torch
from torch import Tensor, nn

from training.losses import motion_loss
from training.machine import Machine, add_arguments
from training.nn.attention import band_mask
from training.systems.freetalk.ats import AtsDenoiser, neutral_affect, paper_config


class Plain(nn.Module):
    """PyTorch's own decoder in the same sizes, without time, emotion and style."""

    def __init__(self, dims: int, channels: int, width: int, layers: int, heads: int, inner: int):
        super().__init__()
        self.x_proj, self.mem_proj = nn.Linear(dims, width), nn.Linear(channels, width)
        layer = nn.TransformerDecoderLayer(width, heads, inner, 0.0, "gelu", batch_first=True)
        self.decoder = nn.TransformerDecoder(layer, layers)
        self.head = nn.Linear(width, dims)

    def forward(self, noisy: Tensor, speech: Tensor, band: Tensor) -> Tensor:
        """[B, T, 204] and [B, T, C] → [B, T, 204]."""
        return self.head(self.decoder(self.x_proj(noisy), self.mem_proj(speech), memory_mask=band))


def stepper(machine: Machine, model: nn.Module, predict: Callable[[], Tensor], truth: Tensor):
    """A function that takes one step of training."""
    optimiser = torch.optim.AdamW(model.parameters(), lr=1e-4, weight_decay=1e-2)
    weight = torch.ones_like(truth)

    def step() -> None:
        with machine.autocast():
            found = predict()
        machine.step(motion_loss(found.float() - truth, weight), model, optimiser, 1.0)

    return step


def seconds_of(step: Callable[[], None], device: torch.device) -> float:
    """Of one step: of processor, or until a GPU is done."""
    clock = time.perf_counter if device.type == "cuda" else time.process_time
    started = clock()
    step()
    if device.type == "cuda":
        torch.cuda.synchronize()
    return clock() - started


def main() -> None:
    """Entry of the command."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--windows", type=int, default=16)
    parser.add_argument("--frames", type=int, default=128)
    parser.add_argument("--runs", type=int, default=7)
    parser.add_argument("--threads", type=int, default=1)
    add_arguments(parser, "float32")
    args = parser.parse_args()
    torch.set_num_threads(args.threads)
    torch.manual_seed(0)
    machine, config = Machine(args.device, args.precision), paper_config()
    device, (count, frames) = machine.device, (args.windows, args.frames)
    truth, noisy = (torch.randn(count, frames, 204, device=device) for _ in range(2))
    speech = torch.randn(count, frames, config.speech.channels, device=device)
    time_of = torch.randint(0, 1000, (count,), device=device)
    affect = neutral_affect(count, frames).to(device)
    style = torch.zeros(count, dtype=torch.long, device=device)
    ours = AtsDenoiser(config).to(device)
    sizes = (config.width, config.layers, config.heads, config.feedforward)
    plain = Plain(204, config.speech.channels, *sizes).to(device)
    band = band_mask(frames, frames, config.radius, device)
    closed = ~band if band.dtype == torch.bool else band
    steps = {
        "ours": stepper(machine, ours, lambda: ours(noisy, time_of, speech, affect, style), truth),
        "plain": stepper(machine, plain, lambda: plain(noisy, speech, closed), truth),
    }
    taken: dict[str, list[float]] = {name: [] for name in steps}
    for run in range(args.runs + 1):
        for name, step in steps.items():
            found = seconds_of(step, device)
            if run > 0:
                taken[name].append(found)
    for name, found in taken.items():
        print(f"{name}: {statistics.median(found):.3f} s a step ({min(found):.3f} to {max(found):.3f})")


if __name__ == "__main__":
    main()
