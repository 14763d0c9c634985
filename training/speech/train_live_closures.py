"""Trains a detector of closed lips for live speech: the closures of FreeTalk's stream.

    python -m training.speech.train_live_closures --data ../shared/data --out runs/live_closures

A landmark network trained by squared error blurs p, b and m. This small student hears the same sound with the
same look-ahead and outputs one number a frame, the logit of closed lips. Its teacher is the read-out of the
compact encoder, which hears the whole sound. Speech, rooms, noises and levels are those of
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

from training import WEIGHTS
from training.corpus.clip import MEL_PER_FRAME
from training.corpus.lesson_windows import LessonBatch, LessonSampler
from training.corpus.lessons import Lesson
from training.nn.checkpoint import save
from training.run import descend, seeded
from training.speech import train_causal
from training.speech.causal import (
    StreamConfig,
    StreamNet,
    debug_config,
    describe,
    load_stream,
    normalise_running,
    pad_mel,
    perform,
    with_sooner,
)
from training.speech.compact import SHIPPED_ENCODER, CompactEncoder, load_encoder
from training.speech.train import start
from training.speech.train_causal import EDGE, prepare, whole
from training.systems.freetalk.train_stream import prior_of

CLOSED, SURE = 0.35, 0.2
"""Probabilities of a closure at which lips touch and at which they begin to close (see `closure_share` in
`rust-core/src/speech/closures.rs`).
"""
POSITIVE_WEIGHT = 4.0
"""Extra loss weight of closed frames, because they are rare: a closure lasts a frame or two of twenty."""
OFFSET = 1.0
"""Subtracted from the logit after training, because the weight of closed frames raises it by up to ln 5.

