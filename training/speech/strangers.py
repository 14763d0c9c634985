"""How well motion follows a voice: whole clips, within speech, and beyond what loudness tells."""

import torch
from torch import Tensor

from training.corpus.bank import Entry
from training.corpus.clip import MEL_PER_FRAME
from training.losses import FEATURES
from training.speech.compact import ACTIVE_QUANTILE, ACTIVE_RANGE

LEAST_FRAMES = 10


def loudness(entry: Entry) -> Tensor:
    """Mean log power of the sound around each frame of motion, [T] nepers."""
    level = entry.mels[0].float().mean(dim=1)
    return level.unflatten(0, (-1, MEL_PER_FRAME)).mean(dim=1)


def spoken_frames(entry: Entry) -> Tensor:
    """Frames within 4 nepers of the 95 % quantile of loudness, which are no pause: [T] bool."""
    level = loudness(entry)
    return level >= torch.quantile(level, ACTIVE_QUANTILE) - ACTIVE_RANGE


def without_line(x: Tensor, line: Tensor) -> Tensor:
    """What of `x` [T] no straight line through `line` [T] tells."""
    x, line = x - x.mean(), line - line.mean()
    return x - line * (x @ line) / line.square().sum().clamp_min(1e-9)


def correlation(a: Tensor, b: Tensor) -> Tensor:
    """Pearson's r of two series [T]."""
    return torch.corrcoef(torch.stack([a, b]))[0, 1]


def scores(pairs: list[tuple[Tensor, Entry]]) -> dict[str, float]:
    """For predicted motion [T, 204] of each clip and every feature, means over clips.

    `r` by clip; `slope` of predicted over true within clips; `speech` r over the frames that are no
    pause; `beyond` r after the line through loudness is taken out of both.
    """
    report = {}
    for name, of in FEATURES.items():
        rows, product, square = {"r": [], "speech": [], "beyond": []}, 0.0, 0.0
        for motion, entry in pairs:
            made, true, said = of(motion), of(entry.motion), spoken_frames(entry)
            line = loudness(entry)
            rows["r"].append(correlation(made, true))
            if said.sum() >= LEAST_FRAMES:
                rows["speech"].append(correlation(made[said], true[said]))
            rows["beyond"].append(correlation(without_line(made, line), without_line(true, line)))
            product += float((made - made.mean()) @ (true - true.mean()))
            square += float((true - true.mean()).square().sum())
        report |= {f"{name} {key}": float(torch.stack(values).nanmean()) for key, values in rows.items()}
        report[f"{name} slope"] = product / max(square, 1e-12)
    return report
