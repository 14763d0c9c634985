"""The text tower of Cafe-Talk (Chen et al. 2025, appendix E) on our own text space.

The paper's tower reads a sentence that CLIP encoded. This one reads the vectors of a clause's words in the
text space: their mean, weighted by a learned score, and a separate mean for denied words. A bottleneck of two
layers with a residual follows, then a head, both as in the paper. The head also predicts which units are on
one side and how strong they are.
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
"""Weight of the origin in a clause's mean. It keeps the features of unknown words near 0."""

FULL = 1.5
"""Strength of a unit whose strength logit is far above 0, where the sigmoid is 1."""


@dataclass
class Heard:
    """Vectors of the words [N, L, D] and of the denied words [N, M, D]; 0 beyond a clause's end."""

    words: Tensor
    denied: Tensor

    @staticmethod
    def of(clauses: list[Clause], words: Words) -> Heard:
        """Looks the words up in the text space."""
        return Heard(_places([c.words for c in clauses], words), _places([c.denied for c in clauses], words))

    def moved(self, noise: float) -> Heard:
        """Adds noise in place. Each text has its own deviation, `noise` on average; padding stays 0."""
        for places in (self.words, self.denied):
            there = (places != 0).any(dim=-1, keepdim=True)
            places += 2.0 * noise * torch.rand(len(places), 1, 1) * torch.randn_like(places) * there
        return self


class OnWords:
    """Encodes clauses for the tower, with the text space."""

    def __init__(self, words: Words):
        self.words = words

    def hear(self, clauses: list[Clause], noise: float = 0.0) -> Heard:
        """Looks the words up and adds noise to their vectors."""
        heard = Heard.of(clauses, self.words)
        return heard.moved(noise) if noise else heard

    def tower(self, hidden: int, near: list[Clause]) -> TextTower:
        """A new tower. Its first hidden units measure nearness to the meaningful words of `near`."""
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
        """Weighted mean of word vectors, [N, L, D] to [N, D]."""
        there = (places != 0).any(dim=-1, keepdim=True)
        weight = torch.sigmoid(self.score(places)) * there
        return (weight * places).sum(dim=1) / (weight.sum(dim=1) + NO_WORD)

    def adapted(self, heard: Heard) -> Tensor:
        """Features of clauses, [N, 2 D]."""
        x = torch.cat([self.mean(heard.words), self.mean(heard.denied)], dim=-1)
        return x + self.up(F.relu(self.down(x)))

    def forward(self, heard: Heard) -> Tensor:
        """Logits [N, 3, 16]: does a unit show, is it on one side only, its strength as a share of `FULL`."""
        return self.head(self.adapted(heard)).unflatten(-1, (3, len(UNITS)))
