"""Whole clips from Cafe-Talk: DDIM under guidance on overlapping windows, cross-faded."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import torch
from torch import Tensor

from training.corpus.conditions import SIDES
from training.diffusion.ddim import ddim_sample
from training.diffusion.guidance import guided, mask_guided
from training.diffusion.noise import slow_noise
from training.systems.cafe_talk.denoiser import CafeTalkConfig, Coarse, Denoiser, Sampling
from training.systems.cafe_talk.priority import yielding
from training.systems.freetalk.sampling import _ramp, window_starts


@dataclass
class Request:
    """A request for a clip.

    `style` is a number; `emotion` [T, E] lies in the text space; `intensity` is [T]; `events` [T, 32] are 0
    or 1. `strength` [T, 51] is Z of eq. 6: the strength of the events at each frame and channel, 0 outside
    them. `printed` uses eq. 6 as printed, with G_∅ in its third term. With `over_speech`, events of jaw and
    chin may hide the speech, as in eq. 6 (see `priority`).
    """

    style: int
    emotion: Tensor
    intensity: Tensor
    events: Tensor
    strength: Tensor
    printed: bool = False
    over_speech: bool = False

    @staticmethod
    def neutral(config: CafeTalkConfig, emotions: np.ndarray, frames: int) -> "Request":
        """A request for the default style without emotion or events."""
        return Request(
            config.styles.index(config.default_style),
            torch.from_numpy(emotions[0]).expand(frames, -1),
            torch.zeros(frames),
            torch.zeros(frames, SIDES * len(config.units)),
            torch.zeros(frames, len(config.channels)),
        )

    def span(self, frames: slice) -> "Request":
        """The same request for a range of frames."""
        return self._changed(lambda track: track[frames])

    def to(self, device: torch.device) -> "Request":
        """The same request on another device."""
        return self._changed(lambda track: track.to(device))

    def _changed(self, change: Callable[[Tensor], Tensor]) -> "Request":
        tracks = ("emotion", "intensity", "events", "strength")
        return replace(self, **{name: change(getattr(self, name)) for name in tracks})


def sample_weights(
    model: Denoiser, speech: Tensor, request: Request, seed: int = 0, sampling: Sampling | None = None
) -> Tensor:
    """Weights [T, 51] of a clip of any length; `speech` [T, C] at the model's fps."""
    generator = torch.Generator().manual_seed(seed)
    sampling, config = sampling or model.config.sampling, model.config
    noise = slow_noise(len(speech), len(config.channels), sampling.noise_s * config.fps, generator)
    return sample_from(model, noise, speech, request, sampling)


@torch.no_grad()
def sample_from(
    model: Denoiser, noise: Tensor, speech: Tensor, request: Request, sampling: Sampling | None = None
) -> Tensor:
    """Like `sample_weights`, but from given unit noise [T, 51]. Runs on the model's device."""
    config, sampling = model.config, sampling or model.config.sampling
    frames, device = len(speech), model.mean.device
    noise, speech, request = noise.to(device) * sampling.temperature, speech.to(device), request.to(device)
    total, weight = torch.zeros_like(noise), torch.zeros(frames, 1, device=device)
    for start in window_starts(frames, config.window_frames, config.overlap_frames):
        span = slice(start, min(start + config.window_frames, frames))
        clean = _window(model, noise[span], speech[span], request.span(span), sampling)
        ramp = _ramp(span, frames, config.overlap_frames).to(device)
        total[span] += ramp * clean
        weight[span] += ramp
    return model.to_weights(total / weight).clamp_min(0.0)


def _window(model: Denoiser, noise: Tensor, speech: Tensor, request: Request, sampling: Sampling) -> Tensor:
    diffusion = model.config.diffusion
    alphas = diffusion.alphas()
    device = noise.device
    yes, no = torch.tensor([True], device=device), torch.tensor([False], device=device)
    style = torch.tensor([request.style], device=device)
    coarse = Coarse(style, request.emotion[None], request.intensity[None], yes)
    controlled = bool(request.strength.any())
    strength = sampling.beta * request.strength[None]

    def predict(x: Tensor, t: int) -> Tensor:
        step = torch.tensor([t], device=device)
        heard = model(x, step, speech[None], coarse, yes)
        unheard = heard
        if sampling.alpha != 1.0 or (controlled and request.printed):
            unheard = model(x, step, speech[None], replace(coarse, has_label=no), no)
        base = guided(unheard, heard, sampling.alpha)
        if not controlled:
            return base
        fine = model(x, step, speech[None], coarse, yes, request.events[None])
        if request.printed:
            return mask_guided(base, fine, unheard, strength)
        mask = strength if request.over_speech else yielding(strength, model.to_weights(heard))
        return mask_guided(base, fine, heard, mask)

    return ddim_sample(predict, noise[None], alphas, sampling.steps, sampling.spacing)[0]
