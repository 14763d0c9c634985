"""Log-mel spectrogram of 16 kHz mono speech: the input of the causal students."""

import numpy as np
import torch
import torch.nn.functional as F
from torch import Tensor

SAMPLE_RATE_HZ = 16000
FRAME = 400
FFT = 512
HOP = 160
BANDS = 64
LOW_HZ = 50.0
HIGH_HZ = 7600.0
FLOOR = 1e-6
ACTIVE_QUANTILE, ACTIVE_RANGE = 0.95, 4.0
"""Frames are active, that is the voice, within this many nepers of this quantile of the levels."""
QUIETEST_LEVEL = -9.0
"""The quietest mean level that counts as a voice, nepers."""
DEEPEST, SCALE = -12.0, 4.0
"""Lower bound and divisor of a log-mel from which the colour was subtracted."""


def hertz_to_mel(hertz):
    """HTK scale: 2595 log₁₀(1 + f / 700)."""
    return 2595.0 * np.log10(1.0 + np.asarray(hertz, dtype=np.float64) / 700.0)


def mel_to_hertz(mel):
    """Inverse of `hertz_to_mel`."""
    return 700.0 * (10.0 ** (np.asarray(mel, dtype=np.float64) / 2595.0) - 1.0)


def mel_filters(bands: int = BANDS, warp: float = 1.0) -> Tensor:
    """Triangular filters with peak 1, evenly spaced in mel, [FFT/2 + 1, bands] f32.

    `warp` multiplies the frequency of every bin before the filters apply (vocal-tract-length
    augmentation; 1 for inference).
    """
    edges = mel_to_hertz(np.linspace(hertz_to_mel(LOW_HZ), hertz_to_mel(HIGH_HZ), bands + 2))
    hertz = np.arange(FFT // 2 + 1) * SAMPLE_RATE_HZ / FFT * warp
    rise = (hertz[:, None] - edges[None, :-2]) / (edges[1:-1] - edges[:-2])
    fall = (edges[None, 2:] - hertz[:, None]) / (edges[2:] - edges[1:-1])
    return torch.from_numpy(np.maximum(np.minimum(rise, fall), 0.0)).float()


def power_spectrum(samples: Tensor) -> Tensor:
    """|X|² of Hann-windowed frames, [S] → [1 + S // 160, 257].

    Frame i is centred on sample 160 i and starts at 160 i − 200. Samples beyond both ends are
    zeros. Periodic Hann of 400 samples, zero-padded on the right to 512.
    """
    if samples.ndim != 1:
        raise ValueError(f"samples: expected [S], got {list(samples.shape)}")
    frames = 1 + samples.shape[0] // HOP
    padded = F.pad(samples.float(), (FRAME // 2, FRAME // 2 + HOP))
    framed = padded.unfold(0, FRAME, HOP)[:frames]
    window = torch.hann_window(FRAME, periodic=True)
    spectrum = torch.fft.rfft(framed * window, n=FFT)
    return spectrum.real.square() + spectrum.imag.square()


def log_mel(samples: Tensor) -> Tensor:
    """ln(max(mel power, 1e-6)) at 100 frames a second, [S] in −1 … 1 → [1 + S // 160, 64]."""
    return (power_spectrum(samples) @ mel_filters()).clamp_min(FLOOR).log()


def normalise(mel: Tensor) -> Tensor:
    """Removes loudness, microphone and voice colour from one clip, [T, 64] → [T, 64]."""
    return (mel - clip_colour(mel)).clamp_min(DEEPEST) / SCALE


def clip_colour(mel: Tensor) -> Tensor:
    """The mean [64] of each band over the active frames of a raw log-mel [T, 64].

    The level of a frame is its mean over bands. If the mean of the result is under `QUIETEST_LEVEL`, all are
    raised together to it: near-silence stays silent instead of being amplified.
    """
    level = mel.mean(dim=1)
    active = level >= torch.quantile(level, ACTIVE_QUANTILE) - ACTIVE_RANGE
    colour = mel[active].mean(dim=0)
    return colour + (QUIETEST_LEVEL - colour.mean()).clamp_min(0.0)
