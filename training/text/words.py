"""Vectors of words in the text space: known words, inflected words, and others by their letters."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from training.corpus.conditions import EMOTIONS
from training.text.emotions import SYNONYMS
from training.text.space import known_form, ngram_buckets


class TextPlaces(ABC):
    """Vectors of words and of the emotions, from any text encoder."""

    @property
    @abstractmethod
    def width(self) -> int:
        """Length D of a vector."""

    @abstractmethod
    def of(self, word: str) -> np.ndarray:
        """Vector of one word, [D]."""

    def emotions(self) -> np.ndarray:
        """Vectors of the fifteen emotions, [15, D]: the means of their words."""
        return np.stack([np.mean([self.of(w) for w in SYNONYMS[e]], axis=0) for e in EMOTIONS])


@dataclass
class Words(TextPlaces):
    """`rows` of known words, their `vectors` [W, D] and those of the n-grams [BUCKETS, D]."""

    rows: dict[str, int]
    vectors: np.ndarray
    ngrams: np.ndarray
    _found: dict[str, np.ndarray] = field(default_factory=dict, repr=False)

    @staticmethod
    def load(folder: Path) -> Words:
        """Loads what `training.text.space` wrote."""
        file = np.load(folder / "space.npz")
        rows = {str(word): i for i, word in enumerate(file["words"])}
        return Words(rows, file["vectors"].astype(np.float32), file["ngrams"].astype(np.float32))

    @property
    def width(self) -> int:
        """Length D of a vector."""
        return self.vectors.shape[1]

    def of(self, word: str) -> np.ndarray:
        """Vector of one word, [D]: its own, that of its stem, or the mean of its n-grams."""
        if word not in self._found:
            form = known_form(word, self.rows)
            known = form is not None
            self._found[word] = self.vectors[self.rows[form]] if known else self._spelt(word)
        return self._found[word]

    def _spelt(self, word: str) -> np.ndarray:
        return self.ngrams[np.array(ngram_buckets(word)) % len(self.ngrams)].mean(axis=0)
