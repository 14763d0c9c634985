"""Facts about the denoiser and its sampling."""

import pytest
import torch

from training.systems.freetalk.ats import (
    AtsConfig,
    AtsDenoiser,
    Sampling,
    compact_config,
    debug_config,
    paper_config,
)
from training.systems.freetalk.sampling import sample_motion, window_starts


@pytest.fixture
def model() -> AtsDenoiser:
    """A random debug model."""
    torch.manual_seed(0)
    return AtsDenoiser(debug_config()).eval()


def affect(frames: int, emotion: int = 0, intensity: float = 0.0) -> torch.Tensor:
    """One emotion throughout, [T, 16]."""
    rows = torch.zeros(frames, 16)
    rows[:, emotion] = 1.0
    rows[:, 15] = intensity
    return rows


def test_config_survives_json():
    for config in (compact_config(), paper_config(), debug_config()):
        assert AtsConfig.from_json(config.to_json()) == config


def test_paper_sizes():
    config = paper_config()
    assert (config.width, config.layers, config.heads, config.feedforward) == (512, 6, 8, 2048)
    assert (config.diffusion.train_steps, config.sampling.steps) == (1000, 100)


def test_windows_cover_every_frame():
    for frames in (1, 31, 32, 33, 55, 56, 57, 200):
        covered = torch.zeros(frames)
        for start in window_starts(frames, 32, 8):
            covered[start : start + 32] += 1
        assert (covered > 0).all()


def test_intensity_zero_is_neutral_exactly(model):
    noise, speech = torch.randn(1, 20, 204), torch.randn(1, 20, 16)
    t, style = torch.tensor([500]), torch.tensor([0])
    a = model(noise, t, speech, affect(20)[None], style)
    b = model(noise, t, speech, affect(20, 4, 0.0)[None], style)
    c = model(noise, t, speech, affect(20, 0, 1.0)[None], style)
    d = model(noise, t, speech, affect(20, 4, 1.0)[None], style)
    assert torch.equal(a, b) and torch.equal(a, c)
    assert not torch.allclose(a, d)


def test_speech_outside_the_band_is_not_heard_by_one_layer():
    torch.manual_seed(0)
    config = debug_config()
    config.layers = 1
    model = AtsDenoiser(config).eval()
    noise, speech = torch.randn(1, 30, 204), torch.randn(1, 30, 16)
    other = speech.clone()
    other[0, 20] += 3.0
    t, style = torch.tensor([500]), torch.tensor([0])
    rows = affect(30)[None]
    changed = (model(noise, t, speech, rows, style) - model(noise, t, other, rows, style)).abs()
    moved = changed.sum(dim=2)[0] > 1e-6
    expected = list(range(20 - config.radius, 20 + config.radius + 1))
    assert moved.nonzero().flatten().tolist() == expected


def test_same_seed_same_motion_and_temperature_zero_forgets_it(model):
    speech, rows = torch.randn(70, 16), affect(70)
    warm = Sampling(3, "trailing", 1.0)
    a, b, c = (sample_motion(model, speech, rows, 0, seed, warm) for seed in (1, 1, 2))
    assert torch.equal(a, b) and not torch.allclose(a, c)
    cold = Sampling(3, "trailing", 0.0)
    assert torch.equal(*(sample_motion(model, speech, rows, 0, seed, cold) for seed in (1, 2)))


def test_wrong_number_of_speech_frames_is_refused(model):
    with pytest.raises(ValueError, match="expected 20, got 19"):
        model(
            torch.randn(1, 20, 204),
            torch.tensor([0]),
            torch.randn(1, 19, 16),
            affect(20)[None],
            torch.tensor([0]),
        )
