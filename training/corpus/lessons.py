"""Lessons for causal students: speech as log-mels, with what the ear hears in it.

The ear hears the whole of each sound in its own voice. The student hears it while it is spoken, in several
voices, in rooms and noise. What the ear's features mean, motion or closed lips, the trainers compute from
them.
"""

import argparse
import random
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import soundfile
import torch
from torch import Tensor

from training.corpus import bank, ear, emodb
from training.corpus.bank import Entry
from training.corpus.cache import cached, digest
from training.corpus.clip import MEL_PER_FRAME, fit_frames
from training.corpus.revoice import revoice
from training.corpus.tracks import mono_16_khz
from training.speech.ear import SHIPPED_EAR, Ear, ear_mel, load_ear
from training.speech.log_mel import SAMPLE_RATE_HZ, log_mel

VERSION = 5
HELD_OUT_EVERY = 10
HELD_OUT_SPEAKERS = {emodb.SOURCE: emodb.HELD_OUT, "crema_d": ("1010", "1029", "1047", "1063", "1081")}
"""First letters of the sounds whose speakers no student hears. Elsewhere every tenth sound is held out."""
SOUNDS = {".wav", ".ogg", ".opus", ".flac", ".mp3"}
SHORTEST_S = 0.5
SOUND_VOICES = 2
"""Number of voices of a sound from a folder, its own included."""
SPEECH = ("picovoice_en", "kerstin_de", "kathleen_en", "emodb_de", "crema_d", "kokoro")
"""Folders of speech without motion that students hear by default, as far as they are at hand."""


@dataclass(kw_only=True)
class Lesson(Entry):
    """A clip with `heard` [T, C] f16, the ear's features of its own voice.

    If no motion was recorded, `weight` is 0 throughout.
    """

    heard: Tensor


def load(arguments, limit: int | None = None) -> list[Lesson]:
    """The lessons of a run, kept in `--cache`: clips with recorded motion, and sounds of `--speech`.

    `limit` is the number of clips of each source, for tests.
    """
    groups = {" ".join(["recorded", *map(str, arguments.corpus)]): lambda: recorded(arguments, limit)}
    sounds = limit or arguments.speech_limit
    for folder in folders(arguments):
        groups[str(folder)] = lambda folder=folder: of_folder(folder, sounds, arguments.ear)
    weights = sum(float(x.detach().double().abs().sum()) for x in load_ear(arguments.ear).parameters())
    lessons = []
    # A student starts from the same weights whether its lessons are made now or read.
    with torch.random.fork_rng(devices=[]):
        for name, read in groups.items():
            key = digest(VERSION, bank.VERSION, name, sounds, limit, arguments.voices, weights)
            lessons += cached(arguments.cache / f"lessons-{key}.pt", Lesson, read)
    return lessons


def folders(arguments) -> list[Path]:
    """Folders of sound: those of `--speech`, else `SPEECH` beside the project's own recordings."""
    if arguments.speech or arguments.corpus:
        return arguments.speech
    return [path for name in SPEECH if (path := arguments.data / "speech" / name).is_dir()]


@torch.no_grad()
def recorded(arguments, limit: int | None = None) -> Iterator[Lesson]:
    """Clips with recorded motion in `--voices` voices: of the corpus folders, or the project's own."""
    listen = Ear(load_ear(arguments.ear))
    if arguments.corpus:
        entries = bank.of_folders(arguments.corpus, arguments.voices, arguments.seed, limit)
        sounds = {(c.source, c.name): c.samples for c in bank.clips_of_folders(arguments.corpus, limit)}
        for entry in entries:
            yield lesson(entry, listen, sounds[entry.source, entry.name])
        return
    entries = bank.load(arguments.data, arguments.cache, arguments.voices, limit=limit)
    heard = {(c.source, c.name): c.heard[:1] for c in ear.recorded(arguments, listen.body.config.taps)}
    for entry in entries:
        yield Lesson(**vars(entry), heard=listen.body(heard[entry.source, entry.name])[0].half())


def of_folder(folder: Path, limit: int | None, body: Path) -> Iterator[Lesson]:
    """Sounds under a folder, in their own voice and re-voiced."""
    paths = sorted(p for p in folder.rglob("*") if p.suffix.lower() in SOUNDS)
    if not paths:
        raise ValueError(f"{folder}: expected sounds ({', '.join(sorted(SOUNDS))}), got none")
    random.Random(0).shuffle(paths)
    chance, listen = np.random.default_rng(0), Ear(load_ear(body))
    speakers = HELD_OUT_SPEAKERS.get(folder.name)
    for index, path in enumerate(paths[:limit]):
        samples = mono_16_khz(*soundfile.read(path, dtype="float32", always_2d=True))
        frames = len(samples) * 25 // SAMPLE_RATE_HZ
        if len(samples) < SHORTEST_S * SAMPLE_RATE_HZ:
            continue
        held_out = path.name.startswith(speakers) if speakers else index % HELD_OUT_EVERY == 0
        mels = [log_mel(torch.from_numpy(samples))]
        if not held_out:
            mels += [torch.from_numpy(revoice(samples, chance)) for _ in range(SOUND_VOICES - 1)]
        fitted = torch.stack([fit_frames(mel, MEL_PER_FRAME * frames) for mel in mels])
        yield lesson(bank.entry_without_motion(path.name, folder.name, held_out, fitted), listen, samples)


def lesson(entry: Entry, listen: Ear, samples: np.ndarray) -> Lesson:
    """The lesson of a clip with its sound [S] at 16 kHz."""
    heard = listen(ear_mel(torch.from_numpy(samples)), len(entry.motion))
    return Lesson(**vars(entry), heard=heard.half())


def taught_by(lessons: list[Lesson], teach) -> list[Lesson]:
    """The same lessons with `teach`'s rows [T, D] beside the recorded motion [T, 204] in `motion`.

    Windows re-time both with the sound. Where nothing was recorded, the motion is 0.
    """
    rows = ((x, teach(x.heard.float())) for x in lessons)
    return [replace(x, motion=torch.cat([x.motion.float(), said.float()], dim=1).half()) for x, said in rows]


def silence(teach, body: Path = SHIPPED_EAR, frames: int = 50) -> Tensor:
    """What `teach` says about digital silence, [D]."""
    listen = Ear(load_ear(body))
    heard = listen(ear_mel(torch.zeros(frames * SAMPLE_RATE_HZ // 25)), frames)
    return teach(heard)[frames // 4 : -frames // 4].mean(dim=0)


def add_arguments(parser: argparse.ArgumentParser, voices: int) -> None:
    """The flags that `load` reads, and those that hold clips out."""
    parser.add_argument("--ear", type=Path, default=SHIPPED_EAR, help="ear.pt or folder of the ear")
    parser.add_argument("--speech", type=Path, nargs="*", default=[], help="folders of sound without motion")
    parser.add_argument("--speech-limit", type=int, default=400, help="sounds of each folder")
    parser.add_argument("--voices", type=int, default=voices, help="voices of each recorded clip")
    parser.add_argument("--leave-clips", nargs="*", default=[], help="hold out clips whose names begin so")
