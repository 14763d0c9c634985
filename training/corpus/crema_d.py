"""Acted speech: CREMA-D, actors of English saying twelve sentences in six emotions (Cao et al. 2014).

Listeners voted on the sound alone: they name what the actor meant in about four clips of ten.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from training.corpus.acted import clips_of, read_rows
from training.corpus.clip import read_sound

SOURCE = "crema_d"
ACTED = {
    "NEU": "neutral", "ANG": "angry", "HAP": "happy", "FEA": "afraid", "SAD": "sad", "DIS": "disgusted",
}  # fmt: skip
VOTED = {
    "neutral": "neutral", "anger": "angry", "happy": "happy", "fear": "afraid", "sad": "sad",
    "disgust": "disgusted",
}  # fmt: skip
"""Columns of votes, `heard_*` of `clips.tsv`, and the project's names."""
HELD_OUT_EVERY = 15
"""Every fifteenth actor is heard by no training."""


@dataclass
class VotedSpeech:
    """A recording. `votes`: the share of the listeners who named each emotion, by the project's names."""

    name: str
    actor: str
    emotion: str
    votes: dict[str, float]
    held_out: bool
    samples: np.ndarray


def read_voted(data: Path) -> Iterator[VotedSpeech]:
    """All recordings, in the order of `clips.tsv`."""
    folder = data / "speech" / SOURCE
    rows = read_rows(folder)
    kept = held_out(rows)
    for row in rows:
        counts = {ours: int(row[f"heard_{theirs}"]) for theirs, ours in VOTED.items()}
        total = max(sum(counts.values()), 1)
        yield VotedSpeech(row["clip"], row["actor"], ACTED[row["acted"]],
                          {emotion: count / total for emotion, count in counts.items()},
                          row["actor"] in kept, read_sound(folder / f"{row['clip']}.ogg"))  # fmt: skip


def held_out_clips(data: Path) -> Iterator[tuple[str, str, Path]]:
    """Actor, emotion as acted and sound of the clips that no training hears, by actor."""
    folder = data / "speech" / SOURCE
    return clips_of(folder, held_out(read_rows(folder)), "acted", ACTED)


def held_out(rows: list[dict[str, str]]) -> list[str]:
    """The actors whom no training hears, from the rows of `clips.tsv`."""
    return sorted({row["actor"] for row in rows})[HELD_OUT_EVERY - 1 :: HELD_OUT_EVERY]
