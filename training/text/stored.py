"""Reads the text space and the tower from a run or a model folder, and lists what such a folder stores."""

from pathlib import Path

import torch
from torch import Tensor

from training.corpus.conditions import UNITS
from training.nn.checkpoint import read_model, restored
from training.text.clip import ClipTower
from training.text.pairs import MENU
from training.text.sentences import RULES, STRENGTH
from training.text.tower import FULL, NO_WORD, TextTower
from training.text.words import Words


def load_tower(folder: Path, on_clip: bool) -> tuple[Words, TextTower | ClipTower]:
    """Loads what `training.text.space` and `training.text.train` wrote to a folder."""
    words, state = Words.load(folder), torch.load(folder / "tower.pt")
    hidden, width = state["down.weight"].shape
    tower = ClipTower(width, hidden) if on_clip else TextTower(words.vectors.shape[1], hidden)
    tower.load_state_dict(state)
    return words, tower


def load_model_folder(folder: Path) -> tuple[Words, TextTower]:
    """Loads a model folder on our own text space, as `training.export text` writes it."""
    config, state = read_model(folder)
    if "clip" in config:
        raise ValueError(f"{folder}: expected a model on the text space, got one on CLIP")
    rows = {word: row for row, word in enumerate(config["words"].split())}
    words = Words(rows, state.pop("vectors").numpy(), state.pop("ngrams").numpy())
    tower = {name: value for name, value in state.items() if name != "emotions"}
    return words, restored(TextTower(config["width"], config["hidden"]), tower)


def arrays(tower: TextTower | ClipTower, words: Words) -> dict[str, Tensor]:
    """`vectors` [W, D], `ngrams` [G, D], `emotions` [15, D] and the tower's layers."""
    space = {"vectors": words.vectors, "ngrams": words.ngrams, "emotions": words.emotions()}
    return {k: torch.from_numpy(v) for k, v in space.items()} | tower.state_dict()


def config_of(tower: TextTower | ClipTower, words: Words, clip: Path | None = None) -> dict:
    """Sizes, the words in the order of their vectors, the lists for parsing a sentence, and the path of
    CLIP."""
    heard = {"clip": str(clip)} if clip else {}
    return heard | {
        "model": "text_units",
        "width": words.vectors.shape[1],
        "hidden": tower.down.out_features,
        "ngrams": len(words.ngrams),
        "units": UNITS,
        "no_word": NO_WORD,
        "full": FULL,
        "strength": STRENGTH,
        "rules": RULES,
        "menu": MENU.split(", "),
        "words": " ".join(words.rows),
    }
