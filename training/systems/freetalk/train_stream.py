"""Trains the streaming student on the full model's motion and on captured motion.

    python -m training.systems.freetalk.train_stream --data ../shared/data --out runs/stream

The teacher is the denoiser in `--models`, or with `--ats` that of a finished run, on the ear's features of
the whole sound. `--speech DIR ...` names folders of speech without motion, so that the student hears more
voices than were captured; it learns only the teacher's motion there. `--corpus DIR [DIR ...]` trains on
corpus folders instead of the project's own sources. `--leave-clips` keeps recorded clips out of training to
measure on them. `--measure` trains nothing: it prints r and slope of the model in `--finished` on held-out
clips. Seeded; resumes from `--out/last.pt` bit for bit; `--device` and `--precision` set where and how it
computes (`training/machine.py`); `--config debug` takes a minute.
"""

import argparse
from collections.abc import Collection
from dataclasses import replace
from pathlib import Path

import torch

from training import WEIGHTS
from training.corpus import lessons
from training.corpus.grid import FIVE
from training.corpus.lesson_windows import DIMS, LessonBatch, LessonSampler
from training.corpus.lessons import Lesson, silence, taught_by
from training.corpus.shares import lasting, measured_scales
from training.corpus.split import leave_clips
from training.losses import FEATURES, feature_concordance, feature_scores, landmark_weights, motion_loss
from training.machine import Machine, add_arguments
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
    with_sooner,
)
from training.speech.log_mel import ACTIVE_QUANTILE, clip_colour
from training.systems.freetalk.ats import AtsDenoiser, neutral_affect
from training.systems.freetalk.sampling import sample_motion
from training.systems.freetalk.stored import load_models, load_run

SHARES = {"grid_s1": 0.4, "grid_five": 0.3, "facegood_zh": 0.3}
CONCORDANCE = 0.2
CAPTURED_SHARE, SPEECH_SHARE = 0.5, 0.4
HELD_OUT_CLIPS = 60


class FullModel:
    """The full model in its default style: features of the ear [T, C] → motion [T, 204] in metres.

    The motion is without noise. `training.speech.train_live_closures` teaches where the lips close.
    """

    def __init__(self, denoiser: AtsDenoiser):
        self.denoiser = denoiser
        self.sampling = replace(denoiser.config.sampling, temperature=0.0)
        self.style = denoiser.config.styles.index(denoiser.config.default_style)

    @torch.no_grad()
    def __call__(self, heard: torch.Tensor) -> torch.Tensor:
        return sample_motion(
            self.denoiser, heard, neutral_affect(1, len(heard))[0], self.style, 0, self.sampling
        )


def load_teacher(arguments) -> FullModel:
    """The full model of `--ats`, or of `--models`."""
    return FullModel(load_models(arguments.models)[1] if arguments.ats is None else load_run(arguments.ats))


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
    true = torch.where(mask > 0, true, taught)
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
    """r and slope of every feature on unseen clips, against captured motion or else the teacher's.

    Clips of several people in one source are told apart by the letters before the first `_` of their names.
    """
    report, device = {}, model.mean.device
    model.eval().cpu()
    groups: dict[str, list[Lesson]] = {}
    for clip in (x for x in clips if x.held_out):
        groups.setdefault(speaker(clip), []).append(clip)
    for source, group in sorted(groups.items()):
        chosen = group[:HELD_OUT_CLIPS]
        at = slice(0, DIMS) if chosen[0].source in captured else slice(DIMS, 2 * DIMS)
        true = [x.motion[:, at].float() for x in chosen]
        for head in (None, *range(len(model.sooner))):
            predicted = [perform(model, x.mels[0].float(), len(x.motion), head) for x in chosen]
            scores = feature_scores(list(zip(predicted, true, strict=True)))
            name = source if head is None else f"{source} {model.config.sooner[head]} sooner"
            report |= {f"{name} {key}": value for key, value in scores.items()}
    model.train().to(device)
    return report


def speaker(clip: Lesson) -> str:
    """The source of a clip; of grid_five the speaker."""
    return clip.name.split("_")[0] if clip.source == FIVE else clip.source


def measure(arguments) -> None:
    """Prints the size of the student in `arguments.finished`, and its scores as a table, r / slope."""
    seeded(arguments)
    arguments.voices = 1
    clips, _ = prepare(arguments)
    captured = {x.source for x in clips if bool((x.weight > 0).any())}
    model = load_stream(arguments.finished)
    print(describe(model))
    report = validate(model, clips, captured)
    print(f"| clips | {' | '.join(FEATURES)} |")
    for name in dict.fromkeys(key.rsplit(" ", 2)[0] for key in report):
        cells = [f"{report[f'{name} {of} r']:.3f} / {report[f'{name} {of} slope']:.2f}" for of in FEATURES]
        print(f"| {name} | {' | '.join(cells)} |")


def prepare(arguments) -> tuple[list[Lesson], torch.Tensor]:
    """The lessons of a run with the motion that the teacher predicts, and its motion in silence."""
    teacher = load_teacher(arguments)
    clips = lessons.load(arguments, 4 if arguments.config == "debug" else None)
    leave_clips(clips, arguments.leave_clips)
    return taught_by(clips, teacher), silence(teacher, arguments.ear)


def new_model(arguments, clips: list[Lesson]) -> StreamNet:
    """A new student scaled to the taught motion, or with `--sooner` the finished one with more heads."""
    if arguments.sooner:
        return with_sooner(arguments.finished, arguments.sooner)
    config = debug_config() if arguments.config == "debug" else StreamConfig()
    model = StreamNet(prior_of(config, clips))
    taught = torch.cat([x.motion[:, DIMS:].float() for x in clips])
    model.mean.copy_(taught.mean(dim=0))
    model.std.copy_(taught.std(dim=0).clamp_min(2e-4))
    return model


def train(arguments) -> Path:
    """Runs the training; writes `stream.pt` with the averaged weights and returns its path."""
    seeded(arguments)
    debug = arguments.config == "debug"
    clips, at_rest = prepare(arguments)
    model = new_model(arguments, clips)
    captured = captured_shares(arguments, clips)
    shares = shares_of(clips, SPEECH_SHARE, captured)
    scales = measured_scales([*captured], clips)
    machine = Machine(arguments.device, arguments.precision)
    sampler = LessonSampler(clips, shares, machine.seed(arguments.seed), model.config, at_rest, scales)
    machine.place(model, arguments.seed)
    run = begin_student(arguments, model, {"windows": sampler.random}, 0.99, machine)
    weight = landmark_weights()
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
    parser.add_argument("--config", choices=["stream", "debug"], default="stream")
    lessons.add_arguments(parser, 7)
    parser.add_argument("--batch", type=int, default=16)
    parser.add_argument("--frames", type=int, default=112)
    return parser


if __name__ == "__main__":
    request = parser().parse_args()
    (measure if request.measure else train)(request)
