"""What the corpora of acted speech share: a folder with `clips.tsv`, and a sound beside it for each row."""

import csv
from collections.abc import Iterator
from pathlib import Path


def read_rows(folder: Path) -> list[dict[str, str]]:
    """The rows of `clips.tsv`."""
    with open(folder / "clips.tsv", newline="") as file:
        return list(csv.DictReader(file, delimiter="\t"))


def clips_of(
    folder: Path, actors: list[str] | tuple[str, ...], column: str, names: dict[str, str]
) -> Iterator[tuple[str, str, Path]]:
    """Actor, emotion and sound of clips of some actors, by actor. `names` has the emotions of `column`."""
    rows = read_rows(folder)
    for actor in actors:
        for row in rows:
            if row["actor"] == actor:
                yield actor, names[row[column]], folder / f"{row['clip']}.ogg"
