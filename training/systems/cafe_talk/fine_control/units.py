"""Measures each action unit on held-out takes: its effect and its cost (tables 3 and 4 of Cafe-Talk)."""

import math
from dataclasses import asdict, dataclass

import numpy as np
from torch import Tensor

from training.corpus.action_units import LOWER
from training.corpus.conditions import UNITS
from training.systems.cafe_talk.fine_control import metrics
from training.systems.cafe_talk.fine_control.trial import Actor, Take, TakeControl

BETAS = (0.5, 1.0, 1.5, 2.0)
USUAL = 1.0


@dataclass
class UnitScores:
    """Scores of one unit on both sides, means over takes.

    `control_rate` is by β, `none` is that without an event. `leak` is a share. `far` is the largest change of
    any weight more than ten frames away. `gap_r_lost` is how much the event lowers r between the lip gap and
    the recording's. `closures` counts p, b and m in the slots. `closed` and `closed_none` are the shares of
    them at which the lips meet, with and without the event; NaN if there are none.
    """

    unit: str
    is_lower: bool
    control_rate: dict[str, float]
    none: float
    leak: float
    far: float
    gap_r_lost: float
    closures: int
    closed: float
    closed_none: float

    @property
    def grows(self) -> bool:
        """Whether the control rate grows at every step of β."""
        rates = list(self.control_rate.values())
        return all(a < b for a, b in zip(rates, rates[1:], strict=False))


def measure(
    actor: Actor,
    takes: list[Take],
    units: tuple[str, ...] | list[str] = tuple(UNITS),
    betas: tuple[float, ...] = BETAS,
    sampling=None,
    **controls,
) -> list[UnitScores]:
    """Each unit on each take at every β; `controls` go to `TakeControl` (`printed`, `unmasked`)."""
    plain = [actor.perform(take, sampling=sampling) for take in takes]
    scores = []
    for unit in units:
        generated = {
            beta: [actor.perform(t, TakeControl(unit, beta, **controls), sampling) for t in takes]
            for beta in sorted({*betas, USUAL})
        }
        scores.append(score(unit, takes, plain, generated))
    return scores


def score(
    unit: str, takes: list[Take], plain: list[Tensor], generated: dict[float, list[Tensor]]
) -> UnitScores:
    """Scores one unit from weights [T, 51]: `plain` without an event, and `generated` with one, by β."""
    usual = list(zip(takes, plain, generated[USUAL], strict=True))
    strengths = lambda weights: metrics.unit_values(weights, unit)  # noqa: E731

    def rate(rows: list[Tensor]) -> float:
        return mean(metrics.control_rate(strengths(w), t.slot) for w, t in zip(rows, takes, strict=True))

    lost = (metrics.gap_r(p, t.truth) - metrics.gap_r(w, t.truth) for t, p, w in usual)
    count, closed = closed_share(takes, generated[USUAL])
    return UnitScores(
        unit=unit,
        is_lower=unit in LOWER,
        control_rate={str(beta): rate(rows) for beta, rows in generated.items()},
        none=rate(plain),
        leak=mean(metrics.leak(strengths(w), strengths(p), t.slot) for t, p, w in usual),
        far=max((metrics.far_change(w, p, t.slot) for t, p, w in usual), default=math.nan),
        gap_r_lost=mean(lost),
        closures=count,
        closed=closed,
        closed_none=closed_share(takes, plain)[1],
    )


def closed_share(takes: list[Take], generated: list[Tensor]) -> tuple[int, float]:
    """How many p, b and m the slots of takes hold, and the share at which the lips meet."""
    counts = [metrics.closures(w, t.phones, t.slot) for t, w in zip(takes, generated, strict=True)]
    count, met = (sum(column) for column in zip(*counts, strict=True))
    return count, met / count if count else math.nan


def mean(values) -> float:
    """Mean of the values that could be measured."""
    known = [v for v in values if not math.isnan(v)]
    return float(np.mean(known)) if known else math.nan


def summary(scores: list[UnitScores]) -> dict[str, float]:
    """One row for a model: the scores of all its units together, at β 1."""
    rates = [s.control_rate[str(USUAL)] for s in scores]
    lower, upper = ([s for s in scores if s.is_lower is side] for side in (True, False))
    count = sum(s.closures for s in lower)
    closed = sum(s.closed * s.closures for s in lower if s.closures)
    return {
        "control rate": mean(rates),
        "weakest": min(rates),
        "leak": mean(s.leak for s in scores),
        "far": max(s.far for s in scores),
        "r lost upper": max((s.gap_r_lost for s in upper), default=math.nan),
        "r lost lower": max((s.gap_r_lost for s in lower), default=math.nan),
        "closed lower": closed / count if count else math.nan,
    }


def to_json(scores: list[UnitScores]) -> list[dict]:
    """The scores as rows of the report."""
    return [asdict(s) | {"grows": s.grows} for s in scores]
