"""Trains the causal twin of the ear. EmoFace's content branch reads it for live voices.

    python -m training.speech.train_causal --data ../shared/data --out runs/causal_speech

The student hears a stretch of speech under a running normalisation, with a fifth of a second of look-ahead,
in a room, in noise and in other voices. Its teacher, the ear, heard the whole of the clean sound. Seeded;
resumes from `--out/last.pt` with the same bits; `--config debug` takes a minute. `python -m training.export
stream --run runs/causal_speech/stream.pt` writes the model. `--measure` trains nothing: it prints the scores
of the model in `--finished` on held-out clips.
"""

import argparse
from pathlib import Path

import torch
import torch.nn.functional as F
from torch import Tensor

from training import shipped
from training.corpus import lessons
from training.corpus.clip import FPS
from training.corpus.lesson_windows import DIMS, LessonBatch, LessonSampler
from training.corpus.lessons import Lesson, silence, taught_by
from training.corpus.split import leave_clips
from training.machine import in_bfloat16
from training.nn.checkpoint import save
from training.run import begin_student, descend, seeded, trainer_parser
from training.speech.causal import (
    StreamConfig,
    StreamNet,
    debug_config,
    describe,
    load_stream,
    normalise_running,
    perform,
)
from training.systems.freetalk.train_stream import prior_of

HELD_OUT_CLIPS = 30


def prepare(arguments) -> tuple[list[Lesson], Tensor]:
    """The lessons of a run with the ear's features as what is taught, and the features of silence."""
    clips = lessons.load(arguments, 4 if arguments.config == "debug" else None)
    leave_clips(clips, arguments.leave_clips)
    return taught_by(clips, lambda heard: heard), silence(lambda heard: heard, arguments.ear)


def loss_of(model: StreamNet, batch: LessonBatch):
    """Distance of features in units of their deviation."""
    mel = normalise_running(batch.mel, model.config.normaliser, batch.heard)
    with in_bfloat16():
        predicted = model(mel).float()
    apart = F.smooth_l1_loss(predicted / model.std, batch.taught / model.std)
    return apart, {"features": apart.item()}


@torch.no_grad()
def validate(model: StreamNet, clips: list[Lesson], count: int) -> dict[str, float]:
    """Share of the features' variance explained on held-out clips, by source, from a cold start."""
    model.eval()
    report = {}
    for source in sorted({x.source for x in clips if x.held_out}):
        rest, spread = 0.0, 0.0
        for clip in [x for x in clips if x.held_out and x.source == source][:count]:
            taught = clip.motion[:, DIMS:].float()
            predicted = perform(model, clip.mels[0].float(), len(taught))
            rest += (predicted - taught).square().sum().item()
            spread += (taught - taught.mean(dim=0)).square().sum().item()
        report[f"{source} met"] = 1.0 - rest / spread
    model.train()
    return report


def new_model(arguments, clips: list[Lesson]) -> StreamNet:
    """A new student with the mean and deviation of the ear's features."""
    taught = torch.cat([x.motion[:, DIMS:].float() for x in clips if not x.held_out][::5])
    config = debug_config() if arguments.config == "debug" else StreamConfig(channels=arguments.channels)
    config.system, config.model, config.outputs = "emoface", "causal_speech", taught.shape[1]
    model = StreamNet(prior_of(config, clips))
    model.mean.copy_(taught.mean(dim=0))
    model.std.copy_(taught.std(dim=0).clamp_min(1e-3))
    return model


def shares_of(clips: list[Lesson]) -> dict[str, float]:
    """How often each source is drawn: in proportion to the square root of its seconds."""
    seconds: dict[str, float] = {}
    for clip in (x for x in clips if not x.held_out):
        seconds[clip.source] = seconds.get(clip.source, 0.0) + len(clip.motion) / FPS
    return {source: s**0.5 for source, s in seconds.items()}


def train(arguments) -> Path:
    """Runs the training; writes `stream.pt` with the averaged weights and returns its path."""
    seeded(arguments)
    debug = arguments.config == "debug"
    clips, at_rest = prepare(arguments)
    arguments.out.mkdir(parents=True, exist_ok=True)
    model = new_model(arguments, clips)
    sampler = LessonSampler(clips, shares_of(clips), arguments.seed, model.config, at_rest)
    run = begin_student(arguments, model, {"windows": sampler.random}, 0.99)
    count, frames = (4, 32) if debug else (arguments.batch, arguments.frames)

    def judge(averaged: StreamNet) -> dict[str, float]:
        save(run.out / "stream.pt", averaged)
        return validate(averaged, clips, 4 if debug else HELD_OUT_CLIPS)

    descend(arguments, run, lambda _: loss_of(model, sampler.batch(count, frames)), judge)
    return run.out / "stream.pt"


def measure(arguments) -> None:
    """Prints size, look-ahead and scores of the finished student in `arguments.finished`."""
    seeded(arguments)
    arguments.voices = 1
    model = load_stream(arguments.finished)
    print(describe(model))
    for name, share in validate(model, prepare(arguments)[0], HELD_OUT_CLIPS).items():
        print(f"{name} {share:.2f}")


def parser(doc: str = __doc__, out: str = "runs/causal_speech") -> argparse.ArgumentParser:
    """Command line."""
    parser = trainer_parser(doc, out, 2500, 2e-3)
    lessons.add_arguments(parser, 4)
    parser.add_argument("--config", choices=["stream", "debug"], default="stream")
    parser.add_argument("--channels", type=int, default=144)
    parser.add_argument("--batch", type=int, default=16)
    parser.add_argument("--frames", type=int, default=112)
    return parser


def main(line: list[str] | None = None) -> None:
    """Entry of the command."""
    commands = parser()
    commands.add_argument("--finished", type=Path, default=shipped("causal_speech"))
    commands.add_argument("--measure", action="store_true", help="measure --finished instead of training")
    request = commands.parse_args(line)
    (measure if request.measure else train)(request)


if __name__ == "__main__":
    main()
