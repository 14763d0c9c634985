"""Golden of the emotion encoder: three seconds of a synthetic voice, and a sound too short to measure."""

from pathlib import Path

import numpy as np
import torch

from training.goldens import write_golden
from training.systems.emoface.emotion_encoder import (
    NUMBERS,
    EmotionEncoder,
    EmotionEncoderConfig,
    numbers,
    voice_of,
)

RATE_HZ = 16000


def made_voice() -> np.ndarray:
    """A synthetic voice: three seconds of syllables with a moving pitch, [48000] f32."""
    random = np.random.default_rng(29)
    t = np.arange(3 * RATE_HZ) / RATE_HZ
    pitch = 160.0 * 2.0 ** (0.4 * np.sin(2.0 * np.pi * 0.9 * t))
    tone = sum(np.sin(2.0 * np.pi * k * np.cumsum(pitch) / RATE_HZ) / k for k in range(1, 12))
    loud = np.clip(np.sin(2.0 * np.pi * 2.3 * t) + 0.4, 0.0, 1.0)
    return (0.1 * tone * loud + 0.01 * random.standard_normal(len(t)) * (1.0 - loud)).astype(np.float32)


def write(out: Path, shared: Path) -> Path:
    """`weights.*`; `samples` [48000] → `numbers` [I, 118] and F_e, 25 fps: `track` [75, 13], `short` [5, 13]
    of the first 3,000 samples. `shared` is not used.
    """
    random = np.random.default_rng(29)
    samples = made_voice()
    random.standard_normal(len(samples))
    config, classes = EmotionEncoderConfig(), len(EmotionEncoderConfig().emotions)
    measured = numbers(voice_of(samples))
    model = EmotionEncoder(
        config, measured.mean(axis=0), np.maximum(measured.std(axis=0), 0.1),
        0.2 * random.standard_normal((NUMBERS, config.coordinates)),
        0.2 * random.standard_normal((NUMBERS, classes)), random.standard_normal(classes),
    )  # fmt: skip
    names = ("mean", "scale", "coordinates", "weight", "bias")
    for name in names:
        setattr(model, name, getattr(model, name).astype(np.float32).astype(np.float64))
    arrays = {f"weights.{name}": getattr(model, name) for name in names}
    arrays |= {"samples": samples, "numbers": measured, "track": model.track(samples, 75),
               "short": model.track(samples[:3000], 5)}  # fmt: skip
    tensors = {name: torch.from_numpy(np.ascontiguousarray(x)).float() for name, x in arrays.items()}
    return write_golden(
        out / "emotion_encoder_debug.safetensors", tensors, "emotion_encoder", None, config.to_json()
    )
