"""Rows for the ears for emotion: two seconds each of acted clips and of neutral voices.

Listeners' votes are labels beside the actor's intention. Neutral voices are recorded readers and synthetic
voices.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from training.corpus import crema_d
from training.corpus.clip import read_sound
from training.speech.emotion_windows import LEAST, SAMPLES, part, window, windows_of
from training.systems.emoface.emotion_encoder import HEARD_EMOTIONS

MANY_SPEAKERS = "picovoice_en"
"""A source of one clip a speaker."""


@dataclass
class Rows:
    """Rows `x` [N, R] of two seconds each. `label` [N] are indices into `HEARD_EMOTIONS`, `votes` [N, 7]
    shares, `copy` [N] is 0 for the sound itself. `speaker` is unique over all sources."""

    x: Tensor
    source: np.ndarray
    speaker: np.ndarray
    label: np.ndarray
    votes: Tensor
    copy: np.ndarray
    held_out: np.ndarray

    def __len__(self) -> int:
        return len(self.label)


@dataclass
class Sound:
    """Two seconds of a voice, with the corpus and the speaker. `votes` [7]."""

    source: str
    speaker: str
    emotion: str
    votes: np.ndarray
    held_out: bool
    samples: np.ndarray


def sounds(data: Path, kokoro: Path | None) -> Iterator[Sound]:
    """All sounds: acted clips, recorded readers, synthetic voices."""
    for clip in crema_d.read_voted(data):
        votes = np.array([clip.votes.get(name, 0.0) for name in HEARD_EMOTIONS])
        loudest = loudest_part(clip.samples)
        yield Sound(crema_d.SOURCE, clip.actor, clip.emotion, votes, clip.held_out, loudest)
    for number, w in enumerate(windows_of(data, kokoro)):
        speaker = f"{number}" if w.source == MANY_SPEAKERS else w.speaker
        yield Sound(w.source, speaker, w.emotion, certain(w.emotion), w.held_out, w.samples / 32768.0)
    random = np.random.default_rng(2)
    for path in sorted((data / "motion/grid_five/audio").glob("*.ogg")):
        w = window(part(read_sound(path), random), "grid_five", path.stem.split("_")[0], False)
        yield Sound(w.source, w.speaker, w.emotion, certain(w.emotion), False, w.samples / 32768.0)


def certain(emotion: str) -> np.ndarray:
    """All votes for one emotion, [7]."""
    return np.array([float(name == emotion) for name in HEARD_EMOTIONS])


def loudest_part(samples: np.ndarray) -> np.ndarray:
    """The two seconds of a sound [S] that have the most energy."""
    if len(samples) <= SAMPLES:
        return samples
    energy = np.concatenate([[0.0], np.cumsum(samples.astype(np.float64) ** 2)])
    start = int((energy[SAMPLES:] - energy[:-SAMPLES]).argmax())
    return samples[start : start + SAMPLES]


def make_rows(
    data: Path,
    kokoro: Path | None,
    hear: Callable[[Sound, int], np.ndarray],
    copies: Callable[[Sound], int],
) -> Rows:
    """Rows of all sounds and of their copies. `hear` gives the row [R] of a sound or of one of its `copies`,
    which count from 1."""
    columns: list[tuple] = []
    for sound in sounds(data, kokoro):
        if len(sound.samples) < LEAST:
            continue
        about = (sound.source, f"{sound.source} {sound.speaker}", HEARD_EMOTIONS.index(sound.emotion))
        for copy in range(1 + (0 if sound.held_out else copies(sound))):
            columns.append((hear(sound, copy).astype(np.float32), *about, sound.votes, copy, sound.held_out))
            if len(columns) % 2000 == 0:
                print(len(columns), "rows", flush=True)
    x, source, speaker, label, votes, copy, held_out = zip(*columns, strict=True)
    return Rows(
        torch.from_numpy(np.stack(x)).nan_to_num(), np.array(source), np.array(speaker), np.array(label),
        torch.from_numpy(np.stack(votes)).float(), np.array(copy), np.array(held_out),
    )  # fmt: skip


def kept_rows(path: Path, make: Callable[[], Rows]) -> Rows:
    """The rows in `path`, which is written if it does not exist."""
    if not path.exists():
        path.parent.mkdir(parents=True, exist_ok=True)
        torch.save(vars(make()), path)
    return Rows(**torch.load(path, weights_only=False))
