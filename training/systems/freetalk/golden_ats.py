"""Golden of the ATS denoiser: one pass and one whole sampling run over two windows."""

from pathlib import Path

import torch
from torch import Tensor

from training.goldens import randomise_norms, write_golden
from training.systems.freetalk.ats import AtsDenoiser, debug_config
from training.systems.freetalk.sampling import Sampling, sample_from


def write(out: Path, shared: Path) -> Path:
    """`weights.*`; one pass: `noisy`, `timestep`, `speech`, `affect`, `style` → `clean`.

    A sampling run: `long.noise` [T, 3N] (unit variance), `long.speech`, `long.affect` →
    `long.motion` [T, 3N] in metres with the configuration's own sampling, and
    `long.motion_warm` with temperature 0.7, 5 steps, leading. `shared` is not used.
    """
    torch.manual_seed(13)
    config = debug_config()
    model = AtsDenoiser(config).eval()
    randomise_norms(model)
    dims = 3 * config.landmarks
    model.mean.copy_(torch.randn(dims) * 1e-3)
    model.std.copy_(torch.rand(dims) * 3e-3 + 1e-3)
    tensors = _one_pass(model) | _sampling_run(model)
    return write_golden(
        out / "ats_compact_debug.safetensors", tensors, "ats_compact", model, config.to_json()
    )


@torch.no_grad()
def _one_pass(model: AtsDenoiser) -> dict[str, Tensor]:
    frames, dims = 21, 3 * model.config.landmarks
    inputs = {
        "noisy": torch.randn(2, frames, dims),
        "timestep": torch.tensor([999, 137]),
        "speech": torch.randn(2, frames, model.config.speech.channels),
        "affect": _affect(2 * frames).unflatten(0, (2, frames)),
        "style": torch.tensor([0, 1]),
    }
    return inputs | {"clean": model(**inputs)}


def _sampling_run(model: AtsDenoiser) -> dict[str, Tensor]:
    frames, dims = 71, 3 * model.config.landmarks
    noise = torch.randn(frames, dims)
    speech = torch.randn(frames, model.config.speech.channels)
    affect, style = _affect(frames), model.config.styles.index("facegood_zh")
    warm = Sampling(5, "leading", 0.7)
    return {
        "long.noise": noise,
        "long.speech": speech,
        "long.affect": affect,
        "long.motion": sample_from(model, noise, speech, affect, style, model.config.sampling),
        "long.motion_warm": sample_from(model, noise, speech, affect, style, warm),
    }


def _affect(frames: int) -> Tensor:
    mixture = torch.softmax(torch.randn(frames, 15), dim=1)
    return torch.cat([mixture, torch.rand(frames, 1) * 1.5], dim=1)
