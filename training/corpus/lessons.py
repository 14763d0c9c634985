"""Lessons for the streaming student: speech with the teacher's motion for it.

A lesson is a clip of the bank, or speech without captured motion. In addition it has the motion that the
full model (encoder and denoiser) generates for that speech.
"""

import hashlib
import json
import random
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import soundfile
import torch
from torch import Tensor

from training.corpus import bank
from training.corpus.bank import Entry
from training.corpus.cache import cached, digest
from training.corpus.clip import MEL_PER_FRAME, fit_frames
from training.corpus.closures import lips_closed
from training.corpus.revoice import revoice
from training.corpus.tracks import mono_16_khz
from training.speech.compact import CompactEncoder, normalise
from training.speech.log_mel import SAMPLE_RATE_HZ, log_mel
from training.systems.freetalk.ats import AtsDenoiser, neutral_affect
from training.systems.freetalk.sampling import sample_motion

VERSION = 4
HELD_OUT_EVERY = 10
SOUNDS = {".wav", ".ogg", ".flac", ".mp3"}
SHORTEST_S = 0.5


@dataclass(kw_only=True)
class Lesson(Entry):
    """A clip with the teacher's motion `taught` [T, 204] f16, metres.

    If no motion was captured, `weight` is 0 throughout.
    """

    taught: Tensor


class FullModel:
    """The full model in its default style."""

    def __init__(self, encoder: CompactEncoder, denoiser: AtsDenoiser):
        if not isinstance(encoder, CompactEncoder):
            expected = "--ats, --models: expected a model that listens by compact_speech"
            raise ValueError(f"{expected}, got one that listens by {denoiser.config.speech.encoder}")
        self.encoder, self.denoiser = encoder, denoiser
        self.style = denoiser.config.styles.index(denoiser.config.default_style)
        self.closes = denoiser.config.default_style in denoiser.config.closing_styles

    def digest(self) -> str:
        """A short name that changes with the weights and the sampling."""
        hasher = hashlib.sha256(json.dumps(self.denoiser.config.to_json()).encode())
        for model in (self.encoder, self.denoiser):
            for value in model.state_dict().values():
                hasher.update(value.numpy().tobytes())
        return hasher.hexdigest()[:16]

    @torch.no_grad()
    def teach(self, entry: Entry) -> Lesson:
        """Generates the motion of a clip from its own voice, without re-voicing."""
        mel = fit_frames(entry.mels[0].float(), MEL_PER_FRAME * len(entry.motion))
        speech = self.encoder(normalise(mel)[None])[0]
        motion = sample_motion(self.denoiser, speech, neutral_affect(1, len(speech))[0], self.style)
        if self.closes:
            motion = lips_closed(motion, self.encoder.closed(speech))
        return Lesson(**vars(entry), taught=motion.half())


def load(
    entries: list[Entry],
    teacher: FullModel,
    folder: Path,
    speech: list[Path],
    limit: int | None,
) -> list[Lesson]:
    """The lessons of a run, read from `folder` if an earlier run with the same arguments made them.

    `entries`: the bank. `speech`: folders of sound without motion, at most `limit` files of each.
    """
    groups = {"captured": lambda: entries}
    groups |= {str(path): lambda path=path: speech_entries(path, limit) for path in speech}
    lessons = []
    for name, read_entries in groups.items():
        known = [[e.source, e.name, len(e.mels), len(e.motion)] for e in entries]
        voices = known if name == "captured" else limit
        path = folder / f"lessons-{digest(VERSION, bank.VERSION, name, voices, teacher.digest())}.pt"
        lessons += cached(path, Lesson, lambda read_entries=read_entries: map(teacher.teach, read_entries()))
        print(f"{name}: lessons are in {path}", flush=True)
    return lessons


def speech_entries(folder: Path, limit: int | None, voices: int = 2) -> list[Entry]:
    """Sounds under a folder, in their own voice and re-voiced. Every tenth is held out and not re-voiced."""
    paths = sorted(p for p in folder.rglob("*") if p.suffix.lower() in SOUNDS)
    if not paths:
        raise ValueError(f"{folder}: expected sounds ({', '.join(sorted(SOUNDS))}), got none")
    random.Random(0).shuffle(paths)
    chance = np.random.default_rng(0)
    entries = []
    for index, path in enumerate(paths[:limit]):
        samples = mono_16_khz(*soundfile.read(path, dtype="float32", always_2d=True))
        frames = len(samples) * 25 // SAMPLE_RATE_HZ
        if len(samples) < SHORTEST_S * SAMPLE_RATE_HZ:
            continue
        held_out = index % HELD_OUT_EVERY == 0
        mels = [log_mel(torch.from_numpy(samples))]
        if not held_out:
            mels += [torch.from_numpy(revoice(samples, chance)) for _ in range(voices - 1)]
        fitted = torch.stack([fit_frames(mel, MEL_PER_FRAME * frames) for mel in mels])
        entries.append(bank.entry_without_motion(path.name, folder.name, held_out, fitted))
    return entries
