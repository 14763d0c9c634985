"""Measures of other tools beside ours, on made-up signals whose answers are known."""

import numpy as np
import pytest
import torch

from training.benchmarks.peers.fit import Moments, at_frames, best_fit, ridge, shifted
from training.benchmarks.peers.page import page
from training.benchmarks.peers.recordings import Recording, closure_windows, mouth_features, smallest_gaps
from training.benchmarks.peers.table import Row, Source, best_lag, gap_correlation, measure
from training.benchmarks.peers.tools import SHAPES, shapes
from training.corpus.phones import Phone
from training.paper.metrics import (
    lip_intensity,
    path_costs,
    speech_lip_correlation,
    temporal_misalignment,
)
from training.speech.strangers import feature_scores

FRAMES = 300


def opening(delay: float = 0.0) -> np.ndarray:
    """A mouth that opens once in 24 frames, `delay` frames late, [T]."""
    return 5.0 - 5.0 * np.cos(2.0 * np.pi * (np.arange(FRAMES) - delay) / 24.0)


def made_up(name: str, seed: int, rest_mm: float = 0.0) -> Recording:
    """A mouth of three smooth random curves, in sound that swells."""
    random = np.random.default_rng(seed)
    truth = np.cumsum(random.standard_normal((FRAMES, 3)), axis=0)
    mel = torch.sin(torch.arange(4 * FRAMES) / 20.0)[:, None].repeat(1, 64)
    samples = random.standard_normal(640 * FRAMES).astype(np.float32)
    return Recording(name, samples, truth, mel, slice(0, FRAMES), rest_mm, "", [])


def test_extrema_that_come_late_are_misaligned_by_their_delay():
    assert temporal_misalignment(opening(), opening()).max() == 0.0
    for delay in (2, 4):
        off = temporal_misalignment(opening(delay), opening())
        assert len(off) >= 20
        assert np.median(off) == delay
        assert off.mean() == pytest.approx(delay, abs=0.3)


def test_a_size_or_an_offset_misaligns_nothing():
    other = temporal_misalignment(0.9 * opening() + 7.0, opening())
    assert len(other) >= 20 and other.mean() < 0.2


def test_a_still_mouth_has_no_extrema():
    assert len(temporal_misalignment(np.ones(FRAMES), opening())) == 0


def test_the_cheapest_path_is_that_of_a_loop():
    between = np.random.default_rng(0).random((7, 5))
    for joined in (np.add, np.maximum):
        cost = np.full((8, 6), np.inf)
        cost[0, 0] = 0.0
        for i in range(7):
            for j in range(5):
                before = min(cost[i, j + 1], cost[i + 1, j], cost[i, j])
                cost[i + 1, j + 1] = joined(between[i, j], before)
        np.testing.assert_array_equal(path_costs(between, joined), cost)


def test_lips_that_move_as_the_voice_is_loud_have_an_slcc_of_one():
    speech = np.array([0.1, 0.2, 0.4, 0.3])
    wave = np.stack([np.sin(np.arange(75) / 3.0), np.zeros(75)], axis=1)[:, None]
    lips = np.array([lip_intensity(3.0 * level * wave) for level in speech])
    assert speech_lip_correlation(lips, speech) == pytest.approx(1.0)
    assert speech_lip_correlation(-lips, speech) == pytest.approx(-1.0)


def test_lip_intensity_is_the_root_mean_square_of_the_points_mean_step():
    steps = np.array([[[0.0, 0.0], [0.0, 0.0]], [[3.0, 4.0], [0.0, 1.0]], [[3.0, 4.0], [0.0, 3.0]]])
    assert lip_intensity(steps) == pytest.approx(np.sqrt((3.0**2 + 1.0**2) / 2))


def test_within_speech_pauses_do_not_count():
    time = torch.arange(200)
    level = torch.where(time < 100, -1.0, -12.0)
    true = torch.where(time < 100, torch.sin(time / 5.0), torch.full((200,), -8.0))
    other = torch.where(time < 100, torch.cos(time / 5.0), torch.full((200,), -8.0))
    right = feature_scores([(true, true, level)])
    wrong = feature_scores([(other, true, level)])
    assert right["speech"] == pytest.approx(1.0, abs=1e-5) and right["slope"] == pytest.approx(1.0)
    assert wrong["r"] > 0.9 and abs(wrong["speech"]) < 0.1