With this offset the student closes lips in about three quarters of the frames in which its teacher does.
Without it the mouth hardly opened.
"""
CALIBRATION_CLIPS = 200
HELD_OUT_CLIPS = 30
"""Most held-out clips of each source that are measured."""
SHARES = ("met", "wrong", "closed", "teacher_closed")
"""What `closure_counts` counts."""


def loss_of(model: StreamNet, encoder: CompactEncoder, batch: LessonBatch, frames: int):
    """Cross-entropy of closed lips, with more weight where they are closed."""
    taught = encoder.closed(whole(encoder, batch.mel, frames))[:, EDGE:]
    mel = normalise_running(batch.mel, model.config.normaliser, batch.heard)
    weight = 1.0 + POSITIVE_WEIGHT * taught
    total, report = 0.0, {}
    with torch.autocast("cpu", torch.bfloat16):
        heard = model.hear(mel)
        for name, head, sooner in heads(model)[1:] or heads(model):
            # The teacher's first EDGE frames lack context. Row t of a head predicts frame t + sooner.
            said = model.say(heard, head).float()[:, EDGE - sooner : frames - sooner, 0]
            loss = F.binary_cross_entropy_with_logits(
                said, taught[:, : frames - EDGE], weight[:, : frames - EDGE]
            )
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
def validate(
    model: StreamNet, encoder: CompactEncoder, lessons: list[Lesson], count: int
) -> dict[str, float]:
    """The `SHARES` of every source and head on `count` held-out clips."""
    model.eval()
    report = {}
    for source, (name, head, _) in product(sorted({x.source for x in lessons if x.held_out}), heads(model)):
        counts = torch.zeros(len(SHARES), 2)
        for clip in [x for x in lessons if x.held_out and x.source == source][:count]:
            mel, frames = clip.mels[0].float(), len(clip.motion)
            rows = whole(encoder, pad_mel(mel, MEL_PER_FRAME * frames)[None], frames)
            predicted = perform(model, mel, frames, head)[:, 0].sigmoid()
            counts += closure_counts(predicted, encoder.closed(rows)[0])
        shares = (counts[:, 0] / counts[:, 1].clamp_min(1)).tolist()
        report |= {f"{source} {name}{key}": share for key, share in zip(SHARES, shares, strict=True)}
    model.train()
    return report


def new_model(arguments, lessons: list[Lesson]) -> StreamNet:
    """An untrained student, or with `--sooner` a finished one with further heads."""
    if arguments.sooner:
        return with_sooner(arguments.finished, arguments.sooner)
    config = debug_config() if arguments.config == "debug" else StreamConfig(channels=arguments.channels)
    config.system, config.model, config.outputs = "freetalk", "live_closures", 1
    return StreamNet(prior_of(config, lessons))


@torch.no_grad()
def calibrate(model: StreamNet, lessons: list[Lesson]) -> None:
    """Shifts the logits of the further heads so that each closes the lips as often as the main head on
    training clips.

    The less a head can tell, the more the weight of closed frames has raised its logits.
    """
    clips = [x for x in lessons if not x.held_out][:: max(len(lessons) // CALIBRATION_CLIPS, 1)]

    def logits(head: int | None) -> Tensor:
        rows = [perform(model, x.mels[0].float(), len(x.motion), head)[:, 0] for x in clips]
        return torch.cat(rows)

    least = torch.logit(torch.tensor(CLOSED))
    shut = (logits(None) > least).float().mean()
    for head, further in enumerate(model.sooner):
        further.head.bias += least - torch.quantile(logits(head), 1.0 - shut)


def measure(arguments) -> None:
    """Prints the size of the student in `arguments.finished`, and its `SHARES` as a table."""
    seeded(arguments)
    arguments.voices = 1
    encoder = load_encoder(SHIPPED_ENCODER).eval().requires_grad_(False)
    model = load_stream(arguments.finished)
    print(describe(model))
    report = validate(model, encoder, prepare(arguments), HELD_OUT_CLIPS)
    print(f"| clips | {' | '.join(SHARES)} |")
    for name in dict.fromkeys(key.rpartition(" ")[0] for key in report):
        cells = [f"{report[f'{name} {key}']:.2f}" for key in SHARES]
        print(f"| {name} | {' | '.join(cells)} |")


def train(arguments) -> Path:
    """Runs the training; writes `stream.pt` with the averaged weights and returns its path."""
    seeded(arguments)
    debug = arguments.config == "debug"
    encoder = load_encoder(SHIPPED_ENCODER).eval().requires_grad_(False)
    lessons = prepare(arguments)
    arguments.out.mkdir(parents=True, exist_ok=True)
    model = new_model(arguments, lessons)
    sampler = LessonSampler(lessons, train_causal.shares_of(lessons), arguments.seed, model.config)
    run = start(arguments, model, {"windows": sampler.random}, 0.99)
    count, frames = (4, 32) if debug else (arguments.batch, arguments.frames)

    def judge(averaged: StreamNet) -> dict[str, float]:
        averaged.mean.fill_(-OFFSET)
        finished = copy.deepcopy(averaged).eval()
        calibrate(finished, lessons)
        save(run.out / "stream.pt", finished)
        return validate(finished, encoder, lessons, 4 if debug else HELD_OUT_CLIPS)

    descend(arguments, run, lambda _: loss_of(model, encoder, sampler.batch(count, frames), frames), judge)
    return run.out / "stream.pt"


def parser() -> argparse.ArgumentParser:
    """Command line."""
    parser = train_causal.parser(__doc__, "runs/live_closures")
    parser.set_defaults(channels=64, steps=2500)
    parser.add_argument("--sooner", type=int, nargs="*", default=[],
                        help="leads in frames: train a head for each on a frozen --finished")  # fmt: skip
    parser.add_argument("--finished", type=Path, default=WEIGHTS / "freetalk/live_closures")
    parser.add_argument("--measure", action="store_true", help="measure --finished instead of training")
    return parser


if __name__ == "__main__":
    request = parser().parse_args()
    (measure if request.measure else train)(request)
