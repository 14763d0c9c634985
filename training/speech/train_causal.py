"""Trains the causal twin of the compact speech encoder. EmoFace's content branch reads it for live voices.

    python -m training.speech.train_causal --data ../shared/data --out runs/causal_speech

The student hears a stretch of speech under a running normalisation, with a fifth of a second of look-ahead.
Its teacher, the frozen encoder, hears the whole stretch at once. Windows are drawn as in
`training.systems.freetalk.train_stream`, with the same rooms, noises and levels. Seeded; resumes from
`--out/last.pt` with the same bits; `--config debug` takes a minute. `python -m training.export stream --run
runs/causal_speech/stream.pt` writes the model. `--measure` trains nothing: it prints the scores of the model
in `--finished` on held-out clips.
"""

import argparse
from pathlib import Path

import torch
import torch.nn.functional as F
from torch import Tensor

from training import shipped
from training.corpus.bank import Entry, entry_without_motion
from training.corpus.clip import FPS, MEL_PER_FRAME, fit_frames
from training.corpus.emodb import SOURCE as EMODB
from training.corpus.emodb import read_acted
from training.corpus.lesson_windows import DIMS, LessonBatch, LessonSampler
from training.corpus.lessons import Lesson, speech_entries
from training.corpus.shares import entries_of
from training.nn.checkpoint import save
from training.run import descend, seeded, trainer_parser
from training.speech.causal import (
    StreamConfig,
    StreamNet,
    debug_config,
    describe,
    load_stream,
    normalise_running,
    pad_mel,
    perform,
)
from training.speech.compact import SHIPPED_ENCODER, CompactEncoder, load_encoder, normalise
from training.speech.log_mel import SAMPLE_RATE_HZ, log_mel
from training.speech.train import start
from training.systems.freetalk.train_stream import prior_of

SPEECH = ("picovoice_en", "kerstin_de", "kathleen_en", "nathalie_nl")
EDGE = 12
"""Number of frames that the loss skips at the start of a window, where the whole encoder lacks context."""
CLOSURE = 0.1
HELD_OUT_CLIPS = 30


def as_lesson(entry: Entry) -> Lesson:
    """A lesson without motion. The encoder computes the targets of each window when it is drawn."""
    still = torch.zeros(len(entry.motion), DIMS)
    return Lesson(**(vars(entry) | {"motion": still, "weight": still}), taught=still.half())


def acted_entries(data: Path, limit: int | None) -> list[Entry]:
    """emodb_de: shouted, whispered and sobbed speech, two actors held out."""
    entries = []
    for clip in read_acted(data, limit):
        frames = max(int(len(clip.samples) * FPS / SAMPLE_RATE_HZ), 2)
        mel = fit_frames(log_mel(torch.from_numpy(clip.samples)), MEL_PER_FRAME * frames)
        entries.append(entry_without_motion(clip.name, EMODB, clip.held_out, mel[None]))
    return entries


def prepare(arguments) -> list[Lesson]:
    """Loads all speech to train on."""
    debug = arguments.config == "debug"
    limit, voices = (4, 2) if debug else (None, arguments.voices)
    entries = entries_of(arguments, voices, limit)
    if not arguments.corpus:
        entries += acted_entries(arguments.data, limit)
        for name in SPEECH:
            sounds = 4 if debug else arguments.speech_limit
            entries += speech_entries(arguments.data / "speech" / name, sounds, min(voices, 2))
    return [as_lesson(entry) for entry in entries]


@torch.no_grad()
def whole(encoder: CompactEncoder, mel: Tensor, frames: int) -> Tensor:
    """The encoder's features [B, frames, C] when it hears all of the raw log-mel [B, R, 64] at once."""
    heard = torch.stack([normalise(row) for row in mel])
    return encoder(heard)[:, :frames]


def loss_of(model: StreamNet, encoder: CompactEncoder, batch: LessonBatch, frames: int):
    """Distance of features in units of their deviation, plus that of their probabilities of closed lips."""
    taught = whole(encoder, batch.mel, frames)
    mel = normalise_running(batch.mel, model.config.normaliser, batch.heard)
    with torch.autocast("cpu", torch.bfloat16):
        predicted = model(mel).float()
    inner = slice(EDGE, frames)
    apart = F.smooth_l1_loss(predicted[:, inner] / model.std, taught[:, inner] / model.std)
    closed = F.binary_cross_entropy(
        encoder.closed(predicted[:, inner]).clamp(1e-4, 1 - 1e-4), encoder.closed(taught[:, inner])
    )
    return apart + CLOSURE * closed, {"features": apart.item(), "closed": closed.item()}


