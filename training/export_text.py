"""Writes the text space and the tower as the model folder that Rust reads.

    python -m training.export_text --text runs/text --models weights/cafe-talk

model.safetensors is f16; config.json holds the words of the space, in the order of their places, and the
lists by which a sentence is taken apart. The model card, README.md, is written by hand. A tower that was
trained with `--clip FOLDER` is exported with the same, and config.json names the folder: CLIP itself stays
where it is.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import torch
from torch import Tensor

from training.corpus.conditions import UNITS
from training.export import write_model
from training.text.clip import ClipTower
from training.text.pairs import MENU
from training.text.sentences import RULES, STRENGTH
from training.text.tower import FULL, NO_WORD, TextTower
from training.text.words import Words


def arrays(tower: TextTower | ClipTower, words: Words) -> dict[str, Tensor]:
    """`vectors` [W, D], `ngrams` [G, D], `emotions` [15, D] and the tower's layers."""
    space = {"vectors": words.vectors, "ngrams": words.ngrams, "emotions": words.emotions()}
    return {k: torch.from_numpy(v) for k, v in space.items()} | tower.state_dict()


def config(tower: TextTower | ClipTower, words: Words, clip: Path | None = None) -> dict:
    """Sizes, words and lists, and where CLIP lies."""
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


def main() -> None:
    """Entry of the command."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--text", type=Path, default=Path("runs/text"))
    parser.add_argument("--models", type=Path, default=Path("weights/cafe-talk"))
    parser.add_argument("--clip", type=Path, help="as in training; seen from the model's folder if relative")
    arguments = parser.parse_args()
    words, state = Words.load(arguments.text), torch.load(arguments.text / "tower.pt")
    hidden, width = state["down.weight"].shape
    tower = ClipTower(width, hidden) if arguments.clip else TextTower(words.vectors.shape[1], hidden)
    tower.load_state_dict(state)
    about = config(tower, words, arguments.clip)
    write_model(arguments.models / "text_units", arrays(tower, words), about)


if __name__ == "__main__":
    main()
