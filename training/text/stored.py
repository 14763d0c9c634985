"""Reads the text space and the tower from a run or a model folder, and lists what such a folder stores."""

import json
from pathlib import Path

import torch
from torch import Tensor

from training.corpus.conditions import UNITS
from training.nn.checkpoint import read_model, restored
from training.text.clip import ClipTower, ClipWords
from training.text.pairs import MENU
from training.text.sentences import RULES, STRENGTH
from training.text.tower import FULL, NO_WORD, TextTower
from training.text.words import TextPlaces, Words


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


def load_places(folder: Path) -> TextPlaces:
    """Vectors of words from a text space, from a model folder on one, or from a Hugging Face folder of CLIP.

    Raises `ValueError` for any other folder.
    """
    if (folder / "space.npz").is_file():
        return Words.load(folder)
    config = folder / "config.json"
    kinds = json.loads(config.read_text()) if config.is_file() else {}
    if kinds.get("model") == "text_units":
        return load_model_folder(folder)[0]
    if str(kinds.get("model_type", "")).startswith("clip"):
        return ClipWords(folder)
    got = f"a config.json of {kinds.get('model') or kinds.get('model_type')}" if kinds else "neither file"
    raise ValueError(
        f"--text {folder}: expected space.npz of training.text.space, or config.json of text_units or of "
        f"CLIP, got {got}; leave --text out for the built-in text space"
    )


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
