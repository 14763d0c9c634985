"""Measures how well text becomes units, on table 13 and held-out descriptions, and compares baselines.

    python -m training.text.measure --wordnet /usr/share/wordnet

measures the shipped model; `--model FOLDER` measures another.
"""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
import torch

from training import shipped
from training.flags import run_command
from training.text import wordnet
from training.text.clip import ClipTower, OnClip
from training.text.held_out import HELD_OUT, TABLE_13
from training.text.pairs import EMOTIONS, EXPRESSIONS
from training.text.sentences import Shown, clauses, listed
from training.text.space import known_form
from training.text.stored import load_model_folder
from training.text.tower import OnWords, TextTower
from training.text.words import Words

SHIPPED = shipped("text_units")
THRESHOLD = 0.5
Pair = tuple[str, Shown]


@dataclass
class Counts:
    """Counts of units: rightly found, wrongly found, and missed."""

    right: int = 0
    wrong: int = 0
    missed: int = 0

    def add(self, predicted: set[int], true: set[int]) -> None:
        """Counts one text."""
        self.right += len(predicted & true)
        self.wrong += len(predicted - true)
        self.missed += len(true - predicted)

    @property
    def f1(self) -> float:
        """F1 over all units together."""
        return 2 * self.right / max(2 * self.right + self.wrong + self.missed, 1)


@torch.no_grad()
def understood(tower: TextTower | ClipTower, hearing: OnWords | OnClip, text: str) -> set[int]:
    """Numbers of the units that any clause shows. A clause without a meaningful word shows none."""
    said = [clause for clause in clauses(text) if clause.words or clause.denied]
    if not said:
        return set()
    shares = torch.sigmoid(tower(hearing.hear(said))[:, 0])
    return set(torch.nonzero((shares > THRESHOLD).any(dim=0)).flatten().tolist())


class Nearest:
    """Baseline: units of the training text with the nearest mean word vector. Denials are ignored."""

    def __init__(self, known: list[Pair], words: Words):
        self.known, self.words = known, words
        places = np.stack([self.place(text) for text, _ in known])
        self.places = places / np.maximum(np.linalg.norm(places, axis=1, keepdims=True), 1e-6)

    def place(self, text: str) -> np.ndarray:
        """Mean of a text's words, [D]."""
        said = [self.words.of(w) for c in clauses(text) for w in c.words + c.denied]
        return np.mean(said, axis=0) if said else np.zeros(self.words.vectors.shape[1], np.float32)

    def units(self, text: str) -> set[int]:
        """Units of the nearest text."""
        return set(self.known[int(np.argmax(self.places @ self.place(text)))][1].units)


class Synonyms:
    """Baseline without a text space: units of a training word that shares a meaning in WordNet."""

    def __init__(self, known: list[Pair], folder: Path):
        single = ((c.words, shown) for text, shown in known for c in clauses(text)[:1])
        self.shown = {words[0]: set(shown.units) for words, shown in single if len(words) == 1}
        self.meanings: dict[str, list[list[str]]] = {}
        for synset in wordnet.read(folder).values():
            for word in synset.words:
                self.meanings.setdefault(word, []).append(synset.words)

    def units(self, text: str) -> set[int]:
        """Units of the first such word; empty if there is none."""
        for word in (w for c in clauses(text) for w in c.words + c.denied):
            meanings = self.meanings.get(known_form(word, self.meanings), [])
            alike = [other for words in meanings for other in words]
            units = next((self.shown[w] for w in (word, *alike) if w in self.shown), None)
            if units:
                return units
        return set()


def measured(
    tower: TextTower | ClipTower,
    hearing: OnWords | OnClip,
    words: Words,
    known: list[Pair],
    held_out: list[Pair],
    place: Path | None = None,
) -> dict:
    """F1 of the tower and the baselines, the number of texts with every unit right, and the result on table
    13.

    `words`: the text space for `Nearest`. `place`: WordNet's folder for `Synonyms`, which None leaves out.
    """
    beside = {"nearest_text": Nearest(known, words)} | ({"synonym": Synonyms(known, place)} if place else {})
    ours, floors = Counts(), {name: Counts() for name in beside}
    whole, silent = 0, []
    for text, shown in held_out:
        true, predicted = set(shown.units), understood(tower, hearing, text)
        ours.add(predicted, true)
        for name, floor in beside.items():
            floors[name].add(floor.units(text), true)
        whole += predicted == true
        silent += [not predicted] if not true else []
    table = [understood(tower, hearing, t) == set(Shown.read(u).units) for t, u in TABLE_13.items()]
    return (
        {"f1": round(ours.f1, 3)}
        | {name: round(counts.f1, 3) for name, counts in floors.items()}
        | {
            "whole": f"{whole} of {len(held_out)}",
            "silent": f"{sum(silent)} of {len(silent)}",
            "table_13": f"{sum(table)} of {len(table)}",
        }
    )


def main(
    model: Annotated[Path, "model folder"] = SHIPPED,
    wordnet: Annotated[Path | None, "WordNet's folder, to compare with its synonyms"] = None,
) -> dict:
    """Prints how well a model folder recognises the held-out texts and table 13."""
    words, tower = load_model_folder(model)
    known = listed(EMOTIONS) + listed(EXPRESSIONS)
    result = measured(tower, OnWords(words), words, known, listed(HELD_OUT), wordnet)
    print(json.dumps(result, indent=1))
    return result


if __name__ == "__main__":
    run_command(main)
