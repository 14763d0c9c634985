"""Measures a run of Cafe-Talk: events, emotions, and the settings that the paper does not print.

    python -m training.systems.cafe_talk.evaluate --out runs/cafe_report

`--run` is an exported model with the encoder beside it, by default the shipped one, or a `cafe_talk.pt`.
Writes report.json and report.md. `--ablation "without swapped labels=runs/x/cafe_talk.pt"` adds a row for a
run or folder trained without a part, sampled like `--run`. Unmasked guidance needs no run of its own and
always gets a row. Only weights are measured, on ICT's landmarks. This leaves out what the engine adds when it
shows them (it brings the lips together on the head).
"""

import argparse
import json
import math
from pathlib import Path

import torch

from training import shipped
from training.corpus.conditions import UNITS
from training.systems.cafe_talk import judge as judging
from training.systems.cafe_talk.fine_control import choices, emotions, trial, units
from training.systems.cafe_talk.fine_control.trial import Actor, Take

SHIPPED = shipped("cafe_talk_compact")
PARTS = ("units", "ablations", "emotions", "steps", "alphas", "formulas")
TITLES = {
    "speech": "Speech without emotion or event",
    "units": "Every unit, by β",
    "ablations": "Without a part (tables 2 and 3)",
    "labels": "The label (table 8)",
    "intensities": "The intensity (table 9)",
    "steps": "Denoising steps",
    "alphas": "Guidance of speech and emotion",
    "formulas": "Eq. 6 as printed and the variant",
}


def report(arguments) -> dict[str, list[dict]]:
    """The table on speech and all tables that `--only` names, as rows by name."""
    torch.set_num_threads(arguments.threads)
    lessons, held_out = trial.clips(arguments)
    if not held_out:
        raise ValueError("expected held-out clips, got none")
    actor = Actor(arguments.run)
    takes = [actor.take(entry) for entry in held_out]
    tables = {"speech": [choices.speech(actor, takes)]}
    only = arguments.only
    if "units" in only:
        scores = units.measure(actor, takes, arguments.units)
        tables["units"] = units.to_json(scores)
    judge = None
    if {"emotions", "ablations"} & set(only):
        judge = judging.taught(lessons, arguments.judge_steps, arguments.seed)
    few = by_source(takes, arguments.few)
    if "ablations" in only:
        tables["ablations"] = ablations(arguments, actor, takes, held_out, judge)
    if "emotions" in only:
        tables["labels"] = named(emotions.by_label(judge, actor, few))
        tables["intensities"] = named(emotions.by_intensity(judge, actor, few))
    for name in ("steps", "alphas", "formulas"):
        if name in only:
            tables[name] = getattr(choices, name)(actor, few)
    return tables


def ablations(arguments, actor: Actor, takes: list[Take], held_out: list, judge: judging.Judge) -> list[dict]:
    """A row for the run, for its guidance without a mask, and for each run of `--ablation`."""
    few = by_source(takes, arguments.few)
    usual = (units.USUAL,)
    rows = [whole("the run", actor, takes, few, judge, arguments.units)]
    unmasked = units.measure(actor, takes, arguments.units, usual, unmasked=True)
    rows.append({"model": "without the mask of guidance"} | units.summary(unmasked))
    for text in arguments.ablation:
        name, mark, path = text.rpartition("=")
        if not mark:
            raise ValueError(f"--ablation: expected NAME=RUN, got {text!r}")
        other = Actor(Path(path))
        other.config.sampling = actor.config.sampling
        heard = [other.take(entry) for entry in held_out]
        rows.append(whole(name, other, heard, by_source(heard, arguments.few), judge, arguments.units))
    return rows


def whole(name: str, actor: Actor, takes: list[Take], few: list[Take], judge, unit_names: list[str]) -> dict:
    """Speech, events and emotions of one model."""
    events = units.summary(units.measure(actor, takes, unit_names, (units.USUAL,)))
    accuracy = emotions.accuracy(judge, actor, few)
    return {"model": name} | choices.speech(actor, takes) | events | accuracy


def by_source(takes: list[Take], count: int) -> list[Take]:
    """The first `count` takes of each source."""
    sources = sorted({t.source for t in takes})
    return [t for s in sources for t in [t for t in takes if t.source == s][:count]]


def named(rows: dict[str, dict[str, float]]) -> list[dict]:
    """Rows with their names as the first column."""
    return [{"": name} | row for name, row in rows.items()]


def page(tables: dict[str, list[dict]]) -> str:
    """All tables in Markdown."""
    parts = [f"## {TITLES[name]}\n\n{table(rows)}" for name, rows in tables.items()]
    return "\n".join(["# Cafe-Talk, measured\n", *parts])


def table(rows: list[dict]) -> str:
    """A Markdown table. A cell that holds a dict becomes one column per key."""
    flat = [{k: v for key, value in row.items() for k, v in _columns(key, value)} for row in rows]
    heads = list(dict.fromkeys(key for row in flat for key in row))
    lines = [f"| {' | '.join(heads)} |", "| --- |" + " --- |" * (len(heads) - 1)]
    lines += [f"| {' | '.join(_cell(row.get(head, math.nan)) for head in heads)} |" for row in flat]
    return "\n".join(lines) + "\n"


def _columns(key: str, value) -> list[tuple]:
    if isinstance(value, dict):
        return [(f"{key.replace('_', ' ')} {k}", v) for k, v in value.items()]
    return [(key.replace("_", " "), value)]


def _cell(value) -> str:
    if isinstance(value, float):
        return "–" if math.isnan(value) else f"{value:.3f}"
    return {True: "yes", False: "no"}[value] if isinstance(value, bool) else str(value)


def plain(value):
    """Replaces NaN, which JSON lacks, by `None`."""
    if isinstance(value, dict):
        return {k: plain(v) for k, v in value.items()}
    if isinstance(value, list):
        return [plain(v) for v in value]
    return None if isinstance(value, float) and math.isnan(value) else value


def parser() -> argparse.ArgumentParser:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--run", type=Path, default=SHIPPED, help="cafe_talk.pt, or a model folder")
    parser.add_argument("--ablation", nargs="*", default=[], metavar="NAME=RUN")
    parser.add_argument("--out", type=Path, default=Path("runs/cafe_report"))
    parser.add_argument("--corpus", type=Path, nargs="*", default=[], help="corpus folders")
    parser.add_argument("--data", type=Path, default=Path("../shared/data"))
    parser.add_argument("--cache", type=Path, default=Path("runs/cache"))
    parser.add_argument("--only", nargs="*", choices=PARTS, default=list(PARTS))
    parser.add_argument("--units", nargs="*", choices=UNITS, default=list(UNITS))
    parser.add_argument("--clips", type=int, default=8, help="held-out clips of each source")
    parser.add_argument(
        "--few", type=int, default=3, help="held-out clips of each source for emotions and settings"
    )
    parser.add_argument("--seconds", type=float, default=6.0, help="most seconds of each clip")
    parser.add_argument("--judge-steps", type=int, default=800)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--threads", type=int, default=1)
    return parser


def main(line: list[str] | None = None) -> None:
    """Entry of the command."""
    arguments = parser().parse_args(line)
    tables = report(arguments)
    arguments.out.mkdir(parents=True, exist_ok=True)
    (arguments.out / "report.json").write_text(json.dumps(plain(tables), indent=1, ensure_ascii=False) + "\n")
    (arguments.out / "report.md").write_text(page(tables), encoding="utf-8")
    print(arguments.out / "report.md")


if __name__ == "__main__":
    main()
