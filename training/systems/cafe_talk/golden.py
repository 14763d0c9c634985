"""Golden of Cafe-Talk's denoiser: single passes under every condition, and guided runs over two windows."""

from dataclasses import replace
from pathlib import Path

import torch
from torch import Tensor

from training.goldens import randomise_norms, write_golden
from training.systems.cafe_talk.denoiser import Coarse, Denoiser, Sampling, debug_config
from training.systems.cafe_talk.sampling import Request, sample_from


def write(out: Path, shared: Path) -> Path:
    """`weights.*`; one pass of 21 frames: `noisy`, `timestep`, `speech`, `emotion`, `intensity`, `style`,
    `events` → `clean`, `clean_base` (no events), `clean_null` (nothing given).

    Runs of 71 frames from `long.noise`: `long.weights` (no event), `long.controlled`, `long.over_speech`
    and `long.printed` with the events of `long.events` at `long.strength`. `shared` is not used.
    """
    torch.manual_seed(17)
    config = debug_config()
    config.sampling = Sampling(steps=4, temperature=0.7, alpha=1.3, beta=1.0)
    model = Denoiser(config).eval()
    randomise_norms(model)
    with torch.no_grad():
        for name, parameter in model.named_parameters():
            if name.endswith(
                ("film.linear.weight", "ada.linear.weight", "zero.weight", "null", "null_speech")
            ):
                parameter.copy_(torch.randn_like(parameter) * 0.1)
    channels = len(config.channels)
    model.mean.copy_(torch.rand(channels) * 0.2)
    model.std.copy_(torch.rand(channels) * 0.2 + 0.05)
    tensors = {"weights.emotions": torch.zeros(len(config.emotions), config.text_width)}
    tensors |= _one_pass(model) | _runs(model)
    return write_golden(out / "cafe_talk_debug.safetensors", tensors, "cafe_talk", model, config.to_json())


@torch.no_grad()
def _one_pass(model: Denoiser) -> dict[str, Tensor]:
    config, frames = model.config, 21
    inputs = _inputs(config, frames)
    noisy, timestep = torch.randn(1, frames, len(config.channels)), torch.tensor([731])
    yes, no = torch.tensor([True]), torch.tensor([False])
    coarse = Coarse(torch.tensor([1]), inputs["emotion"][None], inputs["intensity"][None], yes)
    speech, events = inputs["speech"][None], inputs["events"][None]
    nothing = Coarse(coarse.style, coarse.emotion, coarse.intensity, no)
    results = {
        "clean": model(noisy, timestep, speech, coarse, yes, events),
        "clean_base": model(noisy, timestep, speech, coarse, yes),
        "clean_null": model(noisy, timestep, speech, nothing, no),
    }
    arguments = {"noisy": noisy[0], "timestep": timestep, "style": torch.tensor([1])}
    return inputs | arguments | {name: value[0] for name, value in results.items()}


def _runs(model: Denoiser) -> dict[str, Tensor]:
    config, frames = model.config, 71
    inputs = _inputs(config, frames)
    noise = torch.randn(frames, len(config.channels))
    slots = inputs["events"].any(dim=1, keepdim=True).float()
    strength = slots * torch.linspace(0.0, 1.4, len(config.channels))
    tensors = {f"long.{name}": value for name, value in inputs.items()} | {
        "long.noise": noise,
        "long.strength": strength,
    }
    request = Request(2, inputs["emotion"], inputs["intensity"], inputs["events"], torch.zeros_like(noise))
    ways = {
        "weights": {},
        "controlled": {},
        "over_speech": {"over_speech": True},
        "printed": {"printed": True},
    }
    for name, way in ways.items():
        controlled = replace(
            request, strength=torch.zeros_like(noise) if name == "weights" else strength, **way
        )
        tensors[f"long.{name}"] = sample_from(model, noise, inputs["speech"], controlled)
    return tensors


def _inputs(config, frames: int) -> dict[str, Tensor]:
    events = torch.zeros(frames, 2 * len(config.units))
    events[5:9, [3, 19]] = 1.0
    events[14:15, 8] = 1.0
    return {
        "speech": torch.randn(frames, config.speech.channels),
        "emotion": torch.randn(frames, config.text_width) * 0.2,
        "intensity": torch.rand(frames) * 1.5,
        "events": events,
    }
