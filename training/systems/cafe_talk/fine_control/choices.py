"""Tries settings that the paper does not print: denoising steps, α, β, and the third term of eq. 6."""

from dataclasses import replace

from training.systems.cafe_talk.denoiser import Sampling
from training.systems.cafe_talk.fine_control import metrics, units
from training.systems.cafe_talk.fine_control.trial import Actor, Take, TakeControl

STEPS = (1, 2, 4, 8, 16)
ALPHAS = (1.0, 1.5, 2.0)
SAMPLE = ("1", "4", "12", "15", "26", "45")
"""Units that represent all sixteen in trials where testing each would take too long."""
UPPER, LOWER = ("1", "4", "45"), ("12", "20", "26")
"""Units whose events should not move the lips, and units whose events do."""
GUIDANCES = (1.0, 2.0, 3.0)
"""Values of α at which the two forms of eq. 6 are compared."""
Row = dict[str, float | str]


def speech(actor: Actor, takes: list[Take], sampling: Sampling | None = None) -> dict[str, float]:
    """r and slope of the lip gap without emotion or event, by source."""
    report: dict[str, float] = {}
    for source in sorted({t.source for t in takes}):
        some = [t for t in takes if t.source == source]
        generated = [actor.perform(t, sampling=sampling) for t in some]
        report[f"{source} r"] = units.mean(
            metrics.gap_r(w, t.truth) for w, t in zip(generated, some, strict=True)
        )
        slopes = (metrics.gap_slope(w, t.truth) for w, t in zip(generated, some, strict=True))
        report[f"{source} slope"] = units.mean(slopes)
    return report


def steps(actor: Actor, takes: list[Take]) -> list[Row]:
    """Lip gap and control rate by the number of denoising steps."""
    usual = actor.config.sampling
    return [_row(actor, takes, replace(usual, steps=count), {"steps": count}) for count in STEPS]


def alphas(actor: Actor, takes: list[Take]) -> list[Row]:
    """Lip gap and control rate by α, the guidance of speech and emotion."""
    return [_row(actor, takes, replace(actor.config.sampling, alpha=a), {"α": a}) for a in ALPHAS]


def _row(actor: Actor, takes: list[Take], sampling: Sampling, name: Row) -> Row:
    scores = units.measure(actor, takes, SAMPLE, (units.USUAL,), sampling)
    return name | speech(actor, takes, sampling) | units.summary(scores)


def formulas(actor: Actor, takes: list[Take]) -> list[Row]:
    """Compares eq. 6 as printed with `G_AC` in its third term: how events move the lips, by α, at β 1.

    The amplitude of the lip gap with the event is divided by that without, inside the slot and outside it.
    With a mask over frames only, an event guides every shape in its slot. With a mask over shapes, it guides
    only its own shapes.
    """
    return [
        {"α": alpha, "units": name} | row
        for alpha in GUIDANCES
        for name, unit_names in (("upper", UPPER), ("lower", LOWER))
        for row in _forms(actor, takes, replace(actor.config.sampling, alpha=alpha), unit_names)
    ]


def _forms(actor: Actor, takes: list[Take], sampling: Sampling, unit_names: tuple[str, ...]) -> list[Row]:
    """A row for each third term and each mask."""
    plain = [actor.perform(take, sampling=sampling) for take in takes]
    rows = []
    for printed in (False, True):
        for every in (False, True):
            way = {"printed": printed, "every_shape": every}
            generated = {
                u: [actor.perform(t, TakeControl(u, 1.0, **way), sampling) for t in takes] for u in unit_names
            }
            rates = (
                metrics.control_rate(metrics.unit_values(w, unit), t.slot)
                for unit, row in generated.items()
                for w, t in zip(row, takes, strict=True)
            )
            row = {"third term": "G_ACF − G_∅" if printed else "G_ACF − G_AC"}
            row |= {"mask": "frames" if every else "shapes", "control rate": units.mean(rates)}
            rows.append(row | _amplitudes(takes, plain, generated))
    return rows


def _amplitudes(takes: list[Take], plain: list, generated: dict[str, list]) -> Row:
    out: Row = {}
    for name, inside in (("inside", True), ("outside", False)):
        shares = (
            metrics.amplitude_mm(w, t.slot, inside) / max(metrics.amplitude_mm(p, t.slot, inside), 1e-6)
            for row in generated.values()
            for w, p, t in zip(row, plain, takes, strict=True)
        )
        out[f"lip amplitude {name}"] = units.mean(shares)
    return out
