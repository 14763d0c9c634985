"""Golden of the ear: tiny random layers of Whisper, a tiny random body, and 1.3 seconds of swelling noise."""

import json
from pathlib import Path

import torch

from training.goldens import randomise_norms, write_golden
from training.speech.ear import EarBody, debug_config, ear_mel
from training.speech.whisper import BANDS, CONTEXT, SPAN, WhisperConfig, WhisperEncoder, sinusoids

LAYERS, HEADS = 2, 2
PLACES = SPAN + 2 * CONTEXT


@torch.no_grad()
def write(out: Path, shared: Path) -> Path:
    """`trunk.*` and `body.*`; `input` [S], `mel` [T, 80], `output` [⌈T / 4⌉, C].

    `shared` is not used.
    """
    torch.manual_seed(31)
    config = debug_config()
    # The last layer's output has Whisper's final norm, which the trunk lacks. So there is one more layer.
    sizes = WhisperConfig(layers=LAYERS + 1, width=config.width, places=PLACES, heads=HEADS)
    whisper, body = WhisperEncoder(sizes).eval(), EarBody(config).eval()
    for parameter in whisper.parameters():
        parameter.add_(0.2 * torch.randn_like(parameter))
    whisper.places.copy_(sinusoids(PLACES, config.width))
    randomise_norms(body)
    body.mean.normal_()
    body.deviation.uniform_(0.5, 2.0)
    samples = 0.1 * torch.randn(20900) * torch.linspace(0.1, 1.0, 20900)
    mel = ear_mel(samples)
    heard = torch.stack(whisper.hear(mel, config.taps))
    features = body(heard[None])[0]
    parts = ("first.", "second.", *(f"layers.{number}." for number in range(LAYERS)))
    tensors = {f"trunk.{k}": v for k, v in whisper.state_dict().items() if k.startswith(parts)}
    tensors |= {f"body.{k}": v for k, v in body.state_dict().items()}
    tensors |= {"input": samples, "mel": mel, "output": features}
    about = {"model": "whisper_trunk", "bands": BANDS, "width": config.width, "heads": HEADS}
    about |= {"feedforward": 4 * config.width, "layers": LAYERS}
    return write_golden(
        out / "ear_debug.safetensors", tensors, "ear",
        trunk_config=json.dumps(about), body_config=json.dumps(config.to_json()),
    )  # fmt: skip
