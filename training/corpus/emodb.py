"""Acted speech: emodb_de, ten actors saying the same ten sentences in seven emotions (Burkhardt et al. 2005).

Whole actors are held out, a woman and a man. Boredom is the project's `calm`.
"""

import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from training.corpus.acted import clips_of, read_rows
from training.corpus.clip import read_sound
from training.corpus.phones import PAUSE, Phone

SOURCE = "emodb_de"
HELD_OUT = ("09", "12")
"""Actors whom no training hears, a woman and a man."""
NAMES = {
    "anger": "angry",
    "happiness": "happy",
    "fear": "afraid",
    "sadness": "sad",
    "disgust": "disgusted",
    "boredom": "calm",
    "neutral": "neutral",
}
SAMPA = {
    "a": "a", "A": "ɑ", "E": "ɛ", "e": "e", "I": "ɪ", "i": "i", "O": "ɔ", "o": "o", "U": "ʊ", "u": "u",
    "Y": "ʏ", "y": "y", "9": "œ", "2": "ø", "@": "ə", "6": "ɐ", "8": "ɵ", "4": "ɾ", "aI": "aɪ", "aU": "aʊ",
    "OY": "ɔʏ", "AU": "ɑʊ", "AO": "aɔ", "aO": "aɔ", "ao": "ao", "OU": "ɔʊ", "E6": "ɛɐ", "a6": "aɐ",
    "i6": "iɐ",
    "I6": "ɪɐ", "Y6": "ʏɐ", "@6": "ɐ", "I@": "ɪə", "i@": "iə", "ia": "ia", "@E": "əɛ", "@O": "əɔ",
    "p": "p", "b": "b", "t": "t", "d": "d", "k": "k", "g": "ɡ", "m": "m", "n": "n", "N": "ŋ", "f": "f",
    "v": "v", "V": "ʋ", "s": "s", "z": "z", "S": "ʃ", "Z": "ʒ", "C": "ç", "x": "x", "X": "χ", "h": "h",
    "H": "ɦ", "j": "j", "l": "l", "L": "l", "r": "r", "R": "ʁ", "B": "β", "D": "ð", "G": "ɣ", "?": "ʔ",
    "nn": "n", "NN": "ŋ", "ss": "s", "vv": "v",
}  # fmt: skip
"""EmoDB's signs → IPA. EmoDB has no separate signs for long vowels."""
ASPIRATED = "asp"
MODIFIERS = ("+", "-", "(", "[", "hoe")


@dataclass
class ActedSpeech:
    """A recording. `emotion` has the project's name; `share` of the listeners recognised it, 0 to 1."""

    name: str
    actor: str
    sentence: str
    emotion: str
    share: float
    held_out: bool
    samples: np.ndarray
    phones: list[Phone]


def read_acted(data: Path, limit: int | None = None) -> list[ActedSpeech]:
    """All recordings, or the first `limit` of the training actors and as many of the held-out ones."""
    folder, recordings, counts = data / "speech" / SOURCE, [], {True: 0, False: 0}
    labels = {}
    for line in (folder / "labels.jsonl").read_text().splitlines():
        record = json.loads(line)
        labels[record["id"]] = record["labels"]
    for row in read_rows(folder):
        held_out = row["actor"] in HELD_OUT
        if limit is not None and counts[held_out] >= limit:
            continue
        counts[held_out] += 1
        name = row["clip"]
        samples = read_sound(folder / f"{name}.ogg")
        recordings.append(ActedSpeech(name, row["actor"], row["sentence"], NAMES[row["feeling"]],
                          float(row["recognised_percent"]) / 100.0, held_out, samples,
                          phones_of(labels.get(name, []))))  # fmt: skip
    return recordings


def held_out_clips(data: Path) -> Iterator[tuple[str, str, Path]]:
    """Actor, emotion and sound of the clips that no training hears, by actor."""
    return clips_of(data / "speech" / SOURCE, HELD_OUT, "feeling", NAMES)


def phones_of(labels: list[dict]) -> list[Phone]:
    """Phones from labels with start, duration and SAMPA. Closure and burst of a plosive become one phone."""
    phones: list[Phone] = []
    for label in labels:
        start, end, text = label["start"], label["start"] + label["duration"], label["label"]
        sign = _sign(text)
        continues = bool(phones) and start - phones[-1].end_s < 1e-3
        if sign is None or (sign == PAUSE and not continues):
            continue
        if continues and (sign == PAUSE or text[0] == "!" and phones[-1].label == sign or ASPIRATED in text):
            phones[-1] = Phone(phones[-1].start_s, end - phones[-1].start_s, phones[-1].label)
        elif sign != PAUSE:
            phones.append(Phone(start, end - start, sign))
    return phones


def _sign(text: str) -> str | None:
    """IPA of a label: a pause for a sign that modifies the phone before it, and for an unknown sign."""
    if text.startswith(MODIFIERS) or text in ("!", ""):
        return PAUSE
    plain = text.lstrip("_!").split("+")[0].split("-")[0].removesuffix(ASPIRATED)
    return SAMPA.get(plain, PAUSE)
