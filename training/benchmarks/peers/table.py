"""Scores of a predictor of the mouth on one source: the rows of the page."""

from dataclasses import dataclass, field
from math import nan

import numpy as np
import torch

from training.benchmarks.peers.fit import LAGS, shifted
from training.benchmarks.peers.recordings import (
    FEATURES,
    SAMPLES_PER_FRAME,
    Recording,
    closure_windows,
    smallest_gaps,
)
from training.corpus.clip import FPS
from training.paper.metrics import (
    extrema,
    lip_intensity,
    smooth_opening,
    speech_lip_correlation,
    temporal_misalignment,
)
from training.speech.strangers import correlation, feature_scores

CLOSED_MM = 0.5
STRETCH_FRAMES = 75
PER_CENT, MS = 100.0, 1000.0


@dataclass
class Row:
    """A predictor's scores by name. `lag_ms` is the delay that was removed, `sigma_ms` the smoothing that was
    added."""

    name: str
    scores: dict[str, float]
    lag_ms: float = nan
    sigma_ms: float = nan


@dataclass
class Source:
    """Recordings that are judged. `turns` are pairs: recordings to fit a map to, and those to judge with it.

    `note` says which part of them the shipped model was trained on. If it is empty, that model gets no row.
    """

    key: str
    title: str
    note: str
    turns: list[tuple[list[Recording], list[Recording]]]
    rows: list[Row] = field(default_factory=list)


def gap_correlation(mouths: dict[str, np.ndarray], judged: list[Recording]) -> float:
    """Correlation r of the gap (the first column of the mouths [T, 3]), as the mean over recordings."""
    predicted = [torch.from_numpy(mouths[r.name][r.judged, 0]) for r in judged]
    true = [torch.from_numpy(r.truth[r.judged, 0].astype(np.float64)) for r in judged]
    return float(torch.stack([correlation(a, b) for a, b in zip(predicted, true, strict=True)]).mean())


def best_lag(mouths: dict[str, np.ndarray], judged: list[Recording]) -> float:
    """The delay at which the gap's r is highest: a whole number of frames, in ms."""
    correlations = {
        lag: gap_correlation({n: shifted(m, lag) for n, m in mouths.items()}, judged) for lag in LAGS
    }
    return max(correlations, key=correlations.get) * MS / FPS


def measure(
    mouths: dict[str, np.ndarray], rest_mm: dict[str, float], judged: list[Recording]
) -> dict[str, float]:
    """Scores of mouths [T, 3] mm by recording. `rest_mm` is the gap at rest of the face that they move."""
    scores = {}
    for k, feature in enumerate(FEATURES):
        clips = [
            (*(torch.from_numpy(x[r.judged, k].astype(np.float64)) for x in (mouths[r.name], r.truth)),
             r.level[r.judged].double())
            for r in judged
        ]  # fmt: skip
        scores |= {f"{feature} {key}": value for key, value in feature_scores(clips).items()}
    return scores | closures(mouths, rest_mm, judged) | timing(mouths, judged) | intensity(mouths, judged)


def closures(mouths, rest_mm, judged: list[Recording]) -> dict[str, float]:
    """Per cent of p, b and m in which the gap is at most half a millimetre wider than at rest."""
    met = []
    for r in judged:
        late_s = r.judged.start / FPS
        windows = [(a - late_s, b - late_s) for a, b in closure_windows(r.phones)]
        least = smallest_gaps(mouths[r.name][r.judged, 0], windows)
        met += [gap - rest_mm[r.name] <= CLOSED_MM for gap in least]
    return {"closed": PER_CENT * float(np.mean(met)) if met else nan, "p b m": len(met)}


def timing(mouths, judged: list[Recording]) -> dict[str, float]:
    """MTM in ms (mean over recordings of each one's mean), and per cent of true extrema with a partner."""
    means, joined, all_extrema = [], 0, 0
    for r in judged:
        off = temporal_misalignment(mouths[r.name][r.judged, 0], r.truth[r.judged, 0])
        means += [off.mean()] if len(off) else []
        joined += len(off)
        all_extrema += len(extrema(smooth_opening(r.truth[r.judged, 0])))
    mean = float(np.mean(means)) * MS / FPS if means else nan
    return {"MTM": mean, "joined": PER_CENT * joined / max(all_extrema, 1)}


def intensity(mouths, judged: list[Recording]) -> dict[str, float]:
    """SLCC over stretches of 3 s. Gap, width and protrusion count as one point with three coordinates."""
    lips, speech = [], []
    for r in judged:
        for first in range(r.judged.start, r.judged.stop - STRETCH_FRAMES + 1, STRETCH_FRAMES):
            end = first + STRETCH_FRAMES
            lips.append(lip_intensity(mouths[r.name][first:end, None]))
            sound = r.samples[first * SAMPLES_PER_FRAME : end * SAMPLES_PER_FRAME]
            speech.append(np.sqrt(np.square(sound).mean()))
    return {"SLCC": speech_lip_correlation(np.array(lips), np.array(speech)), "stretches": len(lips)}
