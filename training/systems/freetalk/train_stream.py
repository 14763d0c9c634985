"""Trains the streaming student on the full model's motion and on captured motion.

    python -m training.systems.freetalk.train_stream --data ../shared/data --out runs/stream

The teacher is the encoder and denoiser in `--models`, or with `--ats` those of a finished run. It predicts
the motion of every clip once; the results are stored under `--out`. `--speech DIR ...` adds folders of speech
without motion, so that the student hears more voices than were captured; it learns only the teacher's motion
there. `--minutes` adds recorded and synthetic speech of many languages (`training/corpus/spoken.py`).
`--corpus DIR [DIR ...]` trains on corpus folders instead of the project's own sources. `--measure` trains
nothing: it prints r and slope of the model in `--finished` on held-out clips. Seeded; resumes from
`--out/last.pt` bit for bit; `--device` and `--precision` set where and how it computes
(`training/machine.py`); `--config debug` takes a minute.
"""

import argparse
from collections.abc import Collection
from pathlib import Path

import torch

from training import WEIGHTS
from training.corpus import lessons, spoken
from training.corpus.lesson_windows import DIMS, LessonBatch, LessonSampler
from training.corpus.lessons import FullModel, Lesson
from training.corpus.shares import entries_of, lasting, measured_scales
from training.losses import FEATURES, feature_concordance, feature_scores, landmark_weights, motion_loss
from training.machine import Machine, add_arguments
from training.nn.checkpoint import save
from training.run import descend, seeded, trainer_parser
from training.speech.causal import (
    StreamConfig,
    StreamNet,
    debug_config,
    describe,
    load_stream,
    normalise_running,
    perform,
    with_sooner,
)
from training.speech.compact import ACTIVE_QUANTILE, clip_colour
from training.speech.train import start
from training.systems.freetalk.stored import load_models, load_run

SHARES = {"grid_s1": 0.65, "facegood_zh": 0.35}
CONCORDANCE = 0.2
CAPTURED_SHARE, SPEECH_SHARE = 0.5, 0.4
HELD_OUT_CLIPS = 60


def load_teacher(arguments) -> FullModel:
    """The full model of `--ats`, or of `--models`."""
    models = load_models(arguments.models) if arguments.ats is None else load_run(arguments.ats)
    return FullModel(*models)


def prior_of(config: StreamConfig, clips: list[Lesson]) -> StreamConfig:
    """The configuration with the mean colour and peak of the training voices as the prior."""
    mels = [x.mels[0].float() for x in clips if not x.held_out]
    colour = torch.stack([clip_colour(mel) for mel in mels]).mean(dim=0)
    peaks = [torch.quantile(mel.mean(dim=1), ACTIVE_QUANTILE) for mel in mels]
    config.normaliser.prior_colour = [round(x, 3) for x in colour.tolist()]
    config.normaliser.prior_peak = round(float(torch.stack(peaks).mean()), 3)
    return config


def captured_shares(arguments, clips: list[Lesson]) -> dict[str, float]:
    """How often each source with captured motion is drawn, relative to the other such sources."""
    if not arguments.corpus:
        return SHARES
    return lasting([x for x in clips if bool((x.weight > 0).any())])


def shares_of(clips: list[Lesson], speech_share: float, among: dict[str, float]) -> dict[str, float]:
    """How often each source is drawn: speech without motion, if any, gets `speech_share`."""
    others = sorted({x.source for x in clips} - {*among})
    captured = 1.0 - speech_share if others else 1.0
    shares = {source: captured * share for source, share in among.items()}
    seconds = {source: sum(len(x.motion) for x in clips if x.source == source) for source in others}
    total = sum(seconds.values())
    return shares | {source: speech_share * s / total for source, s in seconds.items()}


def loss_of(model: StreamNet, batch: LessonBatch, weight: torch.Tensor, machine: Machine):
    """Motion loss against the captured and the teacher's motion, plus the concordance of visible features."""
    mel = normalise_running(batch.mel, model.config.normaliser, batch.heard)
    of_batch = (batch.weight * weight, batch.captured, batch.taught, batch.scale)
    mask, true, taught, scale = (x.to(machine.device) for x in of_batch)
    mel = mel.to(machine.device)
    if not model.sooner:
        with machine.autocast():
            prediction = model(mel).float()
        return _loss(prediction, (mask, true, taught, scale), weight)
    with machine.autocast(), torch.no_grad():
        heard = model.hear(mel)
    total, report = 0.0, {}
    for number, sooner in enumerate(model.config.sooner):
        with machine.autocast():
            prediction = model.say(heard, number).float()[:, :-sooner]
        later = (mask[:, sooner:], true[:, sooner:], taught[:, sooner:], scale)
        loss, parts = _loss(prediction, later, weight)
        total = total + loss
        report |= {f"{sooner} sooner {key}": value for key, value in parts.items()}
    return total, report


def _loss(prediction: torch.Tensor, targets: tuple[torch.Tensor, ...], weight: torch.Tensor):
    mask, true, taught, scale = targets
    everywhere = weight.to(taught.device).expand_as(taught)
    by_capture = motion_loss((prediction - true) / scale, mask)
    by_teacher = motion_loss((prediction - taught) / scale, everywhere)
    motion = CAPTURED_SHARE * by_capture + (1.0 - CAPTURED_SHARE) * by_teacher
    agreement, parts = feature_concordance(prediction * 1e3, true * 1e3)
    report = {"captured": by_capture.item(), "taught": by_teacher.item()}
    return motion + CONCORDANCE * agreement, report | parts


