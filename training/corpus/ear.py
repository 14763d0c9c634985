"""Whisper's features of recorded motion and of speech without a face, kept on disk by source.

`training.speech.train_ear` learns motion and phones from them. The trained model then gives all this speech a
face (`lessons`), and one of Whisper's layers becomes a target for the compact encoder (`attach`).
"""

import functools
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from training.corpus import bank, spoken
from training.corpus.aligned import (
    ALPHABETS,
    UNSEEN_LANGUAGES,
    Utterance,
    kokoro_count,
    read_librivox,
    read_unlabelled,
    speak,
)
from training.corpus.bank import Entry
from training.corpus.cache import cached, digest
from training.corpus.clip import MEL_PER_FRAME, Clip
from training.corpus.espeak import Espeak
from training.corpus.revoice import other_room, revoiced_power
from training.speech import whisper
from training.speech.compact import normalise

LAYERS = (2, 4, 6)
FRAMES_EACH = 2
"""Number of Whisper's feature vectors per frame of motion."""
LEVELS = 8
VOICES, ROOMS = 3, 2
"""Versions of each training clip with recorded motion. Held-out clips have only their own voice.

`VOICES` counts the clip's own voice and re-voiced copies. `ROOMS` counts further re-voiced copies that
sound as if in another room.
"""
VERSION = 2
UNTIMED = ("kerstin_de", "picovoice_en")
UNHEARD = ("librivox_en", *(f"espeak_{language}" for language in UNSEEN_LANGUAGES))
"""Sources of speech that no training uses."""


@dataclass(kw_only=True)
class EarClip(Entry):
    """An entry of the bank with `heard` [voices, layers, 2 T, C] f16, the outputs of Whisper's `LAYERS`."""

    heard: Tensor

    def levels(self) -> Tensor:
        """Loudness of eight broad bands of the clip's own voice, [2 T, 8], normalised. Whisper's features
        hardly show it."""
        mel = normalise(self.mels[0].float())
        return (
            mel.unflatten(0, (-1, MEL_PER_FRAME // FRAMES_EACH)).unflatten(2, (LEVELS, -1)).mean(dim=(1, 3))
        )


class Ear:
    """Whisper's encoder, which multiplies in bfloat16."""

    def __init__(self, folder: Path):
        self.encoder = whisper.load(folder)

    @torch.no_grad()
    def __call__(self, mel: Tensor, frames: int) -> Tensor:
        """Whisper's log-mel [T, 80] → [layers, 2 `frames`, C] f16; the last row is repeated at the end."""
        with torch.autocast("cpu", torch.bfloat16):
            heard = self.encoder.hear(mel, list(LAYERS))
        layers, rows = torch.stack([x.float() for x in heard]).half(), FRAMES_EACH * frames
        return layers[:, torch.arange(rows).clamp_max(layers.shape[1] - 1)]


def load(data: Path, cache: Path, folder: Path, sources: list[str], minutes: float = 5.0) -> list[EarClip]:
    """Clips of `sources` (`every_source` names them), each read from its cache file if there is one."""
    clips, ear, espeak = [], functools.cache(lambda: Ear(folder)), functools.cache(Espeak)
    for source in sources:
        kokoro = kokoro_count(data) if source == "kokoro" else []
        name = digest(VERSION, bank.VERSION, LAYERS, VOICES, ROOMS, minutes, *kokoro)
        path = cache / f"ear-{source}-{name}.pt"
        clips += cached(path, EarClip, functools.partial(_hear, data, source, ear, espeak, minutes))
    return clips


def every_source() -> list[str]:
    """Names of all sources: recorded motion, recorded speech and espeak-ng's languages, `UNHEARD` last."""
    synthetic = [f"espeak_{language}" for language in ALPHABETS if language not in UNSEEN_LANGUAGES]
    return [*bank.READERS, *spoken.RECORDED, *UNTIMED, *synthetic, *UNHEARD]


def _hear(
    data: Path, source: str, opened: Callable[[], Ear], espeak: Callable[[], Espeak], minutes: float
) -> Iterator[EarClip]:
    ear, random = opened(), np.random.default_rng(5)
    if source in bank.READERS:
        clips = bank.READERS[source](data)
        known = bank.spoken(data, source, {clip.name for clip in clips})
        for clip in clips:
            entry = bank.entry_in_voices(clip, known.get(clip.name), 1, random)
            yield EarClip(**vars(entry), heard=_voices(clip, ear, random))
        return
    for utterance in utterances(data, source, espeak, minutes):
        timed = utterance.phones is not None
        entry = spoken.entry(utterance if timed else replace(utterance, phones=[]), None, random)
        if not timed:
            entry.phones.fill_(bank.UNKNOWN)
        entry.source = source
        mel = whisper.whisper_mel(torch.from_numpy(utterance.samples))
        yield EarClip(**vars(entry), heard=ear(mel, len(entry.motion))[None])


def _voices(clip: Clip, ear: Ear, random: np.random.Generator) -> Tensor:
    mels = [whisper.whisper_mel(torch.from_numpy(clip.samples))]
    for number in range(0 if clip.held_out else VOICES + ROOMS - 1):
        power = revoiced_power(clip.samples, random)
        power = power if number < VOICES - 1 else other_room(power, random)
        mels.append(whisper.mel_of_power(torch.from_numpy(power)))
    return torch.stack([ear(mel, len(clip.motion)) for mel in mels])


def utterances(data: Path, source: str, espeak: Callable[[], Espeak], minutes: float) -> list[Utterance]:
    """Speech without a face of one source."""
    readers = spoken.RECORDED | {"librivox_en": read_librivox}
    if source in readers:
        return readers[source](data)
    if source in UNTIMED:
        return read_unlabelled(data, source)
    language = source.removeprefix("espeak_")
    if language in UNSEEN_LANGUAGES:
        return speak(espeak(), language, 1.0, seed=1)
    return speak(espeak(), language, minutes, seed=0, texts=spoken.texts_of(data, language))