@torch.no_grad()
def validate(
    model: StreamNet, encoder: CompactEncoder, lessons: list[Lesson], count: int
) -> dict[str, float]:
    """Share of the features' variance explained on held-out clips, by source, from a cold start."""
    model.eval()
    report = {}
    for source in sorted({x.source for x in lessons if x.held_out}):
        rest, spread = 0.0, 0.0
        for clip in [x for x in lessons if x.held_out and x.source == source][:count]:
            mel, frames = clip.mels[0].float(), len(clip.motion)
            taught = whole(encoder, pad_mel(mel, MEL_PER_FRAME * frames)[None], frames)[0]
            predicted = perform(model, mel, frames)
            rest += (predicted - taught).square().sum().item()
            spread += (taught - taught.mean(dim=0)).square().sum().item()
        report[f"{source} met"] = 1.0 - rest / spread
    model.train()
    return report


def new_model(arguments, encoder: CompactEncoder, lessons: list[Lesson]) -> StreamNet:
    """A new student with the mean and deviation of the encoder's features."""
    config = debug_config() if arguments.config == "debug" else StreamConfig(channels=arguments.channels)
    config.system, config.model = "emoface", "causal_speech"
    config.outputs = encoder.config.channels
    prior_of(config, lessons)
    model = StreamNet(config)
    clips = [x.mels[0].float() for x in lessons if not x.held_out][::5]
    heard = torch.cat([whole(encoder, mel[None], len(mel) // MEL_PER_FRAME)[0] for mel in clips])
    model.mean.copy_(heard.mean(dim=0))
    model.std.copy_(heard.std(dim=0).clamp_min(1e-3))
    return model


def shares_of(lessons: list[Lesson]) -> dict[str, float]:
    """How often each source is drawn: in proportion to the square root of its seconds."""
    seconds: dict[str, float] = {}
    for lesson in lessons:
        seconds[lesson.source] = seconds.get(lesson.source, 0.0) + len(lesson.motion) / FPS
    return {source: s**0.5 for source, s in seconds.items()}


def train(arguments) -> Path:
    """Runs the training; writes `stream.pt` with the averaged weights and returns its path."""
    seeded(arguments)
    debug = arguments.config == "debug"
    encoder = load_encoder(SHIPPED_ENCODER).eval().requires_grad_(False)
    lessons = prepare(arguments)
    arguments.out.mkdir(parents=True, exist_ok=True)
    model = new_model(arguments, encoder, lessons)
    sampler = LessonSampler(lessons, shares_of(lessons), arguments.seed, model.config)
    run = start(arguments, model, {"windows": sampler.random}, 0.99)
    count, frames = (4, 32) if debug else (arguments.batch, arguments.frames)

    def judge(averaged: StreamNet) -> dict[str, float]:
        save(run.out / "stream.pt", averaged)
        return validate(averaged, encoder, lessons, 4 if debug else HELD_OUT_CLIPS)

    descend(arguments, run, lambda _: loss_of(model, encoder, sampler.batch(count, frames), frames), judge)
    return run.out / "stream.pt"


def measure(arguments) -> None:
    """Prints size, look-ahead and scores of the finished student in `arguments.finished`."""
    seeded(arguments)
    arguments.voices = 1
    model = load_stream(arguments.finished)
    print(describe(model))
    encoder = load_encoder(SHIPPED_ENCODER).eval()
    for name, share in validate(model, encoder, prepare(arguments), HELD_OUT_CLIPS).items():
        print(f"{name} {share:.2f}")


def parser(doc: str = __doc__, out: str = "runs/causal_speech") -> argparse.ArgumentParser:
    """Command line."""
    parser = trainer_parser(doc, out, 2500, 2e-3)
    parser.add_argument("--speech-limit", type=int, default=150, help="sounds of each folder")
    parser.add_argument("--config", choices=["stream", "debug"], default="stream")
    parser.add_argument("--channels", type=int, default=144)
    parser.add_argument("--voices", type=int, default=4)
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
