"""Golden of the ear for emotion on Whisper: three seconds of a synthetic voice, random weights."""

import json
from pathlib import Path

import numpy as np
import torch

from training.goldens import write_golden
from training.speech.emotion_ear import ARRAYS, EmotionLayer
from training.speech.train_emotion_of_whisper import rows_over_time
from training.speech.whisper import WhisperConfig, WhisperEncoder, to_hugging_face
from training.systems.emoface.emotion_encoder import HEARD_EMOTIONS
from training.systems.emoface.golden_emotion_encoder import made_voice

LAYERS = [1, 2]
WIDTH = 16


def write(out: Path, shared: Path) -> Path:
    """`whisper.*` and `weights.*`; `samples` [48000] → `logits` [I, 7] at instants 320 ms apart.

    `shared` is not used.
    """
    torch.manual_seed(41)
    random = np.random.default_rng(41)
    model = WhisperEncoder(WhisperConfig(layers=2, width=WIDTH, places=750, heads=2)).eval()
    with torch.no_grad():
        for parameter in model.parameters():
            parameter.add_(0.1 * torch.randn_like(parameter))
        for layer in model.layers:
            layer.query_key_value.bias[WIDTH : 2 * WIDTH] = 0.0
    samples = made_voice()
    rows = rows_over_time(model, samples, LAYERS)
    classes = len(HEARD_EMOTIONS)
    layer = EmotionLayer(
        rows.mean(axis=0), np.maximum(rows.std(axis=0), 0.1),
        0.1 * random.standard_normal((rows.shape[1], classes)), random.standard_normal(classes),
        rows.mean(axis=0) + 0.05,
    )  # fmt: skip
    about, weights = to_hugging_face(model)
    tensors = {f"whisper.{name}": value.detach() for name, value in weights.items()}
    tensors |= {f"weights.{name}": torch.from_numpy(getattr(layer, name)).float() for name in ARRAYS}
    tensors["weights.first_bias"] = model.first.bias.detach().clone()
    tensors["samples"] = torch.from_numpy(samples).float()
    tensors["logits"] = torch.from_numpy(layer.logits(rows)).float()
    config = {"channels": WIDTH, "layers": LAYERS, "emotions": HEARD_EMOTIONS}
    return write_golden(
        out / "emotion_of_whisper_debug.safetensors", tensors, "emotion_of_whisper",
        config=config, whisper=json.dumps(about),
    )  # fmt: skip
