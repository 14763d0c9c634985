"""Reads WordNet's words, senses and relations from files in its own format (`wndb(5WN)`).

WordNet 3.0, Princeton University; Debian's package `wordnet-base` installs it in /usr/share/wordnet.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from pathlib import Path

FILES = {"n": "data.noun", "v": "data.verb", "a": "data.adj", "r": "data.adv"}
PLACE = Path("/usr/share/wordnet")
HEAD_COLUMNS = 4


@dataclass
class Synset:
    """One meaning: its words, in WordNet's order, and its definition."""

    words: list[str]
    gloss: str
    pointers: list[Pointer] = field(default_factory=list)


@dataclass(frozen=True)
class Pointer:
    """A relation (`!` antonym, `@` hypernym, …) to another meaning.

    It ties two words if `word` and `target_word`, their numbers from 1, are both over 0.
    """

    relation: str
    target: str
    word: int
    target_word: int


def read(folder: Path = PLACE) -> dict[str, Synset]:
    """All meanings, keyed by part of speech and offset in the file, such as `n02084071`.

    Raises `FileNotFoundError` with the package to install if WordNet is missing.
    """
    missing = [name for name in FILES.values() if not (folder / name).is_file()]
    if missing:
        raise FileNotFoundError(f"{folder}: expected WordNet's {missing[0]} (Debian: wordnet-base)")
    synsets = {}
    for part, name in FILES.items():
        with open(folder / name, encoding="utf-8") as file:
            synsets |= dict(_synset(part, line) for line in file if not line.startswith("  "))
    return synsets


def _synset(part: str, line: str) -> tuple[str, Synset]:
    data, _, gloss = line.partition(" | ")
    columns = data.split()
    count = int(columns[HEAD_COLUMNS - 1], 16)
    words = [plain(w) for w in columns[HEAD_COLUMNS : HEAD_COLUMNS + 2 * count : 2]]
    at = HEAD_COLUMNS + 2 * count
    pointers = []
    for start in range(at + 1, at + 1 + 4 * int(columns[at]), 4):
        relation, offset, target_part, ends = columns[start : start + 4]
        ends = int(ends[:2], 16), int(ends[2:], 16)
        pointers.append(Pointer(relation, f"{target_part}{offset}", *ends))
    return f"{part}{columns[0]}", Synset(words, gloss.strip(), pointers)


def plain(word: str) -> str:
    """The word in lower case, without the mark of an adjective's position (`afraid(p)`)."""
    return re.sub(r"\(\w+\)$", "", word).lower()


def counts(folder: Path = PLACE) -> dict[tuple[str, str], int]:
    """How often each `(word, part)` occurs in WordNet's tagged texts, summed over its meanings."""
    totals: dict[tuple[str, str], int] = {}
    parts = {"1": "n", "2": "v", "3": "a", "4": "r", "5": "a"}
    with open(folder / "cntlist.rev", encoding="utf-8") as file:
        for line in file:
            key, _, times = line.split()
            word, _, sense = key.partition("%")
            at = word.lower(), parts[sense[0]]
            totals[at] = totals.get(at, 0) + int(times)
    return totals
