"""Whisper's features of recorded motion and of speech without a face, kept on disk by source.

The trainable part of the ear (`training/speech/ear.py`) learns from them, and so do the systems after it.
"""

import functools
import hashlib
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
from training.corpus.bank import MEL_HZ, Entry
from training.corpus.cache import cached, digest
from training.corpus.clip import FPS, Clip
from training.corpus.espeak import Espeak
from training.corpus.phones import PAUSE, SEGMENTS, Phone
from training.corpus.revoice import other_room, revoiced_power
from training.corpus.teacher import Teacher
from training.nn.checkpoint import read_bytes
from training.speech.ear import ear_mel, ear_mel_of_power, taps
from training.speech.log_mel import SAMPLE_RATE_HZ
from training.speech.whisper import SHIPPED_TRUNK, WhisperEncoder, load_trunk

LAYERS = (2, 3)
"""Layers whose outputs are kept. Those of 2, 3, 4 and 6 together served the mouth no better in trials."""
COPIES = {"grid_s1": 2, "grid_five": 8, "facegood_zh": 4}
"""Number of re-voiced copies of each training clip with recorded motion, every second of them in another
room. Held-out clips have only their own voice."""
FEW_COPIES = 2
"""The same for clips of corpus folders."""
VERSION = 3
MOTION = 204
SILENCE = "silence"
"""Sounds in which nobody speaks. The face is at rest."""
SILENT_SOUNDS, SILENT_S = 40, 6.0
UNTIMED = ("kerstin_de", "picovoice_en")
UNHEARD = ("librivox_en", *(f"espeak_{language}" for language in UNSEEN_LANGUAGES))
"""Sources of speech that no training uses."""


@dataclass(kw_only=True)
class EarClip(Entry):
    """An entry of the bank with `heard` [voices, layers, 2 T, C] f16, the outputs of Whisper's `LAYERS`."""

    heard: Tensor


def load(
    data: Path,
    cache: Path,
    sources: list[str],
    layers: list[int],
    minutes: float = 5.0,
    limit: int | None = None,
) -> list[EarClip]:
    """Clips of `sources` (see `every_source`) with the outputs of `layers` of Whisper, [voices, K, 2 T, C].

    Each source is read from its cache file if there is one. With a `limit`, only so many clips of each source
    with recorded motion are heard, and as many held-out ones, and none are kept.
    """
    places, clips = [LAYERS.index(layer) for layer in layers], []
    for clip in _every_layer(data, cache, sources, minutes, limit):
        clip.heard = clip.heard[:, places]
        clips.append(clip)
    return clips


def _every_layer(
    data: Path, cache: Path, sources: list[str], minutes: float, limit: int | None = None
) -> Iterator[EarClip]:
    trunk, espeak = functools.cache(load_trunk), functools.cache(Espeak)
    weights = hashlib.sha256(read_bytes(SHIPPED_TRUNK)).hexdigest()
    for source in sources:
        hear = functools.partial(_hear, data, source, trunk, espeak, minutes, limit)
        if limit is not None and source in bank.READERS:
            yield from hear()
            continue
        kokoro = kokoro_count(data) if source == "kokoro" else []
        name = digest(VERSION, weights, bank.VERSION, LAYERS, COPIES.get(source, 0), minutes, *kokoro)
        path = cache / f"ear-{source}-{name}.pt"
        yield from cached(path, EarClip, hear)


def for_systems(arguments, layers: list[int]) -> Iterator[EarClip]:
    """Clips on which the systems learn: those of the corpus folders, or of the project's own sources.

    The latter are recorded motion, and speech without a face with the motion that the co-articulation rules
    derive from its phones (source `taught`).
    """
    if arguments.corpus:
        yield from of_folders(arguments, layers)
        return
    left = {*arguments.leave_speech, *UNTIMED}
    if spoken.SOURCE in getattr(arguments, "leave_out", ()):
        left |= {s for s in every_source() if s not in bank.READERS}
    teacher, random = Teacher.load(), np.random.default_rng(0)
    for source in (s for s in every_source() if s not in left):
        own = (arguments.data, arguments.cache, [source], layers, arguments.minutes, arguments.limit)
        for clip in bank.few(load(*own), arguments.limit):
            if source not in bank.READERS:
                clip.name, clip.source = f"{source}/{clip.name.split('/')[-1]}", spoken.SOURCE
                if source != SILENCE:
                    follow_rules(clip, teacher, random)
            yield clip


def recorded(arguments, layers: list[int]) -> Iterator[EarClip]:
    """Clips of the corpus folders, or the project's own recorded motion."""
    if arguments.corpus:
        yield from of_folders(arguments, layers)
        return
    for source in bank.READERS:
        limit = getattr(arguments, "limit", None)
        yield from load(arguments.data, arguments.cache, [source], layers, limit=limit)


def of_folders(arguments, layers: list[int]) -> Iterator[EarClip]:
    """Clips of corpus folders with the outputs of `layers` of Whisper. They are not kept on disk."""
    trunk, random = load_trunk(), np.random.default_rng(getattr(arguments, "seed", 0))
    for clip in bank.clips_of_folders(arguments.corpus, getattr(arguments, "limit", None)):
        entry = bank.entry_in_voices(clip, None, 1, random)
        yield EarClip(**vars(entry), heard=_voices(clip, trunk, random)[:, [LAYERS.index(x) for x in layers]])


