"""The text tower of Cafe-Talk (Chen et al. 2025, appendix E) on our own text space.

The paper's tower reads a sentence as CLIP encodes it; this one reads the words of a clause as the text
space places them: their mean, weighed by a learned score, those that are denied apart. Then as printed: a
bottleneck of two layers with a residual, and a head; that also says which units are on one side and how
strong they are.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
import torch.nn as nn
import torch.nn.functional as F
from torch import Tensor

from training.corpus.conditions import UNITS
from training.text.sentences import Clause
from training.text.words import Words

NO_WORD = 0.1
"""Weight of the origin in a clause's mean, so that unknown words leave the features near 0."""

FULL = 1.5
"""Strength at a logit far above 0."""


@dataclass
class Heard:
    """Places of the words [N, L, D] and of the denied ones [N, M, D]; 0 beyond a clause's end."""

    words: Tensor
    denied: Tensor

    @staticmethod
    def of(clauses: list[Clause], words: Words) -> Heard:
        """Looked up in the text space."""
        return Heard(_places([c.words for c in clauses], words), _places([c.denied for c in clauses], words))

    def moved(self, noise: float) -> Heard:
        """At random, each text by its own deviation, `noise` in the mean; what is no word stays 0."""
        for places in (self.words, self.denied):
            there = (places != 0).any(dim=-1, keepdim=True)
            places += 2.0 * noise * torch.rand(len(places), 1, 1) * torch.randn_like(places) * there
        return self


class OnWords:
    """What the tower hears with: the text space."""

    def __init__(self, words: Words):
        self.words = words

    def hear(self, clauses: list[Clause], noise: float = 0.0) -> Heard:
        """Looked up, and moved at random."""
        heard = Heard.of(clauses, self.words)
        return heard.moved(noise) if noise else heard

    def tower(self, hidden: int, near: list[Clause]) -> TextTower:
        """A new one, whose first hidden numbers are nearness to these clauses, denied words unheard."""
        width = self.words.vectors.shape[1]
        tower = TextTower(width, hidden)
        places = np.stack([np.mean([self.words.of(w) for w in clause.words], axis=0) for clause in near])
        with torch.no_grad():
            tower.down.weight[: len(near), :width] = torch.from_numpy(places)
            tower.down.bias[: len(near)] = -0.3
        return tower


def _places(rows: list[list[str]], words: Words) -> Tensor:
    width = words.vectors.shape[1]
    places = np.zeros((len(rows), max([1, *map(len, rows)]), width), np.float32)
    for row, texts in enumerate(rows):
        for column, word in enumerate(texts):
            places[row, column] = words.of(word)
    return torch.from_numpy(places)


class TextTower(nn.Module):
    """Clauses to logits. `width`: D of the text space."""

    def __init__(self, width: int, hidden: int):
        super().__init__()
        self.score = nn.Linear(width, 1)
        self.down = nn.Linear(2 * width, hidden)
        self.up = nn.Linear(hidden, 2 * width)
        self.head = nn.Linear(2 * width, 3 * len(UNITS))

    def mean(self, places: Tensor) -> Tensor:
        """[N, L, D] to [N, D]."""
        there = (places != 0).any(dim=-1, keepdim=True)
        weight = torch.sigmoid(self.score(places)) * there
        return (weight * places).sum(dim=1) / (weight.sum(dim=1) + NO_WORD)

    def adapted(self, heard: Heard) -> Tensor:
        """Features of clauses, [N, 2 D]."""
        x = torch.cat([self.mean(heard.words), self.mean(heard.denied)], dim=-1)
        return x + self.up(F.relu(self.down(x)))

    def forward(self, heard: Heard) -> Tensor:
        """Logits [N, 3, 16]: the unit shows; it does on one side alone; its strength, of `FULL`."""
        return self.head(self.adapted(heard)).unflatten(-1, (3, len(UNITS)))
