"""Facts about the log-mel front end and HuBERT."""

import math
from pathlib import Path

import numpy as np
import pytest
import torch
from safetensors import safe_open
from safetensors.torch import load_file, save_file

from training.corpus.revoice import revoice, voicing
from training.speech import golden_instants
from training.speech.hubert import HubertFeatures, at_motion_frames, encode, instants
from training.speech.log_mel import HOP, hertz_to_mel, log_mel, mel_filters, normalise, power_spectrum

GOLDENS = Path(__file__).resolve().parents[2] / "tests/goldens"


def tone(hertz: float, seconds: float = 0.5, amplitude: float = 0.5) -> torch.Tensor:
    """A sine at 16 kHz."""
    time = torch.arange(int(16000 * seconds)) / 16000
    return amplitude * torch.sin(2 * math.pi * hertz * time)


def slow_log_mel(samples: np.ndarray) -> np.ndarray:
    """The definition, frame by frame, in double precision."""
    window = 0.5 - 0.5 * np.cos(2 * np.pi * np.arange(400) / 400)
    filters = mel_filters().numpy().astype(np.float64)
    rows = []
    for i in range(1 + len(samples) // HOP):
        frame = np.zeros(400)
        for k in range(400):
            s = HOP * i - 200 + k
            frame[k] = samples[s] if 0 <= s < len(samples) else 0.0
        power = np.abs(np.fft.rfft(frame * window, 512)) ** 2
        rows.append(np.log(np.maximum(power @ filters, 1e-6)))
    return np.stack(rows)


def test_log_mel_equals_its_definition():
    samples = (tone(300.0, 0.21) + tone(2500.0, 0.21, 0.1)).numpy()
    fast = log_mel(torch.from_numpy(samples)).numpy()
    assert fast.shape == (1 + len(samples) // HOP, 64)
    np.testing.assert_allclose(fast, slow_log_mel(samples), atol=2e-3)


def test_filters_peak_at_most_one_and_cover_the_band():
    filters = mel_filters()
    assert filters.max() <= 1.0
    assert (filters.sum(dim=1)[4:240] > 0.2).all()


def test_tone_peaks_in_its_own_band():
    band = int(log_mel(tone(1000.0))[20].argmax())
    edges = np.linspace(hertz_to_mel(50.0), hertz_to_mel(7600.0), 66)
    assert edges[band] < hertz_to_mel(1000.0) < edges[band + 2]


def test_normalisation_removes_loudness():
    torch.manual_seed(0)
    samples = tone(200.0, 1.0) * torch.linspace(0, 1, 16000) + 1e-2 * torch.randn(16000)
    a, b = (normalise(log_mel(samples * gain)) for gain in (1.0, 0.1))
    torch.testing.assert_close(a, b, atol=0.02, rtol=0)


def test_silence_stays_far_below_speech():
    assert (normalise(log_mel(torch.zeros(16000))) < -1.0).all()


def test_fundamental_of_a_pulse_train_is_found():
    time = torch.arange(8000)
    pulses = (time % 100 == 0).float()
    strength, pitch = voicing(power_spectrum(pulses).numpy())
    assert strength[10:40].mean() > 0.8
    assert abs(np.median(pitch[10:40]) - 160.0) < 8.0


def test_revoiced_clip_keeps_its_timing():
    torch.manual_seed(2)
    speech = torch.where(torch.arange(16000) % 100 == 0, 1.0, 0.0) + 1e-3 * torch.randn(16000)
    speech[:8000] *= 0.001
    other = revoice(speech.numpy().astype(np.float32), np.random.default_rng(3))
    level = other.mean(axis=1)
    assert other.shape == (101, 64)
    assert level[60:95].min() > level[5:45].max()


def written(name: str, folder, pickled: bool = False):
    """A golden as a Hugging Face folder; returns its arrays."""
    with safe_open(GOLDENS / f"{name}.safetensors", "pt") as file:
        tensors, metadata = {key: file.get_tensor(key) for key in list(file.keys())}, file.metadata()
    state = {k.removeprefix("weights."): v for k, v in tensors.items() if k.startswith("weights.")}
    folder.mkdir()
    (folder / "config.json").write_text(metadata["config"])
    if pickled:
        torch.save({f"hubert.{k}": v for k, v in state.items()}, folder / "pytorch_model.bin")
    else:
        save_file(state, folder / "model.safetensors")
    return tensors


@pytest.mark.parametrize("name", ["hubert_tiny", "wav2vec2_tiny", "wav2vec2_stable_tiny"])
def test_transformer_encoders_match_hugging_face(name, tmp_path):
    tensors = written(name, tmp_path / "model", pickled=name == "hubert_tiny")
    features = HubertFeatures(tmp_path / "model")
    output = encode(features.model, features.config, tensors["input"][0])
    assert (output - tensors["output"][0]).abs().max() < 1e-4


@pytest.mark.parametrize("name", ["hubert_tiny", "wav2vec2_tiny", "wav2vec2_stable_tiny"])
def test_the_rate_may_be_changed_before_the_transformer(name, tmp_path):
    tensors = written(name, tmp_path / "model")
    expected = load_file(GOLDENS / "resampled_speech.safetensors")[name]
    features = HubertFeatures(tmp_path / "model", transformer_fps=30.0)
    output = encode(features.model, features.config, tensors["input"][0], len(expected), 30.0)
    torch.testing.assert_close(output, expected, atol=1e-4, rtol=1e-4)
    # The motion's frames are cut out of that.
    features.transformer_fps = 25.0
    assert features(tensors["input"][0], 25).shape == (25, features.channels)


def test_features_of_hubert_stand_in_the_middle_of_what_they_hear():
    config = {"conv_kernel": [10, 3, 3, 3, 3, 2, 2], "conv_stride": [5, 2, 2, 2, 2, 2, 2]}
    rate_hz, first_s = instants(config)
    assert (rate_hz, first_s) == (50.0, 0.0125)
    ramp = torch.arange(60.0)[:, None]
    output = at_motion_frames(ramp, rate_hz, first_s, 25, 25.0)[:, 0]
    assert torch.allclose(output[1:], 2.0 * torch.arange(1, 25) - 0.625)


def test_instants_golden_is_that_of_this_code(tmp_path):
    stored = load_file(GOLDENS / "instants.safetensors")
    rewritten = load_file(golden_instants.write(tmp_path, tmp_path))
    assert all(torch.equal(stored[name], rewritten[name]) for name in rewritten)
