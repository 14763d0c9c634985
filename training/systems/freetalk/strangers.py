"""Measures FreeTalk on speakers whom training left out whole, and writes docs/measured/strangers.md.

    python -m training.systems.freetalk.strangers --data ../shared/data --out runs/strangers

trains an ear and a denoiser without each of the five, and goes on where it was stopped. `--only s4 s26`
trains these alone and replaces their rows. `--starts DIR` has starting weights of denoisers, `s4.pt` etc.,
made by `training.speech.fold` as the card of `ats_compact` says: with them ear and denoiser are trained as
long as the shipped ones, otherwise shorter. Weights that have met a speaker must not start his model. Motion
is that of the default style, before contacts. It is compared with two rulers, fitted on the speakers who were
left in: the sound's loudness, and a ridge regression from log-mels around each frame.
"""

import json
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import numpy as np
import torch
from torch import Tensor

from training import DATA, REPOSITORY
from training.corpus import ear
from training.corpus.bank import Entry
from training.corpus.clip import MEL_PER_FRAME
from training.corpus.ear import EarClip
from training.flags import run_command
from training.losses import FEATURES
from training.speech import train_ear
from training.speech.ear import load_ear
from training.speech.log_mel import normalise
from training.speech.strangers import correlation, loudness, spoken_frames
from training.systems.freetalk import train
from training.systems.freetalk.stored import load_models, load_run
from training.systems.freetalk.train_stream import FullModel

PAGE = REPOSITORY / "docs/measured/strangers.md"
EAR_STEPS, ATS_STEPS = 700, 400
SHIPPED_EAR_STEPS, SHIPPED_ATS_STEPS, SHIPPED_RATE = 1600, 700, 5e-4
"""Of the shipped models, whose denoiser does not start from nothing."""
AROUND = (-6, -4, -2, -1, 0, 1, 2, 4, 6)
"""Frames around each frame whose log-mels the ruler reads."""
RIDGE = 10.0
RESAMPLES = 2000
MAX_CLIPS = 60
HEAD = """# Speakers whom training left out

How well FreeTalk follows a speaker whom neither the ear nor the denoiser has met: each row is a training of
its own, without this speaker. s4, s26 and s31 are speakers of GRID, tracked as those in the training, and
are left out of trainings as long as the shipped one, from weights that had met none of the three. grid_s1 is
nearly all of the English, facegood_zh all of the Mandarin; they are left out of shorter trainings, without
such a start. The motion is that of the default style, before contacts and eight bits.

`python -m training.systems.freetalk.strangers` trains, measures and writes this page. r is Pearson's by
clip, with its 95 % interval over clips in brackets, then r outside pauses, then the slope. Rulers: a ridge
regression from log-mels, fitted on the other speakers, and the loudness itself, which has no slope.
"""


@dataclass(frozen=True)
class Stranger:
    """A speaker: a whole source, or the clips of a source whose names begin with `begins`."""

    source: str
    begins: str = ""

    def has(self, clip: Entry) -> bool:
        """Whether the speaker says the clip."""
        return clip.source == self.source and clip.name.startswith(self.begins)

    def flags(self) -> list[str]:
        """Flags of both trainers that leave the speaker out."""
        return ["--leave-clips", self.begins] if self.begins else ["--leave-out", self.source]


STRANGERS = {
    "s4": Stranger("grid_five", "s4_"),
    "s26": Stranger("grid_five", "s26_"),
    "s31": Stranger("grid_five", "s31_"),
    "facegood_zh": Stranger("facegood_zh"),
    "grid_s1": Stranger("grid_s1"),
}


def train_without(stranger: Stranger, data: Path, cache: Path, out: Path, start: Path | None = None) -> Path:
    """Trains an ear and a denoiser without a speaker, as far as that is not done. Returns the ats.pt."""
    steps = (EAR_STEPS, ATS_STEPS) if start is None else (SHIPPED_EAR_STEPS, SHIPPED_ATS_STEPS)
    common = ["--data", data, "--cache", cache, *stranger.flags()]
    heard = [*common, "--out", out / "ear", "--steps", steps[0], "--log-every", steps[0]]
    if not (out / "ear/ear.pt").exists():
        train_ear.train(train_ear.parser().parse_args([str(word) for word in heard]))
    moved = [*common, "--out", out / "ats", "--speech", out / "ear/ear.pt"]
    moved += ["--steps", steps[1], "--log-every", steps[1], "--precision", "float32"]
    moved += ["--leave-speech", "nathalie_nl", "kathleen_en"]
    moved += [] if start is None else ["--init", start, "--rate", SHIPPED_RATE]
    if not (out / "ats/ats.pt").exists():
        train.train(train.parser().parse_args([str(word) for word in moved]))
    return out / "ats/ats.pt"


class Ruler:
    """A ridge regression from log-mels around each frame to one feature of the face."""

    def __init__(self, clips: list[EarClip], feature: str):
        rows = torch.cat([around(c) for c in clips])
        truth = torch.cat([FEATURES[feature](c.motion.float()) for c in clips])
        self.mean, self.of, self.deviation = rows.mean(0), truth.mean(), rows.std(0).clamp_min(1e-3)
        rows = (rows - self.mean) / self.deviation
        square = rows.T @ rows + RIDGE * len(AROUND) * torch.eye(rows.shape[1])
        self.weight = torch.linalg.solve(square, rows.T @ (truth - self.of))

    def __call__(self, clip: EarClip) -> Tensor:
        return (around(clip) - self.mean) / self.deviation @ self.weight + self.of


