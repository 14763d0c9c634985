"""Measures performers on speakers whom training left out, and writes docs/measured/performers.md.

    python -m training.systems.freetalk.performers --data ../shared/data --runs runs/strangers

`--runs` holds the trainings of `training.systems.freetalk.strangers`. From 6 or 15 s of a speaker's face a
performer is learned as the library does it (`rust-core/src/motion/performer`): a ridge regression from the
ear's features to what the speaker's mouth does beyond the model's own speaker, its strength chosen on parts
left out, and aimed so far beyond the speaker that parts left out move as far. It is measured on the
speaker's other clips, before contacts.
"""

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from training import DATA, REPOSITORY
from training.corpus import ear
from training.corpus.clip import FPS
from training.flags import run_command
from training.losses import FEATURES, JAW, LIPS
from training.speech.ear import load_ear
from training.speech.strangers import correlation
from training.systems.freetalk.strangers import STRANGERS, full_model

PAGE = REPOSITORY / "docs/measured/performers.md"
SPEAKERS = ("s4", "s26", "s31")
SECONDS = (0, 6, 15)
RIDGES = (1.0, 3.0, 10.0, 30.0, 100.0, 300.0)
"""Per second of sound."""
FOLDS, PART_S = 5, 2.0
DIRECTIONS, FURTHEST, LEAST_R, ROUNDS = 8, 2.0, 0.3, 2
"""Of the aim, as `rust-core/src/motion/performer/aim.rs` has them."""
DRAWS = 20
"""How often the clips to learn from are drawn anew."""
SPOKEN = sorted({*range(17), *JAW, *LIPS})
"""The landmarks of jaw and mouth."""
HEAD = """# Performers: a speaker's own mouth

What `anyface performer learn` gains on speakers whom neither the ear nor the denoiser has met. Each row
learns from clips of 3 s that are drawn at random, and is measured on the speaker's other clips: r by clip
and slope, means over 20 draws, before contacts. *Better* is the share of all clips and draws in which r of
the gap is higher than without.

`python -m training.systems.freetalk.performers` measures and writes this page, from the trainings of
[strangers.md](strangers.md).

| left out | seconds of the face | gap | width | chin | protrusion | better |
| --- | --- | --- | --- | --- | --- | --- |
"""


@dataclass(frozen=True)
class Said:
    """A clip: features [T, C], motion of the model's speaker [T, 204] and of the person [T, 204]."""

    features: Tensor
    model: Tensor
    person: Tensor


@torch.no_grad()
def say(name: str, data: Path, cache: Path, runs: Path) -> list[Said]:
    """The clips of a speaker, by the models that have not met the speaker."""
    heard, model = load_ear(runs / name / "ear/ear.pt"), full_model(runs / name / "ats/ats.pt")
    clips = ear.load(data, cache, [STRANGERS[name].source], heard.config.taps)
    said = []
    for clip in (clip for clip in clips if STRANGERS[name].has(clip)):
        features = heard(clip.heard[:1])[0]
        said.append(Said(features, model(features), clip.motion.float()))
    return said


def columns() -> list[int]:
    """The columns of the landmarks of jaw and mouth."""
    return [3 * landmark + axis for landmark in SPOKEN for axis in range(3)]


def fit(features: Tensor, values: Tensor, ridge: float) -> tuple[Tensor, Tensor, Tensor]:
    """Mean [C], weights [C, N] and offset [N] of a ridge regression."""
    mean, offset = features.mean(0), values.mean(0)
    x = (features - mean).double()
    square = x.T @ x + ridge * torch.eye(x.shape[1], dtype=x.dtype)
    weights = torch.linalg.solve(square, x.T @ (values - offset).double()).float()
    return mean, weights, offset


