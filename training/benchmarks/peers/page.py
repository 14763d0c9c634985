"""Writes the page: the measures and the method, a table for each source, and what the tables say."""

from math import isnan
from pathlib import Path

from training.benchmarks.peers.table import Row, Source
from training.benchmarks.peers.tools import TOOLS

HEAD = Path(__file__).with_name("head.md")
MARGIN = 0.005
READ = {
    "gap r": "gap",
    "width r": "width",
    "protrusion r": "protrusion",
    "gap speech": "gap within speech",
    "gap beyond": "gap beyond loudness",
}
COLUMNS = ("gap", "width", "protrusion", "in speech", "beyond loudness", "p b m, %", "MTM, ms (joined, %)",
           "SLCC", "delay, smoothing, ms")  # fmt: skip


def page(sources: list[Source], errors: dict[str, str]) -> str:
    """The whole page in Markdown."""
    parts = [HEAD.read_text(encoding="utf-8"), *map(section, sources), reading(sources), packages(errors)]
    return "\n".join(parts).rstrip() + "\n"


def section(source: Source) -> str:
    """Heading and table of a source."""
    judged = [r for _, chosen in source.turns for r in chosen]
    frames = sum(r.judged.stop - r.judged.start for r in judged)
    about = f"{len(judged)} recordings, {frames} frames. {counts(source)} {source.note}".rstrip()
    heads = f"| predictor | {' | '.join(COLUMNS)} |"
    lines = [f"## {source.title}\n", f"{about}\n", heads, "| --- |" + " --- |" * len(COLUMNS)]
    return "\n".join([*lines, *(f"| {row.name} | {' | '.join(cells(row))} |" for row in source.rows)]) + "\n"


def counts(source: Source) -> str:
    """How many closures and stretches the scores rest on."""
    scores = source.rows[0].scores
    closures = f"{scores['p b m']} p, b and m, " if scores["p b m"] else "No phone times, "
    return f"{closures}{scores['stretches']} stretches."


def cells(row: Row) -> list[str]:
    """The cells of a row as text."""
    s = row.scores
    pairs = [f"{number(s[f'{f} r'])} / {number(s[f'{f} slope'])}" for f in ("gap", "width", "protrusion")]
    mtm, joined = number(s.get("MTM"), 0), number(s.get("joined"), 0)
    delay = "–" if isnan(row.lag_ms) else f"{number(row.lag_ms, 0)}, {number(row.sigma_ms, 0)}"
    if "best lag" in s:
        delay = f"none (best: {number(s['best lag'], 0)})"
    return [*pairs, number(s.get("gap speech")), number(s.get("gap beyond")), number(s.get("closed"), 0),
            "–" if mtm == "–" else f"{mtm} ({joined})", number(s.get("SLCC")), delay]  # fmt: skip


def number(value: float | None, digits: int = 2) -> str:
    """A number, or a dash."""
    if value is None or isnan(value):
        return "–"
    return f"{round(value, digits) + 0.0:.{digits}f}".replace("-", "−")


def reading(sources: list[Source]) -> str:
    """What the tables say about r, in sentences."""
    lines = ["## Reading\n"]
    for source in sources:
        rows = {row.name: row.scores for row in source.rows}
        tools = [t.row for t in TOOLS if t.row in rows]
        if tools:
            ours = [name for name in rows if name == "Anyface"]
            sentences = [
                above(rows, tools),
                *(place(rows, ["loudness", "log-mel", *tools], name) for name in ours),
            ]
            lines.append(f"- **{source.title}**: {' '.join(sentences)} {source.note}".rstrip())
    return "\n".join(lines) + "\n"


def above(rows: dict[str, dict[str, float]], tools: list[str]) -> str:
    """A sentence with the r of loudness for the gap and the tools that have a higher one."""
    level = rows["loudness"]["gap r"]
    louder = [
        f"{tool} {number(rows[tool]['gap r'])}" for tool in tools if rows[tool]["gap r"] > level + MARGIN
    ]
    more = f"{len(louder)} of {len(tools)} tools have more" + (f" ({'; '.join(louder)})" if louder else "")
    return f"Loudness alone has r {number(level)} of the gap, and {more}."


def place(rows: dict[str, dict[str, float]], others: list[str], name: str) -> str:
    """A sentence with the scores in which one of our models beats all others, and those in which not."""
    before, behind = [], []
    for key, label in READ.items():
        if key in rows[name]:
            best = max(others, key=lambda other: rows[other][key])
            phrase = f"{label} ({number(rows[name][key])}; {best}: {number(rows[best][key])})"
            (before if rows[name][key] > rows[best][key] else behind).append(phrase)
    parts = [
        f"{where} {', '.join(phrases)}"
        for where, phrases in (("ahead in", before), ("behind in", behind))
        if phrases
    ]
    return f"*{name}* is {' and '.join(parts)}."


def packages(errors: dict[str, str]) -> str:
    """Versions, licences and outputs of the tools, and which tools could not run."""
    lines = ["## The tools\n", "| row | package | licence | what its map sees |", "| --- | --- | --- | --- |"]
    lines += [f"| {t.row} | {t.package} | {t.licence} | {t.outputs} |" for t in TOOLS]
    lines += ["", "The command fetches them by name; nothing of them is part of this repository."]
    lines += ["facegood_zh has no text, so openfacefx has no row with one there."]
    lines += [f"Not all could run, {name}: {error}" for name, error in errors.items()]
    return "\n".join(lines) + "\n"
