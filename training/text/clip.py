"""Cafe-Talk's own tower (Chen et al. 2025, appendix E): an adapter on the text features of CLIP.

The user supplies CLIP as a Hugging Face folder.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import torch
import torch.nn as nn
import torch.nn.functional as F
from torch import Tensor
from transformers import CLIPTextModelWithProjection, CLIPTokenizer

from training.corpus.conditions import UNITS
from training.text.sentences import Clause
from training.text.words import TextPlaces

AT_ONCE = 256
"""Number of texts that are encoded in one batch."""


class OnClip:
    """Encodes clauses for the tower, with the frozen text tower of CLIP."""

    def __init__(self, folder: Path):
        self.tokens = CLIPTokenizer.from_pretrained(folder)
        self.model = CLIPTextModelWithProjection.from_pretrained(folder).eval()
        self.most = self.model.config.max_position_embeddings
        self.known: dict[str, Tensor] = {}

    def hear(self, clauses: list[Clause], noise: float = 0.0) -> Tensor:
        """Features [N, D] of length 1, with random noise added if `noise` is not 0."""
        known = self.places([clause.said for clause in clauses])
        heard = torch.stack([known[clause.said] for clause in clauses])
        return heard + 2.0 * noise * torch.rand(len(heard), 1) * torch.randn_like(heard) if noise else heard

    def tower(self, hidden: int, near: list[Clause]) -> ClipTower:
        """A new tower; `near` is not used."""
        return ClipTower(self.model.config.projection_dim, hidden)

    @torch.no_grad()
    def places(self, texts: list[str]) -> dict[str, Tensor]:
        """Features of each text; texts already encoded are remembered."""
        new = sorted(set(texts) - self.known.keys())
        for first in range(0, len(new), AT_ONCE):
            some = new[first : first + AT_ONCE]
            inputs = self.tokens(
                some, padding=True, truncation=True, max_length=self.most, return_tensors="pt"
            )
            self.known.update(zip(some, F.normalize(self.model(**inputs).text_embeds, dim=-1), strict=True))
        return self.known


class ClipWords(TextPlaces):
    """Vectors of words in CLIP's space, of length 1: `C_emo` of Cafe-Talk as the paper has it (§3.1.1)."""

    def __init__(self, folder: Path):
        self.clip = OnClip(folder)

    @property
    def width(self) -> int:
        """Length D of a vector."""
        return self.clip.model.config.projection_dim

    def of(self, word: str) -> np.ndarray:
        """Vector of one word, [D]."""
        return self.clip.places([word])[word].numpy()


class ClipTower(nn.Module):
    """Features to logits, as in the paper: a bottleneck of two layers with a residual, and a head."""

    def __init__(self, width: int, hidden: int):
        super().__init__()
        self.down = nn.Linear(width, hidden)
        self.up = nn.Linear(hidden, width)
        self.head = nn.Linear(width, 3 * len(UNITS))

    def adapted(self, features: Tensor) -> Tensor:
        """Features after the bottleneck, [N, D]."""
        return features + self.up(F.relu(self.down(features)))

    def forward(self, features: Tensor) -> Tensor:
        """Logits [N, 3, 16] with the same meaning as in `training.text.tower`."""
        return self.head(self.adapted(features)).unflatten(-1, (3, len(UNITS)))
