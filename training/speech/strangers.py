"""Measures how well motion follows a voice: in whole clips, in speech, beyond loudness, and at closures.

    python -m training.speech.strangers --anyface target/release/anyface --speech ../shared/data/speech/kokoro

counts how often the lips meet at p, b and m, and how often they meet where none of these is said, for each
source in folders with `phones.jsonl`.
"""

from dataclasses import dataclass
from math import nan
from pathlib import Path
from typing import Annotated

import numpy as np
import torch
from torch import Tensor

from training.corpus.action_units import runs
from training.corpus.aligned import read_timed
from training.corpus.bank import Entry
from training.corpus.clip import MEL_PER_FRAME
from training.corpus.closures import inner_gaps
from training.corpus.phones import PAUSE, Phone, split
from training.engine import Engine
from training.flags import run_command
from training.losses import FEATURES
from training.speech.log_mel import ACTIVE_QUANTILE, ACTIVE_RANGE

LEAST_FRAMES = 10
ROUNDING = 1e-4
CLOSED_M = 0.5e-3
"""Lips count as closed up to this opening in metres, relative to the neutral face."""
AROUND_S, FAR_S, EDGE_S = 0.04, 0.12, 0.1
"""Distances in seconds. Lips meet a p, b or m if they are closed during it or up to the first distance away.

A closure is false only if no part of it is within the second distance of a phone of `NARROW`, or within the
third of a pause.
"""
NARROW = "pbmɸβʙ"
"""A closure near one of these phones is not false. Lips also come close in the last three."""


def loudness(mel: Tensor) -> Tensor:
    """Mean log power of the sound around each frame of motion, [4 T, 64] log-mel → [T] nepers."""
    return mel.float().mean(dim=1).unflatten(0, (-1, MEL_PER_FRAME)).mean(dim=1)


def spoken_frames(level: Tensor) -> Tensor:
    """Frames outside pauses: at most 4 nepers under the 95 % quantile of loudness, [T] → [T] bool."""
    return level >= torch.quantile(level, ACTIVE_QUANTILE) - ACTIVE_RANGE


def without_line(x: Tensor, line: Tensor) -> Tensor:
    """The residual of `x` [T] after linear regression on `line` [T]; 0 if only rounding error remains."""
    x, line = x - x.mean(), line - line.mean()
    rest = x - line * (x @ line) / line.square().sum().clamp_min(1e-9)
    return rest if rest.norm() > ROUNDING * x.norm() else torch.zeros_like(x)


def correlation(a: Tensor, b: Tensor) -> Tensor:
    """Pearson's r of two series [T]; 0 where either is constant."""
    return torch.corrcoef(torch.stack([a, b]))[0, 1].nan_to_num(0.0)


def feature_scores(clips: list[tuple[Tensor, Tensor, Tensor]]) -> dict[str, float]:
    """Scores of clips: the predicted and the true curve of a feature and the loudness, all [T].

    `r` is Pearson's r, averaged over clips; `speech` is r over the frames outside pauses; `beyond` is r
    after regression on loudness is removed from both curves. `slope` is that of predicted over true values
    within clips, pooled over clips.
    """
    rows, product, square = {"r": [], "speech": [], "beyond": []}, 0.0, 0.0
    for predicted, true, level in clips:
        said = spoken_frames(level)
        rows["r"].append(correlation(predicted, true))
        if said.sum() >= LEAST_FRAMES:
            rows["speech"].append(correlation(predicted[said], true[said]))
        rows["beyond"].append(correlation(without_line(predicted, level), without_line(true, level)))
        product += float((predicted - predicted.mean()) @ (true - true.mean()))
        square += float((true - true.mean()).square().sum())
    means = {key: float(torch.stack(values).mean()) if values else nan for key, values in rows.items()}
    return means | {"slope": product / max(square, 1e-12)}


def scores(pairs: list[tuple[Tensor, Entry]]) -> dict[str, float]:
    """`feature_scores` of every feature of predicted motion [T, 204]: `gap r`, `gap slope`, …"""
    report = {}
    for name, of in FEATURES.items():
        clips = [(of(motion), of(entry.motion), loudness(entry.mels[0])) for motion, entry in pairs]
        report |= {f"{name} {key}": value for key, value in feature_scores(clips).items()}
    return report


@dataclass
class ClosureCounts:
    """How many p, b and m are said, at how many of them the lips meet, how many closures are far from all of
    them, and the seconds of speech."""

    said: int = 0
    met: int = 0
    false: int = 0
    seconds: float = 0.0

    def __add__(self, other: "ClosureCounts") -> "ClosureCounts":
        return ClosureCounts(*(a + b for a, b in zip(vars(self).values(), vars(other).values(), strict=True)))

    def __str__(self) -> str:
        return (
            f"{self.met} of {self.said} p b m closed ({100 * self.met / max(self.said, 1):.1f} %), "
            f"{self.false} false closures in {self.seconds:.0f} s of speech "
            f"({self.false / max(self.seconds, 1e-9):.3f} a second)"
        )


def count_closures(motion: np.ndarray, fps: float, phones: list[Phone]) -> ClosureCounts:
    """Counts closures in displacements [T, 68, 3] m. The widest of the three inner lip pairs decides."""
    closed = inner_gaps(motion, np.zeros((68, 3))).max(axis=1) <= CLOSED_M
    times = np.arange(len(closed)) / fps
    parts = [part for phone in phones for part in split(phone)]
    bilabial = [(start, end) for start, end, segment in parts if segment in "pbm"]
    narrow = [(start, end) for start, end, segment in parts if segment in NARROW]
    speech = _within(times, [(a, b) for a, b, segment in parts if segment != PAUSE], 0.0)
    pauses = _within(times, [(a, b) for a, b, segment in parts if segment == PAUSE], EDGE_S)
    near = _within(times, narrow, FAR_S)
    met = sum(closed[_within(times, [span], AROUND_S)].any() for span in bilabial)
    spans = runs(torch.from_numpy(closed & speech).int())
    false = sum(not (near | pauses)[first:end].any() for first, end in spans)
    return ClosureCounts(len(bilabial), int(met), false, float((speech & ~pauses).sum()) / fps)


def _within(times: np.ndarray, spans: list[tuple[float, float]], around: float) -> np.ndarray:
    mask = np.zeros(len(times), bool)
    for start, end in spans:
        mask |= (times >= start - around) & (times <= end + around)
    return mask


def main(
    anyface: Annotated[Path, "the anyface command"],
    speech: Annotated[list[Path], "folders of sounds with phones.jsonl"],
    clips: Annotated[int, "most clips of each source, from the first on"] = 20,
    fps: int = 60,
    held_out: Annotated[bool, "only what no training hears"] = False,
    weights: Annotated[Path | None, "folder of models instead of the built-in ones"] = None,
) -> None:
    """Command line."""
    options = ["--threads", "1"] + (["--weights", str(weights)] if weights else [])
    engine, counts, numbers = Engine(anyface, options), {}, {}
    for utterance in (u for folder in speech for u in read_timed(folder)):
        source = utterance.source
        if numbers.get(source, 0) < clips and (utterance.held_out or not held_out):
            motion = engine.motion(utterance.samples, "neutral", fps)
            counted = count_closures(motion, fps, utterance.phones)
            counts[source] = counts.get(source, ClosureCounts()) + counted
            numbers[source] = numbers.get(source, 0) + 1
    for source, counted in sorted(counts.items()):
        print(f"{source}, {numbers[source]} clips: {counted}")


if __name__ == "__main__":
    run_command(main)
