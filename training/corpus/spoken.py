"""Speech without a face: recordings with known phones, and seventeen languages spoken by espeak-ng.

It teaches the encoder how the lips move in every voice. With a teacher, the teacher's motion replaces the
missing face (source `taught`). Without one the motion has weight 0.
"""

import hashlib
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import torch

from training.corpus.aligned import (
    ALPHABETS,
    UNSEEN_LANGUAGES,
    Utterance,
    kokoro_count,
    read_kathleen,
    read_kokoro,
    read_librivox,
    read_nathalie,
    read_texts,
    speak,
)
from training.corpus.bank import MEL_HZ, Entry
from training.corpus.cache import cached, digest
from training.corpus.clip import FPS, MEL_PER_FRAME, fit_frames
from training.corpus.decoded import PhoneReader, read_kerstin, read_picovoice
from training.corpus.espeak import Espeak
from training.corpus.phones import segment_track
from training.corpus.teacher import PARAMETERS
from training.speech.log_mel import log_mel

SOURCE = "taught"
TEXTS = {"en-us": "kathleen_en", "en-gb-scotland": "kathleen_en", "de": "kerstin_de", "nl": "nathalie_nl"}
RECORDED = {"nathalie_nl": read_nathalie, "kathleen_en": read_kathleen, "kokoro": read_kokoro}
VERSION = 4


def load(
    data: Path,
    cache: Path,
    minutes: float = 5.0,
    leave_out: tuple[str, ...] = (),
    teacher=None,
    reader: Path | None = None,
) -> list[Entry]:
    """Entries of all speech with phones, from the cache if they were made before.

    espeak-ng speaks `minutes` of each language. `leave_out` names sources (`nathalie_nl`) to skip. `teacher`
    has `motion(phones, frames, fps, random)` [T, 68, 3] metres. `reader` is a run that finds the phones of
    speech without times (see `decoded`).
    """
    read = None if reader is None else hashlib.sha256(reader.read_bytes()).hexdigest()
    taught = None if teacher is None else hashlib.sha256(PARAMETERS.read_bytes()).hexdigest()
    kokoro = [] if "kokoro" in leave_out else kokoro_count(data)
    path = cache / f"spoken-{digest(VERSION, minutes, sorted(leave_out), taught, read, *kokoro)}.pt"

    def entries() -> Iterator[Entry]:
        random = np.random.default_rng(0)
        for utterance in utterances(data, minutes, leave_out, reader):
            yield entry(utterance, teacher, random)

    return cached(path, Entry, entries)


def utterances(data: Path, minutes: float, leave_out: tuple[str, ...], reader: Path | None):
    """Recorded and synthetic speech of the training languages, held-out parts included."""
    for source, read in RECORDED.items():
        if source not in leave_out:
            yield from read(data)
    espeak = Espeak()
    if reader is not None:
        phone_reader = PhoneReader(reader)
        yield from read_kerstin(data, phone_reader, espeak)
        yield from read_picovoice(data, phone_reader)
    for language in ALPHABETS:
        if language in UNSEEN_LANGUAGES or language in leave_out:
            continue
        yield from speak(espeak, language, minutes, seed=0, texts=texts_of(data, language))


def texts_of(data: Path, language: str) -> list[str]:
    """Texts of recorded speech that espeak-ng says in a language in addition to its own sentences."""
    source = TEXTS.get(language)
    return list(read_texts(data / "speech" / source).values()) if source else []


def unseen(data: Path) -> list[Entry]:
    """Voices and languages that training never hears: LibriVox English, Finnish, Hungarian, Greek."""
    espeak, random = Espeak(), np.random.default_rng(0)
    synthetic = [u for language in UNSEEN_LANGUAGES for u in speak(espeak, language, 1.0, seed=1)]
    return [entry(u, None, random) for u in [*read_librivox(data), *synthetic]]


def entry(utterance: Utterance, teacher, random: np.random.Generator) -> Entry:
    """One utterance ready for training. Its name starts with its source."""
    mel = log_mel(torch.from_numpy(utterance.samples))
    frames = max(len(utterance.samples) * int(FPS) // 16000, 1)
    phones = segment_track(utterance.phones, MEL_PER_FRAME * frames, MEL_HZ)
    motion, weight = torch.zeros(1, 204).expand(frames, 204), torch.zeros(1, 204)
    if teacher is not None:
        rows = teacher.motion(utterance.phones, frames, FPS, random)
        motion, weight = torch.from_numpy(rows).flatten(1).half(), torch.ones(1, 204)
    return Entry(
        f"{utterance.source}/{utterance.name}",
        SOURCE,
        utterance.held_out,
        fit_frames(mel, MEL_PER_FRAME * frames).half()[None],
        motion,
        weight.expand(frames, 204),
        torch.from_numpy(phones),
    )
