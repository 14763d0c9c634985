"""Trains a detector of closed lips for live speech: the closures of FreeTalk's stream.

    python -m training.speech.train_live_closures --data ../shared/data --out runs/live_closures

A landmark network trained by squared error blurs p, b and m. This small student hears the same sound with the
same look-ahead and outputs one number a frame, the logit of closed lips. Its teacher are the phones, which
the recogniser hears in the whole of the clean sound. Speech, rooms, noises and levels are those of
`training.speech.train_causal`. Seeded; resumes from `--out/last.pt`; `--config debug` takes a minute. `python
-m training.export stream --run runs/live_closures/stream.pt` writes the model. `--measure` trains nothing: it
prints the scores of the model in `--finished` on held-out clips.
"""

import argparse
import copy
from itertools import product
from pathlib import Path

import torch
import torch.nn.functional as F
from torch import Tensor

from training import shipped
from training.corpus import lessons
from training.corpus.lesson_windows import DIMS, LessonBatch, LessonSampler
from training.corpus.lessons import Lesson, silence, taught_by
from training.corpus.split import leave_clips
from training.machine import in_bfloat16
from training.nn.checkpoint import save
from training.run import begin_student, descend, seeded
from training.speech import train_causal
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
from training.speech.evaluate_phones import read_phones
from training.speech.phones import PARTS, PhoneReadout
from training.systems.freetalk.train_stream import prior_of

CLOSED, SURE = 0.35, 0.2
"""Probabilities of a closure at which lips touch and at which they begin to close (see `closure_share` in
`rust-core/src/speech/closures.rs`).
"""
BILABIALS = ("p", "b", "m")
EVEN, LEAST = 0.62, 1e-5
"""Log-odds of the phones at which `CLOSED` stands, and the least probability."""
POSITIVE_WEIGHT = 4.0
"""Extra loss weight of closed frames, because they are rare: a closure lasts a frame or two of twenty."""
CALIBRATION_CLIPS = 200
HELD_OUT_CLIPS = 30
"""Most held-out clips of each source that are measured."""
SHARES = ("met", "wrong", "closed", "teacher_closed")
"""What `closure_counts` counts."""


class Closures:
    """Features of the ear [T, C] → probability [T, 1] of p, b or m, on the scale of `CLOSED`.

    As `sure` in `rust-core/src/speech/contacts.rs`, which asks for surer odds by now (1.0) than those at
    which the shipped network was trained.
    """

    def __init__(self, readout: PhoneReadout):
        self.readout = readout
        self.classes = [readout.config.phones.index(sign) for sign in BILABIALS]

    @torch.no_grad()
    def __call__(self, heard: Tensor) -> Tensor:
        rows = self.readout(heard[None])[0].exp()[:, self.classes].sum(dim=1)
        share = rows.unflatten(0, (-1, PARTS)).mean(dim=1, keepdim=True)
        return torch.sigmoid(torch.logit(share.clamp(LEAST, 1.0 - LEAST)) - EVEN)


def prepare(arguments) -> tuple[list[Lesson], Tensor]:
    """The lessons of a run with probabilities of closed lips, and that of silence."""
    teach = Closures(read_phones(arguments.phones)[0])
    clips = lessons.load(arguments, 4 if arguments.config == "debug" else None)
    leave_clips(clips, arguments.leave_clips)
    return taught_by(clips, teach), silence(teach, arguments.ear)


def loss_of(model: StreamNet, batch: LessonBatch):
    """Cross-entropy of closed lips, with more weight where they are closed."""
    mel = normalise_running(batch.mel, model.config.normaliser, batch.heard)
    taught = batch.taught[..., 0]
    weight = 1.0 + POSITIVE_WEIGHT * taught
    total, report = 0.0, {}
    with in_bfloat16():
        heard = model.hear(mel)
        for name, head, sooner in heads(model)[1:] or heads(model):
            # Row t of a head predicts frame t + sooner.
            said = model.say(heard, head).float()[:, : taught.shape[1] - sooner, 0]
            loss = F.binary_cross_entropy_with_logits(said, taught[:, sooner:], weight[:, sooner:])
            total = total + loss
            report[f"{name}closed"] = loss.item()
    return total, report


def heads(model: StreamNet) -> list[tuple[str, int | None, int]]:
    """The main head and the further heads: label, number and lead in frames of each."""
    further = [(f"{by} sooner ", number, by) for number, by in enumerate(model.config.sooner)]
    return [("", None, 0), *further]


def near(rows: Tensor) -> Tensor:
    """The maximum of each frame and its two neighbours."""
    return F.max_pool1d(rows[None, None], 3, 1, 1)[0, 0]


def runs(mask: Tensor) -> list[slice]:
    """The runs of True in a mask."""
    edges = torch.diff(F.pad(mask.int(), (1, 1))).nonzero()[:, 0].tolist()
    return [slice(a, b) for a, b in zip(edges[::2], edges[1::2], strict=True)]


