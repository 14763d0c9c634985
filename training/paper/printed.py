"""Numbers that the FreeTalk paper prints, to compare with our measurements.

Tables 2, 3 and 5 of Nocentini et al. 2026, arXiv 2603.15512v1. The tables state no units. The text calls MVE
a maximum, while the code of its predecessors takes the mean. So only δCd of tables 2 and 3, which has no
unit, can be compared. For table 5 we compare shares of the whole model's LVE.
"""

from statistics import mean

from training.paper.tables import Table

COLUMNS = ("LVE", "MVE", "FDD", "DTW", "DFD", "δM", "δCd")
FREETALK = {
    "MEAD-EMOTE (table 2, trained on it)": (13.8, 2.27, 5.12, 2.60, 11.0, 3.25, 0.81),
    "VOCAset (table 3, 3,4,5 + 3,4,5)": (3.05, 0.95, 1.85, 1.60, 5.16, 0.31, 0.69),
    "BIWI6 (the same)": (4.44, 2.17, 30.0, 1.53, 6.87, 1.11, 0.63),
    "Multiface (the same)": (3.19, 1.92, 14.3, 1.14, 5.29, 0.46, 0.76),
}
"""FreeTalk's own rows in tables 2 and 3: one value for each of `COLUMNS`."""
COMBINATIONS = {"Concat.": 0.0035, "CA": 0.0025, "CA + Concat.": 0.0023, "GCN + CA + Concat.": 0.0021}
"""Table 5: LVE of Sparse-To-Mesh for each way to combine landmarks and surface."""
WHOLE = "STM, whole"
OURS = {
    "Concat.": "without cross-attention",
    "CA + Concat.": "without the landmark graph",
    "GCN + CA + Concat.": WHOLE,
}
"""Our variant for each row of table 5. We have none for `CA`, attention without concatenation."""


def printed() -> str:
    """FreeTalk's printed rows as a Markdown section."""
    lines = [
        "## What the paper prints\n",
        "FreeTalk's own rows, as printed: without units, on vertices of MEAD-EMOTE, VOCAset, BIWI and",
        "Multiface, which are not at hand. Other recordings, faces and regions of lips: only the order of",
        "magnitude of δCd, which has no unit, may be read across.\n",
        "| | " + " | ".join(COLUMNS) + " |",
        "| --- |" + " --- |" * len(COLUMNS),
    ]
    lines += [f"| {name} | " + " | ".join(f"{x:g}" for x in row) + " |" for name, row in FREETALK.items()]
    return "\n".join(lines) + "\n"


SEED = ", seed "
"""In the name of a row, this separates the variant from the seed of its training."""


def by_seed(rows: dict[str, dict[str, float]], name: str) -> list[float]:
    """LVE of each training of a variant."""
    return [scores["LVE"] for row, scores in rows.items() if row.split(SEED)[0] == name]


def combinations(ablated: list[Table]) -> str:
    """Table 5 beside our variants, both as shares of the whole model's LVE; empty without our variants."""
    rows = next((table.rows for table in ablated if by_seed(table.rows, WHOLE)), None)
    if rows is None:
        return ""
    whole = by_seed(rows, WHOLE)
    spread = f" Means of {len(whole)} seeds, lowest and highest behind them." if len(whole) > 1 else ""
    lines = [
        "## Table 5 of the paper\n",
        "LVE over that of the whole model: printed (30 epochs on part of the paper's corpora; whether of",
        "distances or their squares it does not say), and here (squares; as many steps as the heading above",
        f"says). Models that have just begun to train tell of the beginning of training alone.{spread}\n",
        "| | printed | here |",
        "| --- | --- | --- |",
    ]
    for name, lve in COMBINATIONS.items():
        ours = [lve / mean(whole) for lve in by_seed(rows, OURS.get(name, ""))]
        here = f"{mean(ours):.2f}" if ours else "–"
        here += f" ({min(ours):.2f} to {max(ours):.2f})" if len(ours) > 1 else ""
        lines.append(f"| {name} | {lve / COMBINATIONS['GCN + CA + Concat.']:.2f} | {here} |")
    return "\n".join(lines) + "\n"