def learn(clips: list[Said]) -> tuple[Tensor, Tensor, Tensor]:
    """A performer: the read-out whose strength does best on parts left out."""
    features = torch.cat([clip.features for clip in clips])
    differences = [(clip.person - clip.model)[:, columns()] for clip in clips]
    values = torch.cat([x - x.mean(0) for x in differences])
    part = torch.cat([torch.arange(len(x)) // int(PART_S * FPS) + 10 * i for i, x in enumerate(differences)])
    fold = torch.unique(part, return_inverse=True)[1] % FOLDS

    def predicted(aim: Tensor, ridge: float) -> Tensor:
        guess = torch.zeros_like(aim)
        for out in fold.unique():
            inside = fold != out
            seconds = float(inside.sum()) / FPS
            mean, weights, offset = fit(features[inside], aim[inside], ridge * seconds)
            guess[~inside] = (features[~inside] - mean) @ weights + offset
        return guess

    best = min(RIDGES, key=lambda ridge: float((values - predicted(values, ridge)).square().sum()))
    aim = values + beyond(clips, lambda added: predicted(values + added, best))
    return fit(features, aim, best * len(values) / FPS)


def beyond(clips: list[Said], predicted: Callable[[Tensor], Tensor]) -> Tensor:
    """What of the speaker's motion is to be added to the aim [T, N]: see `aim.rs`."""
    lengths = [len(clip.person) for clip in clips]

    def centred(rows: Tensor) -> Tensor:
        return torch.cat([part - part.mean(0) for part in rows.split(lengths)])

    person = centred(torch.cat([clip.person[:, columns()] for clip in clips]))
    model = torch.cat([clip.model[:, columns()] for clip in clips])
    directions = torch.linalg.eigh((person.T @ person).double())[1].flip(1)[:, :DIRECTIONS].float()
    along = person @ directions
    aims, added = torch.ones(along.shape[1]), torch.zeros_like(person)
    for _ in range(ROUNDS):
        left_out = centred(model + predicted(added)) @ directions
        own, other = along.square().sum(0).sqrt(), left_out.square().sum(0).sqrt().clamp(min=1e-12)
        r = (along * left_out).sum(0) / (own * other).clamp(min=1e-12)
        aims = torch.where(r > LEAST_R, (aims * own / other).clamp(1.0, FURTHEST), torch.ones(1))
        added = (along * (aims - 1)) @ directions.T
    return added


def apply(performer: tuple[Tensor, Tensor, Tensor], clip: Said) -> Tensor:
    """Motion [T, 204] of the performer on a clip."""
    mean, weights, offset = performer
    moved = clip.model.clone()
    moved[:, columns()] += (clip.features - mean) @ weights + offset
    return moved


@dataclass
class Scores:
    """r of each clip, and the parts of the pooled slope."""

    r: list[float]
    products: float = 0.0
    squares: float = 0.0

    def add(self, guess: Tensor, true: Tensor) -> float:
        """Adds a clip's curve; returns its r."""
        self.r.append(float(correlation(guess, true)))
        self.products += float((guess - guess.mean()) @ (true - true.mean()))
        self.squares += float((true - true.mean()).square().sum())
        return self.r[-1]


def measure(clips: list[Said], seconds: int) -> dict:
    """Scores of performers learned from `seconds` of a speaker's clips, on the others."""
    scores, better = {name: Scores([]) for name in FEATURES}, []
    for draw in range(DRAWS if seconds else 1):
        order = np.random.default_rng(draw).permutation(len(clips))
        lengths = np.cumsum([len(clips[i].model) / FPS for i in order])
        count = int(np.searchsorted(lengths, seconds)) + 1 if seconds else 0
        performer = learn([clips[i] for i in order[:count]]) if count else None
        for clip in (clips[i] for i in order[count:]):
            moved = clip.model if performer is None else apply(performer, clip)
            for name, of in FEATURES.items():
                r = scores[name].add(of(moved), of(clip.person))
                if name == "gap":
                    better.append(r > float(correlation(of(clip.model), of(clip.person))))
    numbers = {n: {"r": float(np.mean(s.r)), "slope": s.products / s.squares} for n, s in scores.items()}
    return numbers | {"better": float(np.mean(better))}


def main(
    data: Path = DATA,
    cache: Path = Path("runs/cache"),
    runs: Path = Path("runs/strangers"),
    report: Path = PAGE,
) -> None:
    """Command line."""
    lines, reports = [], {}
    for name in SPEAKERS:
        clips = say(name, data, cache, runs)
        for seconds in SECONDS:
            numbers = reports[f"{name} {seconds}"] = measure(clips, seconds)
            cells = [f"**{numbers[n]['r']:.2f}** / {numbers[n]['slope']:.2f}" for n in FEATURES]
            better = f"{100 * numbers['better']:.0f} %" if seconds else ""
            lines.append(f"| {name} | {seconds} | {' | '.join(cells)} | {better} |")
    report.write_text(HEAD + "\n".join(lines) + "\n")
    report.with_suffix(".json").write_text(json.dumps(reports, indent=1) + "\n")
    print(report)


if __name__ == "__main__":
    run_command(main)
