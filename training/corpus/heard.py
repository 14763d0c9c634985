"""The ear's features of speech, with its phones, its text or the times of its words."""

import json
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from training.corpus.aligned import (
    ALPHABETS,
    HELD_OUT_EVERY,
    UNSEEN_LANGUAGES,
    Utterance,
    grid_words,
    kokoro_count,
    read_kokoro,
    read_librivox,
    read_nathalie,
    read_texts,
    speak,
)
from training.corpus.cache import cached, digest
from training.corpus.clip import FPS, MEL_PER_FRAME, read_sound
from training.corpus.espeak import Espeak
from training.corpus.phones import PAUSE, Phone, segment_track
from training.speech.ear import Ear, ear_mel, ear_mel_of_power
from training.speech.log_mel import SAMPLE_RATE_HZ, power_spectrum

WARPS = (0.86, 1.0)
"""Factors on a voice's frequencies: 0.86 imitates a man's vocal tract, 1 keeps the voice's own."""

VERSION = 3
EMODB_HELD_OUT = ("03", "08")
"""Actors whom training never hears: a man and a woman out of ten."""

SAMPA = {
    "E": "ɛ", "6": "ɐ", "I": "ɪ", "S": "ʃ", "X": "x", "x": "x", "N": "ŋ", "@": "ə", "O": "ɔ", "Y": "ʏ",
    "9": "œ", "2": "ø", "Q": "ʔ", "?": "ʔ", "C": "ç", "R": "ʁ", "r": "ʁ", "U": "ʊ", "Z": "ʒ", "g": "ɡ",
}  # fmt: skip
TEXT_EVERY = 2
"""One in this many recordings with text is used: kathleen reads some sentences more than once."""

TEXTS = {"en-us": "kathleen_en", "de": "kerstin_de", "nl": "nathalie_nl"}


@dataclass
class Heard:
    """One utterance. `features` holds [T, C] f16 for each warp; `phones` is [4 T] segments or None."""

    name: str
    source: str
    held_out: bool
    features: list[Tensor]
    phones: Tensor | None
    text: str = ""
    words: list[tuple[float, float, str]] = field(default_factory=list)


@torch.no_grad()
def hear(ear: Ear, samples: np.ndarray, warps: tuple[float, ...]) -> list[Tensor]:
    """Features [T, C] f16 of a sound [S] in each warp."""
    sound, frames = torch.from_numpy(samples), max(len(samples) * int(FPS) // SAMPLE_RATE_HZ, 1)
    power = None if warps == (1.0,) else power_spectrum(sound)
    mels = [ear_mel(sound) if warp == 1.0 else ear_mel_of_power(power, warp) for warp in warps]
    return [ear(mel, frames).half() for mel in mels]


def load(data: Path, cache: Path, ear: Ear, minutes: float) -> list[Heard]:
    """All utterances, from the cache if it has them."""
    weights = sum(float(x.double().abs().sum()) for x in ear.body.parameters())
    path = cache / f"heard-{digest(VERSION, minutes, weights, *kokoro_count(data))}.pt"
    return cached(path, Heard, lambda: _every(data, ear, minutes))


def _every(data: Path, ear: Ear, minutes: float):
    for u in read_nathalie(data):
        heard = _of(ear, u, WARPS)
        heard.text = " ".join(word for _, _, word in u.words)
        yield heard
    for u in read_emodb(data):
        yield _of(ear, u, WARPS)
    for u in read_kokoro(data):
        yield _of(ear, u, (1.0,))
    for u in read_librivox(data):
        heard = _of(ear, u, (1.0,))
        heard.text = (data / "clips/librivox" / f"{u.name}.txt").read_text()
        yield heard
    yield from _grid(data, ear)
    for source in ("kathleen_en", "kerstin_de"):
        texts = sorted(read_texts(data / "speech" / source).items())
        for index, (name, text) in enumerate(texts[::TEXT_EVERY]):
            features = hear(ear, read_sound(data / "speech" / source / f"{name}.ogg"), WARPS)
            yield Heard(name, source, index % HELD_OUT_EVERY == 0, features, None, text)
    espeak = Espeak()
    for language in ALPHABETS:
        folder = data / "speech" / TEXTS.get(language, "-")
        texts = list(read_texts(folder).values()) if language in TEXTS else []
        for u in speak(espeak, language, minutes, seed=17, texts=texts):
            u.held_out = u.held_out or language in UNSEEN_LANGUAGES
            yield _of(ear, u, (1.0,))


def _of(ear: Ear, u: Utterance, warps) -> Heard:
    features = hear(ear, u.samples, warps)
    frames = MEL_PER_FRAME * len(features[0])
    track = torch.from_numpy(segment_track(u.phones, frames, 100.0))
    return Heard(u.name, u.source, u.held_out, features, track, words=u.words)


def _grid(data: Path, ear: Ear):
    """Every fourth clip of grid_s1, only to measure on."""
    folder, words = data / "motion/grid_s1", grid_words(data)
    for name in sorted(words)[::4]:
        features = hear(ear, read_sound(folder / "audio" / f"{name}.ogg"), (1.0,))
        text = " ".join(word for _, _, word in words[name])
        yield Heard(name, "grid_s1", True, features, None, text, words[name])


def read_emodb(data: Path) -> list[Utterance]:
    """Ten German actors with hand-labelled segments."""
    folder, utterances = data / "speech/emodb_de", []
    for line in (folder / "labels.jsonl").read_text().splitlines():
        record, phones = json.loads(line), []
        for row in record["labels"]:
            label = _ipa(row["label"])
            # A mark of manner continues the phone before it.
            label = phones[-1].label if label is None and phones else label or PAUSE
            phones.append(Phone(row["start"], row["duration"], label))
        samples = read_sound(folder / f"{record['id']}.ogg")
        if phones:
            samples = samples[: int(16000 * (phones[-1].end_s + 0.3))]
            held_out = record["id"][:2] in EMODB_HELD_OUT
            utterances.append(Utterance(record["id"], "emodb_de", held_out, samples, phones))
    return utterances


def _ipa(label: str) -> str | None:
    """A SAMPA label as IPA; None if the label is not a phone of its own."""
    if label[0] in "-+":
        return None
    if label == ".":
        return PAUSE
    plain = label.lstrip("_!").replace("asp", "").replace("lar", "")
    return "".join(SAMPA.get(sign, sign) for sign in plain if sign.isalnum() or sign in "@?") or None
