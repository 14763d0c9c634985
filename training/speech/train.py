"""Pretrains the compact speech encoder: log-mel → landmark motion and phones.

    python -m training.speech.train --data ../shared/data --out runs/speech

Each source of motion has its own linear read-out, so that two people do not average into one. Speech without
a face (many voices, eighteen languages) contributes its phones. With `--corpus DIR [DIR ...]` it trains only
on corpus folders, and on their phones if they have any. Only the encoder is kept. Seeded; resumes from
`--out/last.pt` with the same bits.
"""

import argparse
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from torch import nn

from training.corpus import bank, spoken
from training.corpus.closures import closures_met
from training.corpus.shares import entries_of, lasting, measured_scales, with_phones
from training.corpus.teacher import Teacher
from training.corpus.windows import AugmentOptions, Batch, WindowSampler
from training.losses import (
    feature_concordance,
    landmark_weights,
    lip_gap,
    motion_loss,
    source_scale,
)
from training.machine import Machine
from training.run import Run, begin, descend, seeded, trainer_parser
from training.speech.compact import CompactConfig, CompactEncoder, debug_config, load_encoder, normalise
from training.speech.strangers import scores
from training.speech.targets import PhoneHead

SHARES = {"grid_s1": 0.35, "facegood_zh": 0.2, "taught": 0.45}
CONCORDANCE = 0.3
ARTICULATION = 0.5
HEARD_EVERY = 2
JUDGED_CLIPS = 100


class SpeechToMotion(nn.Module):
    """The encoder and one linear read-out to 204 displacements (in units of the source)."""

    def __init__(self, config: CompactConfig, sources: list[str], dropout: float = 0.1):
        super().__init__()
        self.encoder = CompactEncoder(config)
        self.dropout = nn.Dropout(dropout)
        self.readouts = nn.ModuleList(nn.Linear(config.channels, 204) for _ in sources)
        self.phones = PhoneHead(config.channels)

    def forward(self, mel: torch.Tensor, source: torch.Tensor) -> torch.Tensor:
        """`mel` [B, 4 T, 64], `source` [B] → [B, T, 204] in units of the source's scale."""
        return self.read_out(self.dropout(self.encoder(mel)), source)

    def read_out(self, features: torch.Tensor, source: torch.Tensor) -> torch.Tensor:
        """`features` [B, T, C], `source` [B] → [B, T, 204]."""
        every = torch.stack([readout(features) for readout in self.readouts])
        return every[source, torch.arange(len(source))]


def loss_of(model: SpeechToMotion, batch: Batch, scale: torch.Tensor, weight: torch.Tensor, machine: Machine):
    """Loss of one batch: motion, concordance and articulation; `scale` [B, 1, 1] metres by source."""
    with machine.autocast():
        features = model.dropout(model.encoder(batch.mel))
        prediction = model.read_out(features, batch.source).float()
        said = model.phones.loss(features, batch.phones)
    truth = batch.motion / scale
    moved = motion_loss(prediction - truth, batch.weight * weight)
    has_motion = batch.weight.amax(dim=(1, 2)) > 0
    agreement, parts = feature_concordance(prediction[has_motion], truth[has_motion])
    parts |= {"motion": moved.item(), "said": said.item()}
    return moved + CONCORDANCE * agreement + ARTICULATION * said, parts


@torch.no_grad()
def motion_scores(model: SpeechToMotion, entries, source: int, scale_m: float) -> dict[str, float]:
    """`scores` of every feature for one read-out, whose unit is `scale_m` metres."""
    model.eval()
    pairs = []
    for entry in entries:
        mel = normalise(entry.mels[0].float())[None]
        pairs.append((model(mel, torch.tensor([source]))[0] * scale_m, entry))
    model.train()
    return scores(pairs)


@torch.no_grad()
def closure_scores(model: SpeechToMotion, entries, source: int) -> dict[str, float]:
    """Share of p, b and m at which the lips of a read-out meet, by the source of the speech."""
    model.eval()
    met: dict[str, list[bool]] = {}
    for entry in entries:
        mel = normalise(entry.mels[0].float())[None]
        gap = lip_gap(model(mel, torch.tensor([source]))[0])
        label = entry.name.split("/")[0]
        met.setdefault(label, []).extend(closures_met(gap - gap.quantile(0.02), entry.phones))
    model.train()
    return {f"{label} closed": float(np.mean(flags)) for label, flags in sorted(met.items())}


def validate(model, entries, heard: list[bank.Entry], sources: list[str], scales) -> dict[str, float]:
    """Scores of held-out clips of trained sources and of clips of left-out sources (with each read-out), and
    the share of closures met in `heard`."""
    judge = sources.index(spoken.SOURCE if spoken.SOURCE in sources else sources[0])
    report = {k: round(v, 3) for k, v in closure_scores(model, heard, judge).items()}
    for name in sorted({e.source for e in entries} - {spoken.SOURCE}):
        known = name in sources
        chosen = [e for e in entries if e.source == name and (e.held_out or not known)]
        for index, source in enumerate(sources):
            if not chosen or (known and source != name):
                continue
            scores = motion_scores(model, chosen[:JUDGED_CLIPS], index, scales[source])
            label = name if known else f"{name}<-{source}"
            report |= {f"{label} {key}": round(value, 3) for key, value in scores.items()}
    return report


