"""Facts about the log-mel front end and the compact encoder."""

import math

import numpy as np
import torch

from training.corpus.revoice import revoice, voicing
from training.speech.compact import CompactConfig, CompactEncoder, debug_config, normalise
from training.speech.log_mel import HOP, hertz_to_mel, log_mel, mel_filters, power_spectrum


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


def test_encoder_runs_at_its_rate_and_size():
    encoder = CompactEncoder(CompactConfig())
    assert sum(p.numel() for p in encoder.parameters()) < 1.5e6
    small = CompactEncoder(debug_config())
    for frames in (1, 2, 3, 4, 5, 100, 101):
        assert small(torch.zeros(1, frames, 64)).shape[1] == math.ceil(math.ceil(frames / 2) / 2)


def test_feature_sees_the_sound_of_its_own_time():
    torch.manual_seed(1)
    encoder = CompactEncoder(debug_config()).eval()
    mel = torch.randn(1, 160, 64)
    changed = mel.clone()
    changed[0, 80] += 5.0
    difference = (encoder(changed) - encoder(mel)).abs().sum(dim=2)[0]
    assert int(difference.argmax()) == 20


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