@torch.no_grad()
def validate(model: StreamNet, clips: list[Lesson], captured: Collection[str]) -> dict[str, float]:
    """r and slope of every feature on unseen clips, against captured motion or else the teacher's."""
    report, device = {}, model.mean.device
    model.eval().cpu()
    for source in sorted({x.source for x in clips if x.held_out}):
        chosen = [x for x in clips if x.held_out and x.source == source][:HELD_OUT_CLIPS]
        true = [x.motion if source in captured else x.taught.float() for x in chosen]
        for head in (None, *range(len(model.sooner))):
            predicted = [perform(model, x.mels[0].float(), len(x.motion), head) for x in chosen]
            scores = feature_scores(list(zip(predicted, true, strict=True)))
            name = source if head is None else f"{source} {model.config.sooner[head]} sooner"
            report |= {f"{name} {key}": value for key, value in scores.items()}
    model.train().to(device)
    return report


def measure(arguments) -> None:
    """Prints the size of the student in `arguments.finished`, and its scores as a table, r / slope."""
    seeded(arguments)
    teacher = load_teacher(arguments)
    entries = entries_of(arguments, 1, None)
    for folder in arguments.speech:
        entries += lessons.speech_entries(folder, arguments.speech_limit, voices=1)
    clips = [teacher.teach(entry) for entry in entries if entry.held_out]
    captured = {x.source for x in clips if bool((x.weight > 0).any())}
    model = load_stream(arguments.finished)
    print(describe(model))
    report = validate(model, clips, captured)
    print(f"| clips | {' | '.join(FEATURES)} |")
    for name in dict.fromkeys(key.rsplit(" ", 2)[0] for key in report):
        cells = [f"{report[f'{name} {of} r']:.3f} / {report[f'{name} {of} slope']:.2f}" for of in FEATURES]
        print(f"| {name} | {' | '.join(cells)} |")


def prepare(arguments) -> list[Lesson]:
    """The lessons of a run: clips with the motion that the teacher predicts."""
    debug = arguments.config == "debug"
    voices, limit = (2, 4) if debug else (arguments.voices, None)
    entries = entries_of(arguments, voices, limit)
    if arguments.minutes > 0:
        entries += spoken.load(arguments.data, arguments.cache, arguments.minutes)
    arguments.out.mkdir(parents=True, exist_ok=True)
    teacher = load_teacher(arguments)
    count = 4 if debug else arguments.speech_limit
    return lessons.load(entries, teacher, arguments.out, arguments.speech, count)


def new_model(arguments, clips: list[Lesson]) -> StreamNet:
    """A new student scaled to the taught motion, or with `--sooner` the finished one with more heads."""
    if arguments.sooner:
        return with_sooner(arguments.finished, arguments.sooner)
    config = debug_config() if arguments.config == "debug" else StreamConfig()
    model = StreamNet(prior_of(config, clips))
    taught = torch.cat([x.taught.float() for x in clips])
    model.mean.copy_(taught.mean(dim=0))
    model.std.copy_(taught.std(dim=0).clamp_min(2e-4))
    assert model.std.shape == (DIMS,)
    return model


def train(arguments) -> Path:
    """Runs the training; writes `stream.pt` with the averaged weights and returns its path."""
    seeded(arguments)
    debug = arguments.config == "debug"
    clips = prepare(arguments)
    model = new_model(arguments, clips)
    captured = captured_shares(arguments, clips)
    shares = shares_of(clips, SPEECH_SHARE, captured)
    scales = measured_scales([*captured], clips)
    machine = Machine(arguments.device, arguments.precision)
    sampler = LessonSampler(clips, shares, machine.seed(arguments.seed), model.config, scales)
    machine.place(model, arguments.seed)
    run, weight = start(arguments, model, {"windows": sampler.random}, 0.99, machine), landmark_weights()
    count, frames = (4, 32) if debug else (arguments.batch, arguments.frames)

    def loss(_step: int) -> tuple[torch.Tensor, dict[str, float]]:
        return loss_of(model, sampler.batch(count, frames), weight, machine)

    def judge(averaged: StreamNet) -> dict[str, float]:
        save(run.out / "stream.pt", averaged)
        return validate(averaged, clips, captured)

    descend(arguments, run, loss, judge)
    return run.out / "stream.pt"


def parser() -> argparse.ArgumentParser:
    """Command line."""
    parser = trainer_parser(__doc__, "runs/stream", 1500, 2e-3)
    add_arguments(parser, "bfloat16")
    parser.add_argument("--models", type=Path, help="folder of models; none: the embedded ones")
    parser.add_argument(
        "--ats", type=Path, help="ats.pt of training.systems.freetalk.train, instead of --models"
    )
    parser.add_argument("--sooner", type=int, nargs="*", default=[],
                        help="leads in frames: train a head for each on a frozen --finished")  # fmt: skip
    parser.add_argument("--finished", type=Path, default=WEIGHTS / "freetalk/stream")
    parser.add_argument("--measure", action="store_true", help="measure --finished instead of training")
    parser.add_argument("--speech", type=Path, nargs="*", default=[], help="folders of sound")
    parser.add_argument("--speech-limit", type=int, help="sounds of each folder")
    parser.add_argument("--minutes", type=float, default=0.0, help="minutes of each language by espeak-ng")
    parser.add_argument("--config", choices=["stream", "debug"], default="stream")
    parser.add_argument("--voices", type=int, default=7)
    parser.add_argument("--batch", type=int, default=16)
    parser.add_argument("--frames", type=int, default=112)
    return parser


if __name__ == "__main__":
    request = parser().parse_args()
    (measure if request.measure else train)(request)