def closure_counts(predicted: Tensor, taught: Tensor) -> Tensor:
    """Counts [4, 2] of one clip whose probabilities of closed lips are `predicted` and `taught`, [T] each.

    The rows are `SHARES`, each with the part and the whole: the teacher's closures that the student meets
    within a frame, the student's closures that the teacher lacks, and the frames in which the student and
    the teacher close the lips.
    """
    of_student, of_teacher = runs(predicted > CLOSED), runs(taught > CLOSED)
    met = sum(bool((near(predicted)[run] > CLOSED).any()) for run in of_teacher)
    wrong = sum(not (near(taught)[run] > SURE).any() for run in of_student)
    closed, frames = [int((row > CLOSED).sum()) for row in (predicted, taught)], len(taught)
    return torch.tensor(
        [[met, len(of_teacher)], [wrong, len(of_student)], [closed[0], frames], [closed[1], frames]]
    )


@torch.no_grad()
def validate(model: StreamNet, clips: list[Lesson], count: int) -> dict[str, float]:
    """The `SHARES` of every source and head on `count` held-out clips."""
    model.eval()
    report = {}
    for source, (name, head, _) in product(sorted({x.source for x in clips if x.held_out}), heads(model)):
        counts = torch.zeros(len(SHARES), 2)
        for clip in [x for x in clips if x.held_out and x.source == source][:count]:
            taught = clip.motion[:, DIMS].float()
            predicted = perform(model, clip.mels[0].float(), len(taught), head)[:, 0].sigmoid()
            counts += closure_counts(predicted, taught)
        shares = (counts[:, 0] / counts[:, 1].clamp_min(1)).tolist()
        report |= {f"{source} {name}{key}": share for key, share in zip(SHARES, shares, strict=True)}
    model.train()
    return report


def new_model(arguments, clips: list[Lesson]) -> StreamNet:
    """An untrained student, or with `--sooner` a finished one with further heads."""
    if arguments.sooner:
        return with_sooner(arguments.finished, arguments.sooner)
    config = debug_config() if arguments.config == "debug" else StreamConfig(channels=arguments.channels)
    config.system, config.model, config.outputs = "freetalk", "live_closures", 1
    return StreamNet(prior_of(config, clips))


@torch.no_grad()
def calibrate(model: StreamNet, clips: list[Lesson]) -> None:
    """Shifts the logits of every head so that it closes the lips as often as the teacher on training clips.

    The less a head can tell, the more the weight of closed frames has raised its logits.
    """
    heard = [x for x in clips if not x.held_out][:: max(len(clips) // CALIBRATION_CLIPS, 1)]
    shut = (torch.cat([x.motion[:, DIMS] for x in heard]).float() > CLOSED).float().mean()

    def shift(head: int | None) -> Tensor:
        rows = [perform(model, x.mels[0].float(), len(x.motion), head)[:, 0] for x in heard]
        return torch.logit(torch.tensor(CLOSED)) - torch.quantile(torch.cat(rows), 1.0 - shut)

    model.mean += shift(None)
    for head, further in enumerate(model.sooner):
        further.head.bias += shift(head)


def measure(arguments) -> None:
    """Prints the size of the student in `arguments.finished`, and its `SHARES` as a table."""
    seeded(arguments)
    arguments.voices = 1
    model = load_stream(arguments.finished)
    print(describe(model))
    report = validate(model, prepare(arguments)[0], HELD_OUT_CLIPS)
    print(f"| clips | {' | '.join(SHARES)} |")
    for name in dict.fromkeys(key.rpartition(" ")[0] for key in report):
        cells = [f"{report[f'{name} {key}']:.2f}" for key in SHARES]
        print(f"| {name} | {' | '.join(cells)} |")


def train(arguments) -> Path:
    """Runs the training; writes `stream.pt` with the averaged weights and returns its path."""
    seeded(arguments)
    debug = arguments.config == "debug"
    clips, at_rest = prepare(arguments)
    arguments.out.mkdir(parents=True, exist_ok=True)
    model = new_model(arguments, clips)
    shares = train_causal.shares_of(clips)
    sampler = LessonSampler(clips, shares, arguments.seed, model.config, at_rest)
    run = begin_student(arguments, model, {"windows": sampler.random}, 0.99)
    count, frames = (4, 32) if debug else (arguments.batch, arguments.frames)

    def judge(averaged: StreamNet) -> dict[str, float]:
        finished = copy.deepcopy(averaged).eval()
        calibrate(finished, clips)
        save(run.out / "stream.pt", finished)
        return validate(finished, clips, 4 if debug else HELD_OUT_CLIPS)

    descend(arguments, run, lambda _: loss_of(model, sampler.batch(count, frames)), judge)
    return run.out / "stream.pt"


def parser() -> argparse.ArgumentParser:
    """Command line."""
    parser = train_causal.parser(__doc__, "runs/live_closures")
    parser.set_defaults(channels=64, steps=2500)
    parser.add_argument("--phones", type=Path, default=shipped("phones"), help="folder of the recogniser")
    parser.add_argument("--sooner", type=int, nargs="*", default=[],
                        help="leads in frames: train a head for each on a frozen --finished")  # fmt: skip
    parser.add_argument("--finished", type=Path, default=shipped("live_closures"))
    parser.add_argument("--measure", action="store_true", help="measure --finished instead of training")
    return parser


if __name__ == "__main__":
    request = parser().parse_args()
    (measure if request.measure else train)(request)
