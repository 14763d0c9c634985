"""Lets other voices say the same words: a spectral re-voicing that keeps the timing.

It is needed because motion was recorded of only two people. The envelope of each frame's power spectrum
is taken by smoothing over twice the fundamental. Its frequency axis is stretched, which gives another vocal
tract. Voiced frames get the harmonics of another fundamental with its own melody. No waveform is needed,
because the encoder only sees mel power.
"""

import numpy as np
import torch
from scipy.ndimage import convolve1d, gaussian_filter1d

from training.speech.log_mel import FFT, FLOOR, FRAME, SAMPLE_RATE_HZ, mel_filters, power_spectrum

BIN_HZ = SAMPLE_RATE_HZ / FFT
PITCH_HZ = (75.0, 290.0)
TRACT_OCTAVES = 0.25
VOICED_UP_TO_HZ = 4500.0
HUM_HZ = 70.0
COMPRESSION = 0.25
COLOUR_NEPERS = 1.0
NOISE_NEPERS = (1.5, 9.0)
"""A room's noise lies this far below the speech, in nepers of power: range of a random value."""
ECHO_FRAMES = 40


def voicing(power: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Periodicity 0 … 1 and fundamental in Hz of each frame, [T] each, from the autocorrelation.

    Mains hum and quiet frames (more than 6 nepers of power under the loud ones) count as unvoiced.
    `power` [T, 257] of Hann-windowed frames.
    """
    lags = np.arange(SAMPLE_RATE_HZ // 400, SAMPLE_RATE_HZ // 65)
    window = np.fft.irfft(np.abs(np.fft.rfft(np.hanning(FRAME), FFT)) ** 2)
    low = power.copy()
    low[:, int(1500 / BIN_HZ) :] = 0.0
    low[:, : int(HUM_HZ / BIN_HZ) + 1] = 0.0
    loudness = np.log(low.sum(axis=1) + 1e-9)
    loud = np.clip((loudness - np.quantile(loudness, 0.95) + 6.0) / 2.0, 0.0, 1.0)
    correlation = np.fft.irfft(low, axis=1)
    share = correlation[:, lags] / np.maximum(correlation[:, :1], 1e-9)
    share = share / np.maximum(window[lags] / window[0], 0.15)
    best = share.argmax(axis=1)
    strength = np.clip((share.max(axis=1) - 0.45) / 0.3, 0.0, 1.0)
    return strength * loud, SAMPLE_RATE_HZ / lags[best]


def envelope(power: np.ndarray, fundamental_hz: float) -> np.ndarray:
    """Power smoothed over ± one fundamental with a triangle: harmonics vanish, formants stay.

    It smooths power^0.25, so that a strong low hum does not spread over the first formant.
    """
    half = max(1, round(fundamental_hz / BIN_HZ))
    triangle = 1.0 - np.abs(np.arange(-half, half + 1)) / (half + 1)
    compressed = convolve1d(power**COMPRESSION, triangle / triangle.sum(), axis=1, mode="nearest")
    return compressed ** (1.0 / COMPRESSION)


def harmonics(fundamental_hz: np.ndarray) -> np.ndarray:
    """Power of a pulse train through the Hann window, mean 1 over frequency, [T, 257]."""
    hertz = np.arange(FFT // 2 + 1)[None] * BIN_HZ
    f0 = fundamental_hz[:, None]
    off = hertz - f0 * np.maximum(np.round(hertz / f0), 1.0)
    x = off * FRAME / SAMPLE_RATE_HZ
    lobe = np.sinc(x) / np.where(np.abs(1.0 - x**2) < 1e-6, 1e-6, 1.0 - x**2)
    area_hz = 1.5 * SAMPLE_RATE_HZ / FRAME
    return lobe**2 * f0 / area_hz + 1e-3


def revoice(samples: np.ndarray, random: np.random.Generator) -> np.ndarray:
    """Log-mel [1 + S // 160, 64] of the same words in another voice."""
    power = revoiced_power(samples, random)
    return np.log(np.maximum(power @ mel_filters().numpy(), FLOOR)).astype(np.float32)


def revoiced_power(samples: np.ndarray, random: np.random.Generator) -> np.ndarray:
    """Power spectra [1 + S // 160, 257] of the same words in another voice, for any filters."""
    power = power_spectrum(torch.from_numpy(samples)).numpy().astype(np.float64)
    strength, pitch = voicing(power)
    voiced = pitch[strength > 0.5]
    smooth = envelope(power, float(np.median(voiced)) if len(voiced) else 120.0)
    tract = 2.0 ** random.uniform(-TRACT_OCTAVES, TRACT_OCTAVES)
    breath = random.exponential(size=smooth.shape) * 0.7 + 0.3
    hertz = np.arange(FFT // 2 + 1) * BIN_HZ
    band = 1.0 / (1.0 + np.exp((hertz - VOICED_UP_TO_HZ * random.uniform(0.5, 1.2)) / 500.0))
    tonal = strength[:, None] * band[None]
    comb = harmonics(_melody(len(power), random))
    unvoiced = np.where(strength[:, None] > 0.3, smooth * breath, power)
    stretched = [_stretch(x, tract) for x in (smooth, unvoiced)]
    return tonal * stretched[0] * comb + (1.0 - tonal) * stretched[1]


def other_room(power: np.ndarray, random: np.random.Generator) -> np.ndarray:
    """Power spectra [T, F] of the same sound through another microphone, in a room with steady noise."""
    colour, noise = (_curve(power.shape[1], random) for _ in range(2))
    heard = power * np.exp(COLOUR_NEPERS * colour)
    decay, gain = random.uniform(3.0, 12.0), random.uniform(0.0, 0.5)
    tail = gain / decay * np.exp(-np.arange(1, ECHO_FRAMES) / decay)
    heard = convolve1d(
        heard, np.concatenate([np.zeros(ECHO_FRAMES - 1), [1.0], tail]), axis=0, mode="constant"
    )
    level = np.quantile(heard, 0.9, axis=0).mean() * np.exp(-random.uniform(*NOISE_NEPERS))
    return heard + level * np.exp(noise) * random.gamma(1.0, 1.0, heard.shape)


def _curve(bins: int, random: np.random.Generator) -> np.ndarray:
    """A smooth random curve over frequency, [F], with standard deviation 1 at its six knots."""
    return np.interp(np.linspace(0.0, 5.0, bins), np.arange(6), random.standard_normal(6))


def _melody(frames: int, random: np.random.Generator) -> np.ndarray:
    """A wandering fundamental, [T] Hz."""
    base = np.exp(random.uniform(*np.log(PITCH_HZ)))
    wander = gaussian_filter1d(random.standard_normal(frames), 20.0, mode="nearest")
    wander = wander / max(wander.std(), 1e-6) * random.uniform(0.05, 0.18)
    return base * np.exp(np.clip(wander, -0.5, 0.5))


def _stretch(power: np.ndarray, factor: float) -> np.ndarray:
    """Moves every formant at f to f · factor."""
    position = np.clip(np.arange(power.shape[1]) / factor, 0, power.shape[1] - 1.001)
    below = position.astype(int)
    share = position - below
    return power[:, below] * (1.0 - share) + power[:, below + 1] * share
