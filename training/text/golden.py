"""Golden of the text model: a small text space and tower with random numbers, and their output for texts."""

import json
from pathlib import Path

import numpy as np
import torch

from training.goldens import write_golden
from training.text.sentences import clauses
from training.text.stored import arrays, config_of
from training.text.tower import Heard, TextTower
from training.text.words import Words

KNOWN = "anger brow close cry eye fly happy hop laugh lip mouth raise sad smile surprise wink"
TEXTS = (
    "A happy person", "she isn't happy", "raises the left eyebrow, winks and smiles slightly",
    "hopping flies cried", "not laughing but very surprised", "zzyzx", "Wörter für Lächeln", "the",
    "sad;happy", "don’t close your right eye", "smil", "happily", "你好", "huge unhappy lips without anger",
)  # fmt: skip


def random_space() -> Words:
    """A text space of a few words with random vectors."""
    random = np.random.default_rng(5)
    places, ngrams = (random.standard_normal((n, 12)).astype(np.float32) for n in (len(KNOWN.split()), 64))
    return Words({word: row for row, word in enumerate(KNOWN.split())}, places, ngrams)


def write(out: Path, shared: Path) -> Path:
    """`weights.*`; for each text of the metadata, `logits.N` [clauses, 3, 16] and `places.N` [words, D].

    `shared` is not used.
    """
    torch.manual_seed(5)
    words = random_space()
    tower = TextTower(12, 7)
    tensors = {f"weights.{key}": value for key, value in arrays(tower, words).items()}
    with torch.no_grad():
        for number, text in enumerate(TEXTS):
            parts = clauses(text)
            said = [words.of(word) for part in parts for word in part.words + part.denied]
            tensors[f"logits.{number}"] = tower(Heard.of(parts, words))
            tensors[f"places.{number}"] = torch.from_numpy(np.array(said, np.float32).reshape(-1, 12))
    path, config = out / "text_units_debug.safetensors", config_of(tower, words)
    return write_golden(path, tensors, "text_units", None, config, texts=json.dumps(TEXTS))
