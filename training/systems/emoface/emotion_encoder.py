"""The emotion encoder E_e: hears a speaker's emotion in two seconds of his voice (EmoFace §3.3.2).

For each instant, 118 numbers describe the last two seconds: pitch, voicing, loudness, tilt, cepstra and their
changes. A linear discriminant (Fisher 1936) with equal priors and a shrunken covariance turns these numbers
into six coordinates that separate the taught emotions, and into the probability of each emotion. Together
they are F_e. The paper uses wav2vec 2.0 instead. With 25 minutes of acted speech from ten actors, a
convolutional network recognised fewer emotions of an unheard actor than these numbers do.

Frames are the 10 ms frames of `log_mel`. Instants are 160 ms apart.
"""

from dataclasses import dataclass, field

import numpy as np
import torch

from training.nn.config import Config
from training.speech.log_mel import BANDS, FFT, FRAME, SAMPLE_RATE_HZ, log_mel, power_spectrum

HEARD_EMOTIONS = ["neutral", "angry", "happy", "afraid", "sad", "disgusted", "calm"]
"""The encoder's classes under the project's names. `calm` is the boredom of emodb_de."""
WINDOW, LEAST, STEP = 200, 80, 16
"""Length of a window, shortest length of a window, and step between instants, in frames of 10 ms."""
PEAK, SILENT = 0.9, 1e-4
ACTIVE_NEPERS = 4.0
"""Frames are active down to this many nepers below the loud level of their window."""
LOUD_SHARE = 0.95
LAGS = np.arange(SAMPLE_RATE_HZ // 400, SAMPLE_RATE_HZ // 65)
LOW_BIN, HIGH_BIN = 3, 48
"""FFT bins in which the pitch is sought: from the first bin above mains hum up to 1.5 kHz."""
PERIODIC = 0.6
LEAST_OVERLAP = 0.15
LEAST_VOICED = 6
NO_PITCH = 7.0
LARGEST_STEP = 0.2
"""Pitch steps between frames of this many octaves or more are left out: they come from another voice or an
error.
"""
CEPSTRA = 20
NUMBERS = 118


@dataclass
class EmotionEncoderConfig(Config):
    """Everything that inference has to know; saved as config.json."""

    model: str = "emotion"
    numbers: int = NUMBERS
    coordinates: int = 6
    emotions: list[str] = field(default_factory=lambda: list(HEARD_EMOTIONS))


@dataclass
class Voice:
    """`mel` [M, 64]: raw log-mel; `octave` [M]: pitch in log2 Hz; `periodic` [M]: periodicity, 0 to 1."""

    mel: np.ndarray
    octave: np.ndarray
    periodic: np.ndarray


def voice_of(samples: np.ndarray) -> Voice:
    """Measures the voice in samples [S] at 16 kHz, independent of their level."""
    peak = np.abs(samples).max(initial=0.0)
    scaled = torch.from_numpy(samples * (PEAK / peak if peak > SILENT else 1.0)).float()
    power = power_spectrum(scaled).numpy().astype(np.float64)
    bins = np.arange(LOW_BIN, HIGH_BIN)
    low = power[:, bins]
    correlation = low @ np.cos(2.0 * np.pi * np.outer(bins, LAGS) / FFT)
    share = correlation / np.maximum(low.sum(axis=1, keepdims=True), 1e-9)
    share /= np.maximum(overlap(), LEAST_OVERLAP)
    best = share.argmax(axis=1)
    return Voice(
        log_mel(scaled).numpy().astype(np.float64), np.log2(SAMPLE_RATE_HZ / LAGS[best]), share.max(axis=1)
    )


def overlap() -> np.ndarray:
    """Autocorrelation of the Hann window at the lags, relative to lag 0."""
    window = 0.5 - 0.5 * np.cos(2.0 * np.pi * np.arange(FRAME) / FRAME)
    whole = (window**2).sum()
    return np.array([(window[lag:] * window[: FRAME - lag]).sum() / whole for lag in LAGS])


def instants(frames: int) -> np.ndarray:
    """Ends of the windows in a voice of this many frames; none if it is too short."""
    return np.arange(LEAST, frames + 1, STEP) if frames >= LEAST else np.array([], int)


def cepstral_basis() -> np.ndarray:
    """Orthonormal DCT-II of the bands, [64, 20]."""
    k = np.arange(CEPSTRA)
    basis = np.cos(np.pi * (np.arange(BANDS)[:, None] + 0.5) * k / BANDS) * np.sqrt(2.0 / BANDS)
    basis[:, 0] /= np.sqrt(2.0)
    return basis


def numbers(voice: Voice) -> np.ndarray:
    """The numbers measured at each instant, [I, 118]."""
    cepstra = voice.mel @ cepstral_basis()
    rows = [of_window(voice, cepstra, max(end - WINDOW, 0), end) for end in instants(len(voice.mel))]
    return np.array(rows).reshape(-1, NUMBERS)


def of_window(voice: Voice, cepstra: np.ndarray, first: int, end: int) -> np.ndarray:
    mel = voice.mel[first:end]
    level = mel.mean(axis=1)
    loud = np.quantile(level, LOUD_SHARE)
    active = level > loud - ACTIVE_NEPERS
    voiced = (voice.periodic[first:end] > PERIODIC) & active
    relative = mel - loud
    moved = cepstra[first:end].copy()
    moved[:, 0] -= loud * np.sqrt(BANDS)
    change = np.diff(moved, axis=0)
    heard = moved[active]
    halves = relative[active][:, BANDS // 2 :].mean() - relative[active][:, : BANDS // 2].mean()
    ends = relative[active][:, -BANDS // 4 :].mean() - relative[active][:, : BANDS // 4].mean()
    coloured = relative[voiced if voiced.sum() >= LEAST_VOICED else active].mean(axis=0)[::4]
    return np.concatenate([
        _pitch(voice.octave[first:end], voiced),
        [level[active].std(), active.mean(), *np.quantile(level - loud, [0.1, 0.25, 0.5, 0.75])],
        [np.abs(np.diff(level)).mean(), halves, ends],
        heard.mean(axis=0), heard.std(axis=0), np.abs(change).mean(axis=0),
        change[active[1:]].std(axis=0) if active[1:].any() else np.zeros(CEPSTRA), coloured,
    ])  # fmt: skip


def _pitch(octave: np.ndarray, voiced: np.ndarray) -> np.ndarray:
    """Pitch and voicing of a window, [13]."""
    edges = np.diff(np.concatenate([[0], voiced.astype(int), [0]]))
    runs = np.flatnonzero(edges < 0) - np.flatnonzero(edges > 0)
    rate = [
        voiced.mean(),
        100.0 * len(runs) / len(voiced),
        *((runs.mean(), runs.std()) if len(runs) else (0, 0)),
    ]
    if voiced.sum() < LEAST_VOICED:
        return np.array([NO_PITCH, 0.0, *[NO_PITCH] * 5, 0.0, 0.0, *rate])
    spoken = octave[voiced]
    steps = np.diff(spoken)
    steps = steps[np.abs(steps) < LARGEST_STEP]
    moves = (np.abs(steps).mean(), steps.mean()) if len(steps) else (0.0, 0.0)
    return np.array(
        [spoken.mean(), spoken.std(), *np.quantile(spoken, [0.05, 0.25, 0.5, 0.75, 0.95]), *moves, *rate]
    )


@dataclass
class EmotionEncoder:
    """`mean`, `scale` [118] of the numbers; `coordinates` [118, 6]; `weight` [118, 7], `bias` [7]: logits."""

    config: EmotionEncoderConfig
    mean: np.ndarray
    scale: np.ndarray
    coordinates: np.ndarray
    weight: np.ndarray
    bias: np.ndarray

    def of_numbers(self, measured: np.ndarray) -> np.ndarray:
        """[I, 118] → F_e [I, 13]: coordinates and probabilities."""
        x = (measured - self.mean) / self.scale
        logits = x @ self.weight + self.bias
        logits -= logits.max(axis=1, keepdims=True)
        shares = np.exp(logits)
        return np.concatenate([x @ self.coordinates, shares / shares.sum(axis=1, keepdims=True)], axis=1)

    def track(self, samples: np.ndarray, frames: int, fps: float = 25.0) -> np.ndarray:
        """F_e at motion frames, [T, 13].

        Each frame hears the sound before it. Frames in the first 0.8 s hear all of those 0.8 s. A shorter
        sound has no emotion: its coordinates are 0, and its probabilities are those of the training's mean.
        """
        measured = numbers(voice_of(samples))
        if len(measured) == 0:
            measured = self.mean[None]
        heard = self.of_numbers(measured)
        at = (np.arange(frames) * (100.0 / fps) - LEAST) / STEP
        at = at.clip(0.0, len(heard) - 1)
        below = np.minimum(at.astype(int), max(len(heard) - 2, 0))
        above = np.minimum(below + 1, len(heard) - 1)
        share = (at - below)[:, None]
        return heard[below] * (1.0 - share) + heard[above] * share


def fitted(x: np.ndarray, labels: np.ndarray, shrinkage: float) -> EmotionEncoder:
    """Fits the discriminant to numbers [N, 118] with labels [N], which index `HEARD_EMOTIONS`."""
    mean, scale = x.mean(axis=0), np.maximum(x.std(axis=0), 1e-6)
    z = (x - mean) / scale
    classes = np.arange(len(HEARD_EMOTIONS))
    means = np.stack([z[labels == k].mean(axis=0) for k in classes])
    within = np.mean([np.cov(z[labels == k].T, bias=True) for k in classes], axis=0)
    level = np.trace(within) / len(within)
    within = (1.0 - shrinkage) * within + shrinkage * level * np.eye(len(within))
    weight = np.linalg.solve(within, means.T)
    bias = -0.5 * (means * weight.T).sum(axis=1)
    # Directions that separate the class means, scaled to unit deviation within the classes.
    value, vector = np.linalg.eigh(within)
    white = vector / np.sqrt(value)
    spread = (means - means.mean(axis=0)) @ white
    _, _, axes = np.linalg.svd(spread, full_matrices=False)
    config = EmotionEncoderConfig()
    return EmotionEncoder(config, mean, scale, white @ axes[: config.coordinates].T, weight, bias)
