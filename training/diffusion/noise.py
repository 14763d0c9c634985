"""The noise that sampling starts from. Its neighbouring frames resemble each other."""

import torch
from torch import Tensor


def slow_noise(frames: int, channels: int, sigma_frames: float, generator: torch.Generator) -> Tensor:
    """Normal noise [frames, channels] of unit variance, smooth over `sigma_frames` (standard deviation).

    The filter has the weights of `slow_noise` in `rust-core/src/diffusion/noise.rs`. The random numbers
    differ.
    """
    reach = int(3.0 * sigma_frames)
    white = torch.randn(frames + 2 * reach, channels, generator=generator)
    if reach == 0:
        return white
    weights = (1.0 - (torch.arange(-reach, reach + 1) / (reach + 1)) ** 2) ** 3
    weights = weights / weights.square().sum().sqrt()
    return torch.nn.functional.conv1d(white.T[:, None], weights[None, None])[:, 0].T
