"""Compares our motion with lip-sync tools from public packages and writes a page about it.

    python -m training.benchmarks.peers --anyface target/release/anyface --work runs/peers

The command fetches the tools from PyPI and npm into `--work` and runs them on the recordings there. It reuses
outputs that are already in the folder. Node with npm and Chromium (`apt install chromium`) must be installed.
"""

from dataclasses import dataclass, field
from math import nan
from pathlib import Path
from typing import Annotated

import numpy as np
import torch

from training import DATA
from training.benchmarks.peers.fit import best_fit
from training.benchmarks.peers.page import page
from training.benchmarks.peers.recordings import Recording, facegood, grid, mouth_features
from training.benchmarks.peers.table import Row, Source, best_lag, gap_correlation, measure
from training.benchmarks.peers.tools import TOOLS, hear, read_outputs
from training.corpus.clip import FPS, MEL_PER_FRAME, inner_gap
from training.corpus.ict import IctLandmarks
from training.engine import Engine
from training.flags import run_command

MM, MS = 1000.0, 1000.0
CONTEXT_FRAMES = (-4, -2, 0, 2, 4)
OTHERS = "Anyface's model was trained on other clips of this speaker."
BEGINNINGS = "Anyface's model was trained on what comes before in the same takes."
MOST = "Anyface's model was trained on the first 85 % of each of these takes."
WITHOUT_VARIETY = ("--effort", "0", "--breath", "0", "--variety", "0")


@dataclass
class Predictions:
    """Predictions by row and recording at 25 fps: `outputs` of tools [T, K], our `mouths` [T, 3] mm.

    `rest_mm` is the lip gap at rest of the face that our motion moves.
    """

    outputs: dict[str, dict[str, np.ndarray]] = field(default_factory=dict)
    mouths: dict[str, dict[str, np.ndarray]] = field(default_factory=dict)
    rest_mm: float = nan


def floors(recordings: list[Recording]) -> dict[str, dict[str, np.ndarray]]:
    """Inputs of the two floors by recording: loudness [T, 1], and log-mels of five frames [T, 320]."""
    loud = {r.name: r.level.double().numpy()[:, None] for r in recordings}
    return {"loudness": loud, "log-mel": {r.name: mel_context(r) for r in recordings}}


def mel_context(r: Recording) -> np.ndarray:
    """Mean log-mel of a frame and of the frames 80 and 160 ms before and after it, [T, 320]."""
    mel = r.mel.double().unflatten(0, (-1, MEL_PER_FRAME)).mean(dim=1).numpy()
    frames = np.arange(len(mel))
    return np.concatenate([mel[np.clip(frames + k, 0, len(mel) - 1)] for k in CONTEXT_FRAMES], axis=1)


def ours(binary: Path, data: Path, recordings: list[Recording]) -> tuple[dict, float]:
    """Anyface's mouths by row and recording, and the lip gap in mm of its face at rest."""
    neutral = IctLandmarks(data).neutral
    uses = {"Anyface": ("neutral", ()), "Anyface, without variety": ("off", WITHOUT_VARIETY)}
    mouths = {}
    for row, (emotion, options) in uses.items():
        engine = Engine(binary.resolve(), ["--system", "freetalk", *options])
        mouths[row] = {
            r.name: mouth_features(engine.motion(r.samples, emotion)[: len(r.truth)], neutral)
            for r in recordings
        }
    return mouths, float(inner_gap(np.zeros((1, 68, 3)), neutral)[0] * MM)


def rows(source: Source, predictions: Predictions) -> list[Row]:
    """The rows of a source: first the recording itself, then floors and tools, then Anyface."""
    judged = [r for _, chosen in source.turns for r in chosen]
    rest_mm = {r.name: r.rest_mm for r in judged}
    result_rows = [Row("the recording", measure({r.name: r.truth for r in judged}, rest_mm, judged))]
    needed = {r.name for learned, chosen in source.turns for r in [*learned, *chosen]}
    for name, outputs in predictions.outputs.items():
        if needed <= outputs.keys():
            fitted = best_fit(outputs, source.turns, lambda mouths: gap_correlation(mouths, judged))
            scores = measure(fitted.mouths, rest_mm, judged)
            result_rows.append(Row(name, scores, fitted.lag * MS / FPS, fitted.sigma * MS / FPS))
            print(source.title, name, {k: round(v, 3) for k, v in scores.items()}, flush=True)
    for name, mouths in predictions.mouths.items() if source.note else ():
        chosen = {r.name: mouths[r.name] for r in judged}
        scores = measure(chosen, dict.fromkeys(rest_mm, predictions.rest_mm), judged)
        result_rows.append(Row(name, scores | {"best lag": best_lag(chosen, judged)}))
    return result_rows


def sources(data: Path) -> tuple[list[Source], list[Recording], list[Recording]]:
    """The sources to measure, all recordings, and the recordings for which Anyface predicts motion."""
    learned, held_out = grid(data)
    takes, first = facegood(data)
    turns = [([other for other in takes if other is not take], [take]) for take in takes]
    ends = [(others, [take.cut(first[take.name])]) for others, (take,) in turns]
    source_list = [
        Source("grid_s1", "grid_s1: English, held-out clips", OTHERS, [(learned, held_out)]),
        Source("ends", "facegood_zh: Mandarin, the last 15 % of each take", BEGINNINGS, ends),
        Source("takes", "facegood_zh: Mandarin, whole takes", MOST, turns),
        Source("strange", "facegood_zh: whole takes, nothing fitted to the speaker", "", [(learned, takes)]),
    ]
    return source_list, [*learned, *held_out, *takes], [*held_out, *takes]


def main(
    data: Path = DATA,
    anyface: Annotated[Path, "the command"] = Path("target/release/anyface"),
    work: Annotated[Path, "folder for the tools and their outputs, 1 GB"] = Path("runs/peers"),
    out: Path = Path("docs/measured/peers.md"),
) -> None:
    """Command line."""
    torch.set_num_threads(1)
    work = work.resolve()
    measured, everything, spoken = sources(data)
    errors = hear(work, everything)
    predictions = Predictions(floors(everything))
    for tool in TOOLS:
        predictions.outputs[tool.row] = read_outputs(work, tool.key, everything)
    predictions.mouths, predictions.rest_mm = ours(anyface, data, spoken)
    for source in measured:
        source.rows = rows(source, predictions)
    out.parent.mkdir(parents=True, exist_ok=True)
    out.write_text(page(measured, errors), encoding="utf-8")
    print(out)


if __name__ == "__main__":
    run_command(main)
