"""Noise schedules: how much of the clean signal is left after each diffusion step."""

import math
from dataclasses import dataclass

import torch
from torch import Tensor

MAX_BETA = 0.999


@dataclass
class Diffusion:
    """The forward process of a model, as stored in its configuration."""

    schedule: str = "cosine"
    train_steps: int = 1000

    def alphas(self) -> Tensor:
        """ᾱ_t of every training step, [steps]."""
        return alphas_cumprod(self.schedule, self.train_steps)


def alphas_cumprod(schedule: str, steps: int) -> Tensor:
    """ᾱ_t for t = 0 … steps − 1, [steps] f32, falling.

    `linear`: β from 1e-4 to 0.02 (Ho et al. 2020). `cosine`: β from the squared cosine of
    Nichol & Dhariwal 2021, offset 0.008, capped at 0.999 (`squaredcos_cap_v2` in diffusers).
    """
    if schedule == "linear":
        betas = torch.linspace(1e-4, 0.02, steps, dtype=torch.float32)
    elif schedule == "cosine":
        betas = torch.tensor([_cosine_beta(t, steps) for t in range(steps)], dtype=torch.float32)
    else:
        raise ValueError(f"schedule: expected linear or cosine, got {schedule!r}")
    return torch.cumprod(1.0 - betas, dim=0)


def _cosine_beta(t: int, steps: int) -> float:
    return min(1.0 - _cosine_bar((t + 1) / steps) / _cosine_bar(t / steps), MAX_BETA)


def _cosine_bar(share: float) -> float:
    return math.cos((share + 0.008) / 1.008 * math.pi / 2) ** 2


def inference_timesteps(train_steps: int, steps: int, spacing: str) -> list[int]:
    """The timesteps visited when sampling, falling.

    `leading`: i · (train_steps // steps). `trailing`:
    round(train_steps − i · train_steps/steps) − 1, so that the first step starts at pure noise
    (Lin et al. 2024, table 2).
    """
    if not 1 <= steps <= train_steps:
        raise ValueError(f"steps: expected 1 to {train_steps}, got {steps}")
    if spacing == "leading":
        ratio = train_steps // steps
        return [i * ratio for i in range(steps)][::-1]
    if spacing == "trailing":
        ratio = train_steps / steps
        return [round(train_steps - i * ratio) - 1 for i in range(steps)]
    raise ValueError(f"spacing: expected leading or trailing, got {spacing!r}")


def add_noise(clean: Tensor, noise: Tensor, alpha_bar: Tensor) -> Tensor:
    """`√ᾱ x₀ + √(1 − ᾱ) ε`, FreeTalk eq. 5. `alpha_bar` broadcasts against `clean`."""
    return alpha_bar.sqrt() * clean + (1.0 - alpha_bar).sqrt() * noise


def noise_levels(
    shape: torch.Size, levels: int, pure_share: float, random: torch.Generator
) -> tuple[Tensor, Tensor]:
    """Levels [B] and noise of `shape` [B, T, D] to train on.

    `pure_share` of the rows are pure noise: they get the last level, and their noise is scaled down by a
    random factor.
    """
    t = torch.randint(0, levels, shape[:1], generator=random)
    pure = torch.rand(shape[0], generator=random) < pure_share
    noise = torch.randn(shape, generator=random)
    cool = torch.rand(shape[0], 1, 1, generator=random)
    return torch.where(pure, levels - 1, t), torch.where(pure[:, None, None], noise * cool, noise)
