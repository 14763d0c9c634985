"""Samples whole clips from the denoiser: DDIM on overlapping windows, cross-faded."""

import torch
from torch import Tensor

from training.diffusion.ddim import ddim_sample
from training.diffusion.noise import slow_noise
from training.systems.freetalk.ats import AtsDenoiser, Sampling


def window_starts(frames: int, window: int, overlap: int) -> list[int]:
    """First frame of each window: one every `window − overlap` frames; the last window ends with the clip."""
    if frames <= window:
        return [0]
    starts = list(range(0, frames - window, window - overlap))
    return [*starts, frames - window]


def sample_motion(
    model: AtsDenoiser,
    speech: Tensor,
    affect: Tensor,
    style: int,
    seed: int = 0,
    sampling: Sampling | None = None,
) -> Tensor:
    """Landmark displacements of a clip of any length, metres.

    `speech` [T, C] at the model's fps, `affect` [T, 16]. Returns [T, 3N].
    """
    generator = torch.Generator().manual_seed(seed)
    sampling, config = sampling or model.config.sampling, model.config
    noise = slow_noise(len(speech), 3 * config.landmarks, sampling.noise_s * config.fps, generator)
    return sample_from(model, noise, speech, affect, style, sampling)


@torch.no_grad()
def sample_from(
    model: AtsDenoiser,
    noise: Tensor,
    speech: Tensor,
    affect: Tensor,
    style: int,
    sampling: Sampling,
) -> Tensor:
    """Works like `sample_motion`, from given unit noise [T, 3N].

    The noise belongs to the frame, not to the window, so overlapping windows start from the same noise,
    scaled by the temperature. Their results are averaged with the weights of a linear ramp. Computes on the
    model's device.
    """
    config = model.config
    frames = speech.shape[0]
    noise, speech, affect = (x.to(model.mean.device) for x in (noise, speech, affect))
    start_noise = noise * sampling.temperature
    total = torch.zeros_like(noise)
    weight = torch.zeros(frames, 1, device=noise.device)
    for start in window_starts(frames, config.window_frames, config.overlap_frames):
        span = slice(start, min(start + config.window_frames, frames))
        clean = _sample_window(model, start_noise[span], speech[span], affect[span], style, sampling)
        ramp = _ramp(span, frames, config.overlap_frames).to(noise.device)
        total[span] += ramp * clean
        weight[span] += ramp
    return model.to_metres(total / weight)


def _sample_window(model, noise, speech, affect, style, sampling) -> Tensor:
    diffusion = model.config.diffusion
    alphas = diffusion.alphas()
    label = torch.tensor([style], device=noise.device)

    def predict(x: Tensor, t: int) -> Tensor:
        return model(x, torch.tensor([t], device=noise.device), speech[None], affect[None], label)

    return ddim_sample(predict, noise[None], alphas, sampling.steps, sampling.spacing)[0]


def _ramp(span: slice, frames: int, overlap: int) -> Tensor:
    """Weight of a window's frames [T, 1]: a ramp over each overlap, 1 at the ends of the clip."""
    count = span.stop - span.start
    position = torch.arange(count, dtype=torch.float32)
    rise = (position + 1) / (overlap + 1)
    fall = rise.flip(0)
    ones = torch.ones(count)
    left = ones if span.start == 0 else rise.clamp_max(1.0)
    right = ones if span.stop == frames else fall.clamp_max(1.0)
    return torch.minimum(left, right)[:, None]
