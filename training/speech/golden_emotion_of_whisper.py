"""Golden of the ear for the emotion of a recording: three seconds of a synthetic voice, random weights."""

import json
from pathlib import Path

import numpy as np
import torch

from training.goldens import write_golden
from training.speech.emotion_ear import ARRAYS, EmotionLayer
from training.speech.train_emotion_of_whisper import rows_over_time
from training.speech.whisper import BANDS, CONTEXT, SPAN, WhisperConfig, WhisperEncoder, sinusoids
from training.systems.emoface.emotion_encoder import HEARD_EMOTIONS
from training.systems.emoface.golden_emotion_encoder import made_voice

LAYERS = [1, 2]
WIDTH, HEADS = 16, 2
PLACES = SPAN + 2 * CONTEXT


@torch.no_grad()
def write(out: Path, shared: Path) -> Path:
    """`weights.*` and `weights.trunk.*`; `samples` [48000] → `logits` [I, 7] at instants 320 ms apart.

    `shared` is not used.
    """
    torch.manual_seed(41)
    random = np.random.default_rng(41)
    # The last layer's output has Whisper's final norm, which the trunk lacks. So there is one more layer.
    sizes = WhisperConfig(layers=len(LAYERS) + 1, width=WIDTH, places=PLACES, heads=HEADS)
    model = WhisperEncoder(sizes).eval()
    for parameter in model.parameters():
        parameter.add_(0.1 * torch.randn_like(parameter))
    model.places.copy_(sinusoids(PLACES, WIDTH))
    samples = made_voice()
    rows = rows_over_time(model, samples, LAYERS)
    classes = len(HEARD_EMOTIONS)
    layer = EmotionLayer(
        rows.mean(axis=0), np.maximum(rows.std(axis=0), 0.1),
        0.1 * random.standard_normal((rows.shape[1], classes)), random.standard_normal(classes),
        rows.mean(axis=0) + 0.05,
    )  # fmt: skip
    parts = ("first.", "second.", *(f"layers.{number}." for number in range(len(LAYERS))))
    tensors = {f"weights.trunk.{k}": v for k, v in model.state_dict().items() if k.startswith(parts)}
    tensors |= {f"weights.{name}": torch.from_numpy(getattr(layer, name)).float() for name in ARRAYS}
    tensors["samples"] = torch.from_numpy(samples).float()
    tensors["logits"] = torch.from_numpy(layer.logits(rows)).float()
    config = {"channels": WIDTH, "layers": LAYERS, "emotions": HEARD_EMOTIONS}
    about = {"model": "whisper_trunk", "bands": BANDS, "width": WIDTH, "heads": HEADS}
    about |= {"feedforward": 4 * WIDTH, "layers": len(LAYERS)}
    return write_golden(
        out / "emotion_of_whisper_debug.safetensors", tensors, "emotion_of_whisper",
        config=config, trunk_config=json.dumps(about),
    )  # fmt: skip