def around(clip: EarClip) -> Tensor:
    """Normalised log-mels at the frames around each frame of motion, [T, 9 · 64]."""
    mel = normalise(clip.mels[0].float()).unflatten(0, (-1, MEL_PER_FRAME)).mean(1)
    places = torch.arange(len(mel))[:, None] + torch.tensor(AROUND)
    return mel[places.clamp(0, len(mel) - 1)].flatten(1)


@dataclass
class Scores:
    """Scores of one feature by clip: Pearson's r, r outside pauses, and the parts of the pooled slope."""

    r: list[float] = field(default_factory=list)
    speech: list[float] = field(default_factory=list)
    products: list[float] = field(default_factory=list)
    squares: list[float] = field(default_factory=list)

    def add(self, predicted: Tensor, true: Tensor, level: Tensor) -> None:
        """Adds a clip: both curves and the loudness, [T]."""
        said = spoken_frames(level)
        self.r.append(float(correlation(predicted, true)))
        self.speech.append(float(correlation(predicted[said], true[said])))
        self.products.append(float((predicted - predicted.mean()) @ (true - true.mean())))
        self.squares.append(float((true - true.mean()).square().sum()))

    def summary(self) -> dict[str, float | list[float]]:
        """Means and slope, with the 95 % interval of r over clips."""
        rng = np.random.default_rng(0)
        means = rng.choice(self.r, (RESAMPLES, len(self.r))).mean(axis=1)
        return {
            "r": float(np.mean(self.r)),
            "interval": [float(x) for x in np.quantile(means, (0.025, 0.975))],
            "speech": float(np.mean(self.speech)),
            "slope": sum(self.products) / sum(self.squares),
        }


def full_model(run: Path) -> FullModel:
    """A finished run with the sampling of the shipped model."""
    denoiser = load_run(run)
    denoiser.config.sampling = load_models()[1].config.sampling
    return FullModel(denoiser)


@torch.no_grad()
def measure(stranger: Stranger, run: Path, body: Path, clips: list[EarClip]) -> dict:
    """Scores of the model and of the rulers on a speaker's clips, by name and feature."""
    heard = load_ear(body)
    model = full_model(run)
    chosen = [c for c in clips if stranger.has(c)]
    chosen = chosen[:: max(len(chosen) // MAX_CLIPS, 1)][:MAX_CLIPS]
    rest = [c for c in clips if not stranger.has(c) and not c.held_out]
    motions = [model(heard(c.heard[:1])[0]) for c in chosen]
    report: dict = {"clips": len(chosen), "frames": sum(len(c.motion) for c in chosen)}
    for name, of in FEATURES.items():
        ruler = Ruler(rest, name)
        by = {"model": Scores(), "log-mel": Scores(), "loudness": Scores()}
        for clip, motion in zip(chosen, motions, strict=True):
            true, level = of(clip.motion.float()), loudness(clip.mels[0])
            curves = {"model": of(motion), "log-mel": ruler(clip), "loudness": level}
            for label, curve in curves.items():
                by[label].add(curve, true, level)
        report[name] = {label: scores.summary() for label, scores in by.items()}
    return report


def page(reports: dict[str, dict]) -> str:
    """The page."""
    lines = [HEAD]
    for name in FEATURES:
        lines += [f"## {name.capitalize()}", "", "| left out | clips | FreeTalk | log-mel | loudness |"]
        lines += ["| --- | --- | --- | --- | --- |"]
        for stranger, report in reports.items():
            of = report[name]
            low, high = of["model"]["interval"]
            cells = [
                f"**{of['model']['r']:.2f}** ({low:.2f} to {high:.2f}); {of['model']['speech']:.2f}; "
                f"{of['model']['slope']:.2f}",
                f"{of['log-mel']['r']:.2f}; {of['log-mel']['speech']:.2f}; {of['log-mel']['slope']:.2f}",
                f"{of['loudness']['r']:.2f}; {of['loudness']['speech']:.2f}",
            ]
            lines.append(f"| {stranger} | {report['clips']} | " + " | ".join(cells) + " |")
        lines.append("")
    return "\n".join(lines)


def main(
    data: Path = DATA,
    cache: Path = Path("runs/cache"),
    out: Annotated[Path, "runs without each speaker"] = Path("runs/strangers"),
    only: Annotated[list[str], "train without these speakers, and replace their rows"] = (),
    starts: Annotated[Path | None, "folder of starting weights of denoisers"] = None,
    report: Annotated[Path, "the page to write, with a .json beside it"] = PAGE,
) -> None:
    """Command line."""
    names = only or list(STRANGERS)
    unknown = [name for name in names if name not in STRANGERS]
    if unknown:
        raise ValueError(f"--only: expected some of {', '.join(STRANGERS)}, got {', '.join(unknown)}")
    known = json.loads(report.with_suffix(".json").read_text()) if only else {}
    for name in names:
        start = None if starts is None or not (starts / f"{name}.pt").exists() else starts / f"{name}.pt"
        run, body = train_without(STRANGERS[name], data, cache, out / name, start), out / name / "ear/ear.pt"
        clips = ear.load(data, cache, ["grid_s1", "grid_five", "facegood_zh"], load_ear(body).config.taps)
        known[name] = measure(STRANGERS[name], run, body, clips)
    reports = {name: known[name] for name in STRANGERS if name in known}
    report.write_text(page(reports))
    report.with_suffix(".json").write_text(json.dumps(reports, indent=1) + "\n")
    print(report)


if __name__ == "__main__":
    run_command(main)
