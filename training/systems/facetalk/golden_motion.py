"""Golden of FaceTalk's speech model: single passes with and without speech, and guided runs."""

from dataclasses import replace
from pathlib import Path

import torch

from training.goldens import randomise_norms, write_golden
from training.systems.facetalk.motion import Denoiser, debug_config, sample_from

FRAMES = 20


@torch.no_grad()
def write(out: Path, shared: Path) -> Path:
    """`weights.*` (without the prefix `motion.`); `noisy`, `noise` [T, X], `timestep` [1], `speech` [T, C],
    `vividness` [1] → `clean`, `clean_null` (one pass), `codes` (guidance 1), `guided` (guidance 1.7, r 1.2).
    `shared` is not used.
    """
    torch.manual_seed(37)
    config = debug_config()
    model = Denoiser(config).eval()
    randomise_norms(model)
    for name, parameter in model.named_parameters():
        if name.startswith("film.") or name == "null_speech":
            parameter.copy_(0.2 * torch.randn_like(parameter))
    model.mean.copy_(0.3 * torch.randn(config.codes))
    model.std.copy_(0.2 + torch.rand(config.codes))
    noisy, noise = torch.randn(FRAMES, config.codes), torch.randn(FRAMES, config.codes)
    speech, timestep = torch.randn(FRAMES, config.speech.channels), torch.tensor([412])
    yes, no, r = torch.tensor([True]), torch.tensor([False]), torch.tensor([1.15])
    plain = replace(config.sampling, guidance=1.0)
    strong = replace(config.sampling, guidance=1.7, vividness=1.2, temperature=0.8)
    tensors = {
        "noisy": noisy,
        "noise": noise,
        "timestep": timestep,
        "speech": speech,
        "vividness": r,
        "clean": model(noisy[None], timestep, speech[None], yes, r)[0],
        "clean_null": model(noisy[None], timestep, speech[None], no, r)[0],
        "codes": sample_from(model, noise, speech, plain),
        "guided": sample_from(model, noise, speech, strong),
    }
    return write_golden(
        out / "facetalk_motion_debug.safetensors", tensors, "facetalk_motion", model, config.to_json()
    )
