"""Writes the paper's tables and figures for corpus folders, as one page.

    python -m training.paper --corpus DIR [DIR ...] --anyface target/release/anyface --out PAGE.md

`--options` are passed to every call of the command, for example `--options=--weights=mine`. `--ablations`
adds rows for models that were trained with a part left out (`training.paper.ablations`).
"""

import json
import math
import tempfile
from pathlib import Path
from textwrap import fill
from typing import Annotated

from training.corpus.folder import CorpusFolder
from training.engine import Engine
from training.flags import run_command
from training.paper.metrics import NAMES
from training.paper.printed import combinations, printed
from training.paper.tables import Table, landmark_table, mesh_tables

UNITS = {"LVE": "mm²", "EVE": "mm²", "MVE": "mm", "FDD": "mm²", "DTW": "mm", "DFD": "mm", "δM": "mm²"}
HEAD = """# The paper's tables, made here

What FreeTalk's tables 2 and 3 measure (LVE, EVE, MVE, FDD, DTW, DFD, δM, δCd; definitions in
`training/paper/metrics.py`), on the corpora named below instead of MEAD-EMOTE, VOCAset, BIWI and Multiface,
none of which are at hand. `python -m training.paper` makes the same page of any
[corpus folder](../training.md); with those sets in such folders it measures the paper's own tables.
Held-out clips, 25 fps, at most 10 s of each; lower is better, of FDD nearer to 0. Motion is not scaled, and
"nothing moves" is what a still face would get. The paper's table 4 and its NJF and MLP decoders (part of its
figure 6) are not made: Anyface has neither PoissonNet nor Jacobian fields. Ablations of
Sparse-To-Mesh see every fifth frame of all held-out stretches of a face, joined: their DTW, DFD, δM and δCd
compare with each other, not with other tables.
MVE is the mean distance over vertices and frames, as the public code of the field has it; the paper's text
says the maximum.
"""


def page(
    tables: list[Table], ablated: list[Table], figures: list[tuple[Path, str]], out: Path, command: str
) -> str:
    """The whole page."""
    parts = [HEAD, f"```\n{command}\n```\n"]
    for table in [*tables, *ablated]:
        parts.append(f"## {table.corpus}: {table.what}\n\n{table.clips} clips, {table.points} points.\n")
        parts.append(rows_of(table))
    if figures:
        parts.append("## Figures\n")
    for figure, numbers in figures:
        parts.append(f"![{CAPTIONS[figure.stem]}]({figure.relative_to(out.parent)})\n")
        parts += [fill(numbers, 100) + "\n"] if numbers else []
    return "\n".join([*parts, combinations(ablated), printed()]).rstrip() + "\n"


CAPTIONS = {
    "decoder_errors": "Figure 6 of the paper: true landmark motion through each decoder, how far it is off",
    "attention": "Figure 7 of the paper: the share of its attention that each vertex gives to a landmark",
}


def rows_of(table: Table) -> str:
    """A Markdown table."""
    heads = " | ".join(f"{name} {UNITS.get(name, '')}".strip() for name in NAMES)
    lines = [f"| | {heads} |", "| --- |" + " --- |" * len(NAMES)]
    for name, scores in table.rows.items():
        cells = " | ".join("–" if math.isnan(scores[m]) else f"{scores[m]:.3g}" for m in NAMES)
        lines.append(f"| {name} | {cells} |")
    return "\n".join(lines) + "\n"


def main(
    corpus: Annotated[list[Path], "corpus folders"],
    anyface: Path = Path("target/release/anyface"),
    options: Annotated[list[str], "options of every call"] = (),
    ablations: Annotated[Path | None, "folder that training.paper.ablations wrote"] = None,
    clips: Annotated[int, "held-out clips of each folder"] = 20,
    out: Path = Path("docs/measured/paper.md"),
) -> None:
    """Entry of the command."""
    engine = Engine(anyface.resolve(), options)
    tables, figures = [], []
    for path in corpus:
        folder = CorpusFolder(path)
        print(f"{folder.name}: sound to landmarks", flush=True)
        table = landmark_table(folder, engine, clips)
        tables += [table] if table else []
        if any(folder.file("vertices", row, (".npy", ".npz", "")) for row in folder.rows if row.held_out):
            print(f"{folder.name}: sound and landmarks to mesh", flush=True)
            tables += mesh_tables(folder, engine, clips)
            if not figures:
                from training.paper.figures import draw

                with tempfile.TemporaryDirectory() as place:
                    figures = draw(folder, engine, Path(place), out.parent / "images/paper")
    ablated = []
    if ablations:
        rows = json.loads((ablations / "scores.json").read_text())
        ablated = [Table(**table) for table in rows]
    command = f"python -m training.paper --corpus {' '.join(map(str, corpus))} --clips {clips}"
    command += f" --ablations {ablations}" if ablations else ""
    out.write_text(page(tables, ablated, figures, out, command), encoding="utf-8")
    print(out)


if __name__ == "__main__":
    run_command(main)