def follow_rules(clip: EarClip, teacher: Teacher, random: np.random.Generator) -> None:
    """Gives a clip the motion that the co-articulation rules derive from its phones."""
    motion = teacher.motion(timed(clip.phones), len(clip.motion), FPS, random)
    clip.motion = torch.from_numpy(motion).flatten(1).half()
    clip.weight = torch.ones(1, MOTION).expand(len(motion), MOTION)


def timed(phones: Tensor) -> list[Phone]:
    """A track of segments [T] at 100 Hz as phones with times."""
    edges = [0, *(torch.nonzero(phones.diff()).flatten() + 1).tolist(), len(phones)]
    spans = zip(edges[:-1], edges[1:], strict=True)
    return [Phone(a / MEL_HZ, (b - a) / MEL_HZ, SEGMENTS[int(phones[a])]) for a, b in spans]


def every_source() -> list[str]:
    """Names of all sources: recorded motion, recorded speech and espeak-ng's languages, `UNHEARD` last."""
    synthetic = [f"espeak_{language}" for language in ALPHABETS if language not in UNSEEN_LANGUAGES]
    return [*bank.READERS, SILENCE, *spoken.RECORDED, *UNTIMED, *synthetic, *UNHEARD]


def _hear(
    data: Path,
    source: str,
    opened: Callable[[], WhisperEncoder],
    espeak: Callable[[], Espeak],
    minutes: float,
    limit: int | None,
) -> Iterator[EarClip]:
    trunk, random = opened(), np.random.default_rng(5)
    if source in bank.READERS:
        clips = bank.few(bank.READERS[source](data), limit)
        known = bank.spoken(data, source, {clip.name for clip in clips})
        for clip in clips:
            entry = bank.entry_in_voices(clip, known.get(clip.name), 1, random)
            yield EarClip(**vars(entry), heard=_voices(clip, trunk, random))
        return
    for utterance in utterances(data, source, espeak, minutes):
        is_timed = utterance.phones is not None
        entry = spoken.entry(utterance if is_timed else replace(utterance, phones=[]))
        if not is_timed:
            entry.phones.fill_(bank.UNKNOWN)
        if source == SILENCE:
            entry.weight = torch.ones_like(entry.weight)
        entry.source = source
        mel = ear_mel(torch.from_numpy(utterance.samples))
        yield EarClip(**vars(entry), heard=taps(trunk, mel, list(LAYERS), len(entry.motion))[None])


def _voices(clip: Clip, trunk: WhisperEncoder, random: np.random.Generator) -> Tensor:
    mels = [ear_mel(torch.from_numpy(clip.samples))]
    for number in range(0 if clip.held_out else COPIES.get(clip.source, FEW_COPIES)):
        power = revoiced_power(clip.samples, random)
        power = other_room(power, random) if number % 2 else power
        mels.append(ear_mel_of_power(torch.from_numpy(power)))
    return torch.stack([taps(trunk, mel, list(LAYERS), len(clip.motion)) for mel in mels])


def utterances(data: Path, source: str, espeak: Callable[[], Espeak], minutes: float) -> list[Utterance]:
    """Speech without a face of one source."""
    readers = spoken.RECORDED | {"librivox_en": read_librivox}
    if source in readers:
        return readers[source](data)
    if source in UNTIMED:
        return read_unlabelled(data, source)
    if source == SILENCE:
        return silence(np.random.default_rng(0))
    language = source.removeprefix("espeak_")
    if language in UNSEEN_LANGUAGES:
        return speak(espeak(), language, 1.0, seed=1)
    return speak(espeak(), language, minutes, seed=0, texts=spoken.texts_of(data, language))


def silence(random: np.random.Generator) -> list[Utterance]:
    """Digital silence, steady noise of any colour and level, hum, and chords."""
    count, utterances = int(SILENT_S * SAMPLE_RATE_HZ), []
    time_s = np.arange(count) / SAMPLE_RATE_HZ
    for number in range(SILENT_SOUNDS):
        noise = np.fft.rfft(random.standard_normal(count))
        hertz = np.maximum(np.fft.rfftfreq(count, 1 / SAMPLE_RATE_HZ), 20.0)
        samples = np.fft.irfft(noise * hertz ** -random.uniform(0.0, 1.0), count)
        if number % 4 == 1:
            samples = samples / samples.std() + random.uniform(1, 8) * np.sin(
                2 * np.pi * random.choice([50, 60, 100, 120]) * time_s
            )
        if number % 4 == 2:
            samples = samples / samples.std() + random.uniform(2, 8) * chords(time_s, random)
        level = 0.0 if number == 0 else 10.0 ** random.uniform(-4.5, -0.7)
        samples = (level * samples / np.abs(samples).max()).astype(np.float32)
        pause = [Phone(0.0, SILENT_S, PAUSE)]
        utterances.append(Utterance(f"{number:02d}", SILENCE, number % 10 == 9, samples, pause))
    return utterances


def chords(time_s: np.ndarray, random: np.random.Generator) -> np.ndarray:
    """Three notes at a time that fade out and change every half second, [S]."""
    out = np.zeros(len(time_s))
    for start in np.arange(0.0, time_s[-1], 0.5):
        after = time_s - start
        envelope = np.where((after >= 0) & (after < 1.0), np.exp(-4.0 * after), 0.0)
        for note in random.integers(45, 84, 3):
            tone = 2 * np.pi * 440.0 * 2.0 ** ((note - 69) / 12.0) * time_s
            out += envelope * (np.sin(tone) + 0.4 * np.sin(2 * tone) + 0.2 * np.sin(3 * tone))
    return out / max(out.std(), 1e-6)
