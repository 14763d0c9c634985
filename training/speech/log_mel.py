"""Log-mel spectrogram of 16 kHz mono speech: the input of the compact encoder."""

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
