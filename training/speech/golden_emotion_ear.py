"""Golden of the ear for emotion: three seconds of a synthetic voice through a small network."""

from pathlib import Path

import numpy as np
import torch

from training.goldens import write_golden
from training.speech.emotion_ear import ARRAYS, EmotionEar, EmotionEarConfig, EmotionEarNet
from training.systems.emoface.emotion_encoder import NUMBERS, numbers, voice_of
from training.systems.emoface.golden_emotion_encoder import made_voice


def write(out: Path, shared: Path) -> Path:
    """`weights.*`; `samples` [48000] → `logits` [I, 7] at every instant. `shared` is not used."""
    torch.manual_seed(31)
    random = np.random.default_rng(31)
    samples = made_voice()
    config = EmotionEarConfig(channels=16, coarse_dilations=[1, 2], hidden=24, told=12)
    net = EmotionEarNet(config).eval()
    voice = voice_of(samples)
    measured = numbers(voice)
    rows, classes = config.told + NUMBERS, len(config.emotions)
    ear = EmotionEar(
        np.concatenate([np.zeros(config.told), measured.mean(axis=0)]),
        np.concatenate([np.full(config.told, 0.3), np.maximum(measured.std(axis=0), 0.1)]),
        0.1 * random.standard_normal((rows, classes)), random.standard_normal(classes),
        np.concatenate([0.1 * random.standard_normal(config.told), measured.mean(axis=0) + 0.05]),
        config, net,
    )  # fmt: skip
    for name in ARRAYS:
        setattr(ear, name, getattr(ear, name).astype(np.float32).astype(np.float64))
    tensors = {f"weights.{name}": torch.from_numpy(x).float() for name, x in ear.arrays().items()}
    arrays = {"samples": samples, "logits": ear.hear(voice)}
    tensors |= {name: torch.from_numpy(x).float() for name, x in arrays.items()}
    return write_golden(out / "emotion_ear_debug.safetensors", tensors, "emotion_ear", net, config.to_json())