def test_a_line_over_loudness_tells_nothing_beyond_loudness():
    level = torch.sin(torch.arange(200) / 7.0)
    true = level + 0.5 * torch.sin(torch.arange(200) / 2.0)
    scores = feature_scores([(3.0 * level - 1.0, true, level)])
    assert scores["r"] > 0.8 and scores["beyond"] == 0.0
    assert feature_scores([(torch.ones(200), true, level)])["r"] == 0.0


def test_a_linear_tool_that_is_late_is_found_again():
    recordings = [made_up(str(k), k) for k in range(5)]
    mix = np.random.default_rng(9).standard_normal((3, 6))
    late = {r.name: shifted(r.truth @ mix + 2.0, -3) for r in recordings}
    turns = [(recordings[:4], recordings[4:])]
    fitted = best_fit(late, turns, lambda mouths: gap_correlation(mouths, recordings[4:]))
    assert (fitted.lag, fitted.sigma) == (3, 0.0)
    inner = slice(0, FRAMES - 3)
    np.testing.assert_allclose(fitted.mouths["4"][inner], recordings[4].truth[inner], atol=0.1)
    assert best_lag({"4": shifted(recordings[4].truth, -2)}, recordings[4:]) == 80.0


def test_ridge_leaves_out_what_tells_nothing():
    random = np.random.default_rng(1)
    pairs = [(random.standard_normal((40, 30)), random.standard_normal((40, 1))) for _ in range(4)]
    noise = ridge([Moments.of(*pair) for pair in pairs])
    assert np.abs(noise(pairs[0][0]) - noise.offset).mean() < 0.6 * np.abs(pairs[0][1]).mean()
    truth = [(x, 2.0 * x[:, :1] + 1.0) for x, _ in pairs]
    np.testing.assert_allclose(
        ridge([Moments.of(*pair) for pair in truth])(pairs[0][0]), truth[0][1], atol=1e-2
    )


def test_outputs_come_to_the_frames_of_the_video():
    times_s = np.arange(600) / 60.0
    np.testing.assert_allclose(at_frames(times_s, times_s[:, None], 100)[1:, 0], np.arange(1, 100) / 25.0)


def test_of_two_cues_the_later_one_counts():
    cues = [{"start": 0.0, "end": 0.5, "value": "X"}, {"start": 0.4, "end": 1.0, "value": "A"}]
    times_s, values = shapes(cues, 1.0)
    assert values[times_s == 0.45, SHAPES.index("A")] == 1 and values[times_s == 0.45].sum() == 1


def test_closures_are_looked_for_from_half_of_the_phone_before():
    phones = [Phone(0.2, 0.2, "AA"), Phone(0.4, 0.08, "P"), Phone(0.48, 0.2, "IY"), Phone(1.0, 0.1, "M")]
    assert np.allclose(closure_windows(phones), [(0.3, 0.48), (0.88, 1.1)])
    gap = np.full(50, 5.0)
    gap[9], gap[25] = 0.3, 0.9
    assert smallest_gaps(gap, closure_windows(phones)) == [0.3, 0.9]
    assert smallest_gaps(gap, [(3.0, 3.1)]) == []


def test_each_feature_follows_its_landmarks():
    neutral = np.zeros((68, 3))
    neutral[48, 0], neutral[54, 0] = -0.025, 0.025
    motion = np.zeros((2, 68, 3))
    motion[1, 66, 1], motion[1, 54, 0] = -0.010, 0.001
    motion[1, 51, 2], motion[1, 57, 2] = 0.004, 0.002
    np.testing.assert_allclose(mouth_features(motion, neutral), [[0, 50, 0], [10, 51, 3]], atol=1e-9)


def test_the_recording_itself_is_faultless_on_the_page():
    recordings = [made_up(str(k), k) for k in range(3)]
    recordings[0].phones = [Phone(0.4, 0.08, "P")]
    recordings[0].truth[9:12, 0] = recordings[0].truth[:, 0].min()
    rest_mm = {r.name: float(r.truth[:, 0].min()) for r in recordings}
    scores = measure({r.name: r.truth for r in recordings}, rest_mm, recordings)
    assert scores["gap r"] == pytest.approx(1.0) and scores["closed"] == 100.0 and scores["MTM"] == 0.0
    text = page(
        [Source("a", "Made up", "New to all.", [([], recordings)], [Row("the recording", scores)])],
        {"Chromium": "none"},
    )
    assert "| the recording | 1.00 / 1.00 |" in text and "Not all could run, Chromium: none" in text