@dataclass
class Speech:
    """Speech of a training run: its entries, and how often each source is drawn.

    Motion is judged on `judged` and closures on `heard`.
    """

    entries: list[bank.Entry]
    judged: list[bank.Entry]
    heard: list[bank.Entry]
    shares: dict[str, float]


def speech_of(arguments) -> Speech:
    """Loads corpus folders, or the project's own sources with speech that has no face."""
    debug = arguments.config == "debug"
    voices, limit = (2, 4) if debug else (arguments.voices, None)
    entries = entries_of(arguments, voices, limit)
    if arguments.corpus:
        return Speech(entries, entries, with_phones([e for e in entries if e.held_out]), lasting(entries))
    if not debug:
        left = tuple(arguments.leave_speech)
        teacher = Teacher.load() if arguments.teacher else None
        speech = (arguments.minutes, left, teacher, arguments.reader)
        entries += spoken.load(arguments.data, arguments.cache, *speech)
    sources = {e.source for e in entries} - {*arguments.leave_out}
    judged = entries + ([] if debug else spoken.unseen(arguments.data))
    heard = [e for e in judged if e.source == spoken.SOURCE and e.held_out][::HEARD_EVERY]
    return Speech(entries, judged, heard, {s: share for s, share in SHARES.items() if s in sources})


def train(arguments) -> Path:
    """Runs the training and returns the checkpoint's path."""
    seeded(arguments)
    machine = Machine("cpu", "bfloat16")
    config = debug_config() if arguments.config == "debug" else CompactConfig(channels=arguments.channels)
    speech = speech_of(arguments)
    sources, scales = list(speech.shares), measured_scales([*speech.shares], speech.entries)
    shares = list(speech.shares.values())
    sampler = WindowSampler(speech.entries, sources, shares, arguments.seed, AugmentOptions())
    model = SpeechToMotion(config, sources)
    if arguments.init is not None and arguments.init.is_dir():
        model.encoder.load_state_dict(load_encoder(arguments.init).state_dict())
    elif arguments.init is not None:
        model.load_state_dict(torch.load(arguments.init)["state"])
    run, weight = start(arguments, model, {"windows": sampler.random}, 0.995), landmark_weights()

    def loss(_step: int) -> tuple[torch.Tensor, dict[str, float]]:
        batch = sampler.batch(arguments.batch, arguments.frames)
        return loss_of(model, batch, source_scale(sources, batch.source, scales), weight, machine)

    def judge(averaged: SpeechToMotion) -> dict[str, float]:
        return validate(averaged, speech.judged, speech.heard, sources, scales)

    averaged = descend(arguments, run, loss, judge)
    final = {"state": averaged.state_dict(), "config": config.to_json(), "sources": sources}
    torch.save(final, arguments.out / "speech.pt")
    return arguments.out / "speech.pt"


def start(
    arguments, model: nn.Module, generators: dict, average: float, machine: Machine | None = None
) -> Run:
    """The run of an encoder or a student, resumed if it was interrupted. `debug` takes 20 steps."""
    steps = min(arguments.steps, 20) if arguments.config == "debug" else arguments.steps
    warm = max(steps // 20, 1) / steps
    return begin(
        arguments, model, generators, steps=steps, decay=0.02, warm=warm, average=average, machine=machine
    )


def parser() -> argparse.ArgumentParser:
    """Command line."""
    parser = trainer_parser(__doc__, "runs/speech", 1500, 2e-3)
    parser.add_argument("--config", choices=["compact", "debug"], default="compact")
    parser.add_argument("--leave-out", nargs="*", default=[], choices=[*SHARES], help="sources of motion")
    parser.add_argument("--leave-speech", nargs="*", default=[], help="speech to leave out (nathalie_nl, …)")
    parser.add_argument("--teacher", action=argparse.BooleanOptionalAction, default=True)
    parser.add_argument(
        "--reader", type=Path, help="an earlier speech.pt to read the phones of untimed speech"
    )
    parser.add_argument("--channels", type=int, default=192, help="width of the encoder")
    parser.add_argument("--minutes", type=float, default=5.0, help="minutes of each language by espeak-ng")
    parser.add_argument("--voices", type=int, default=7)
    parser.add_argument("--init", type=Path, help="start from this speech.pt, or encoder (a folder)")
    parser.add_argument("--batch", type=int, default=24)
    parser.add_argument("--frames", type=int, default=96)
    return parser


if __name__ == "__main__":
    train(parser().parse_args())
