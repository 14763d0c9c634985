"""One recorded performance: speech and the landmark motion that belongs to it."""

from dataclasses import dataclass

import numpy as np
import soundfile
import torch

from training.corpus.phones import Phone

FPS = 25.0
MEL_PER_FRAME = 4


@dataclass
class Clip:
    """Speech and motion on one clock: motion frame i is at second i / 25 of the sound.

    `samples` [S] f32 at 16 kHz. `motion` [T, 68, 3] f32, displacement from the neutral face in
    canonical metres. `weight` [T, 68] f32 is 0 where the source did not observe a landmark or
    lost it. `neutral` [68, 3] f32 in canonical metres up to a translation. `emotion` is one of the
    fifteen, `intensity` 0 to 1.5. `phones` is None if nobody timed them.
    """

    name: str
    source: str
    held_out: bool
    samples: np.ndarray
    motion: np.ndarray
    weight: np.ndarray
    neutral: np.ndarray
    emotion: str = "neutral"
    intensity: float = 0.0
    phones: list[Phone] | None = None


def read_sound(path) -> np.ndarray:
    """Reads mono samples [S] f32. Raises `ValueError` unless the file has 16 kHz."""
    samples, rate_hz = soundfile.read(path, dtype="float32", always_2d=True)
    if rate_hz != 16000:
        raise ValueError(f"{path}: expected 16000 Hz, got {rate_hz}")
    return samples.mean(axis=1)


def fit_frames(x: torch.Tensor, frames: int) -> torch.Tensor:
    """Cuts [T, …] to `frames`, or repeats its last row."""
    if x.shape[0] >= frames:
        return x[:frames]
    return torch.cat([x, x[-1:].expand(frames - x.shape[0], *x.shape[1:])])


def inner_gap(motion: np.ndarray, neutral: np.ndarray) -> np.ndarray:
    """Distance between the inner lips (landmarks 62, 66), [T] metres; `motion` [T, 68, 3]."""
    shape = motion + neutral
    return np.linalg.norm(shape[:, 62] - shape[:, 66], axis=1)
