"""The training bank: log-mels, phones and motion of every source, computed once and kept on disk."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch

from training.corpus.aligned import Utterance, read_grid_speech
from training.corpus.cache import cached, digest
from training.corpus.clip import FPS, MEL_PER_FRAME, Clip, fit_frames
from training.corpus.conditions import EMOTIONS
from training.corpus.facegood import read_facegood
from training.corpus.folder import CorpusFolder
from training.corpus.folder_clips import clips as folder_clips
from training.corpus.grid import FIVE, read_grid, read_grid_five
from training.corpus.grid import SOURCE as GRID
from training.corpus.mirror import symmetrise
from training.corpus.phones import segment_track
from training.corpus.revoice import revoice
from training.speech.log_mel import log_mel

READERS = {"grid_s1": read_grid, "grid_five": read_grid_five, "facegood_zh": read_facegood}
MEL_HZ = FPS * MEL_PER_FRAME
UNKNOWN = -1
VERSION = 8


@dataclass
class Entry:
    """One clip, ready for training.

    `mels` [voices, 4 T, 64] f16 raw log-mel, voice 0 is the recording itself; `motion`
    [T, 204] f32 metres (left-right symmetrised); `weight` [T, 204] f32; `phones` [4 T] int16, the
    segment that sounds at each mel frame, −1 where it is unknown. `emotion` and its `intensity` hold
    for the whole clip.
    """

    name: str
    source: str
    held_out: bool
    mels: torch.Tensor
    motion: torch.Tensor
    weight: torch.Tensor
    phones: torch.Tensor
    emotion: str = "neutral"
    intensity: float = 0.0

    def affect(self) -> torch.Tensor:
        """Mixture of the fifteen emotions and intensity, [16]."""
        row = torch.zeros(len(EMOTIONS) + 1)
        row[EMOTIONS.index(self.emotion)], row[-1] = 1.0, self.intensity
        return row


def of_folders(folders: list[Path], voices: int, seed: int = 0, limit: int | None = None) -> list[Entry]:
    """Entries of the clips of corpus folders."""
    random = np.random.default_rng(seed)
    clips = clips_of_folders(folders, limit)
    return [entry_in_voices(clip, None, voices, random) for clip in clips]


def clips_of_folders(folders: list[Path], limit: int | None = None) -> list[Clip]:
    """Clips of corpus folders, whose names must differ."""
    opened = [CorpusFolder(path) for path in folders]
    names = [folder.name for folder in opened]
    if len(set(names)) < len(names):
        raise ValueError(f"--corpus: expected folders of different names, got {', '.join(names)}")
    return [clip for folder in opened for clip in few(folder_clips(folder), limit)]


def build(data: Path, voices: int, seed: int, sources: list[str], limit: int | None) -> list[Entry]:
    """Entries of all clips; held-out clips get only their own voice."""
    random = np.random.default_rng(seed)
    entries = []
    for source in sources:
        clips = few(READERS[source](data), limit)
        known = spoken(data, source, {clip.name for clip in clips})
        entries += [entry_in_voices(clip, known.get(clip.name), voices, random) for clip in clips]
    return entries


def spoken(data: Path, source: str, names: set[str]) -> dict[str, Utterance]:
    """The phones of a source's clips by name, where its words are known."""
    if source not in (GRID, FIVE):
        return {}
    return {u.name: u for u in read_grid_speech(data, source, names)}


def few(clips: list[Clip], limit: int | None) -> list[Clip]:
    """The first `limit` clips for training and as many held-out ones; all if `limit` is none."""
    groups = [[c for c in clips if c.held_out == held_out] for held_out in (False, True)]
    return clips if limit is None else groups[0][:limit] + groups[1][:limit]


def load(
    data: Path,
    cache: Path,
    voices: int = 8,
    seed: int = 0,
    sources: tuple[str, ...] = tuple(READERS),
    limit: int | None = None,
) -> list[Entry]:
    """Like `build`, but reads the cache folder if it has a bank built with the same arguments."""
    path = cache / f"bank-{digest(VERSION, voices, seed, sorted(sources), limit)}.pt"
    return cached(path, Entry, lambda: build(data, voices, seed, list(sources), limit))


def entry_in_voices(clip: Clip, said: Utterance | None, voices: int, random: np.random.Generator) -> Entry:
    """A clip in its own voice and, unless held out, in other voices. `said` has its phones."""
    frames = len(clip.motion)
    mels = [log_mel(torch.from_numpy(clip.samples))]
    if not clip.held_out:
        extra = [torch.from_numpy(revoice(clip.samples, random)) for _ in range(voices - 1)]
        mels += extra
    fitted = torch.stack([fit_frames(mel, MEL_PER_FRAME * frames) for mel in mels])
    known = clip.phones if said is None else said.phones
    phones = np.full(MEL_PER_FRAME * frames, UNKNOWN, np.int16)
    if known is not None:
        phones = segment_track(known, len(phones), MEL_HZ)
    return entry_of(clip, fitted, torch.from_numpy(phones))


def entry_of(clip: Clip, mels: torch.Tensor, phones: torch.Tensor) -> Entry:
    """The entry of a clip with speech features [voices, T, C]. Neutral motion is made symmetric."""
    motion = symmetrise(clip.motion) if clip.emotion == "neutral" else clip.motion
    moved = torch.from_numpy(motion.astype(np.float32)).flatten(1)
    weight = torch.from_numpy(clip.weight).repeat_interleave(3, dim=1)
    affect = (clip.emotion, clip.intensity)
    return Entry(clip.name, clip.source, clip.held_out, mels.half(), moved, weight, phones, *affect)


def entry_without_motion(name: str, source: str, held_out: bool, mels: torch.Tensor) -> Entry:
    """A sound, log-mels [voices, 4 T, 64], whose words and motion are unknown."""
    still = torch.zeros(mels.shape[1] // MEL_PER_FRAME, 204)
    phones = torch.full((mels.shape[1],), UNKNOWN, dtype=torch.int16)
    return Entry(name, source, held_out, mels.half(), still, still, phones)
