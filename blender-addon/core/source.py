"""A sound that was found but not decoded yet: decoding takes time and belongs to the worker."""

from collections.abc import Callable
from dataclasses import dataclass, field
from tempfile import TemporaryDirectory

import numpy as np

from .take import Sound

# decode(path) returns mono samples `[S]` float32, their rate in Hz, and a note for the artist, ""
# if there is none.
Decode = Callable[[str], tuple[np.ndarray, float, str]]


@dataclass
class SoundSource:
    """A file and the part of it that plays, from `first_s` to `last_s` (None: to its end).

    `start_frame` is the scene frame at which it begins. A temporary file lies in `folder`,
    which is removed with this object. `notes` are remarks for the report.
    """

    path: str
    name: str
    start_frame: float
    first_s: float = 0.0
    last_s: float | None = None
    folder: TemporaryDirectory | None = None
    notes: list[str] = field(default_factory=list)

    @property
    def duration_s(self) -> float | None:
        """Length in seconds where it is known before decoding, else None."""
        return None if self.last_s is None else self.last_s - self.first_s

    def load(self, decode: Decode) -> Sound:
        """Decodes and cuts; raises what `decode` raises."""
        samples, rate_hz, note = decode(self.path)
        if note and note not in self.notes:
            self.notes.append(note)
        last_s = len(samples) / rate_hz if self.last_s is None else self.last_s
        return Sound(cut(samples, rate_hz, self.first_s, last_s), rate_hz, self.name)


@dataclass
class MixedSource:
    """Several sounds as one, each `at_s` seconds after the first; silence where none plays.

    `notes` are remarks for the report, such as strips that were left out.
    """

    parts: list[SoundSource]
    at_s: list[float]
    name: str
    start_frame: float
    notes: list[str] = field(default_factory=list)

    @property
    def duration_s(self) -> float | None:
        """Length in seconds where it is known before decoding, else None."""
        lengths = [part.duration_s for part in self.parts if part.duration_s is not None]
        if len(lengths) < len(self.parts):
            return None
        return max(at + length for at, length in zip(self.at_s, lengths, strict=True))

    def load(self, decode: Decode) -> Sound:
        """Decodes all and adds them up; raises what `decode` raises."""
        sounds = [part.load(decode) for part in self.parts]
        said = {note: None for part in self.parts for note in part.notes}
        self.notes += [note for note in said if note not in self.notes]
        rate_hz = max(sound.rate_hz for sound in sounds)
        tracks = [resampled(sound, rate_hz) for sound in sounds]
        first = [round(at * rate_hz) for at in self.at_s]
        length = max(at + len(track) for at, track in zip(first, tracks, strict=True))
        mixed = np.zeros(length, dtype=np.float32)
        for at, track in zip(first, tracks, strict=True):
            mixed[at : at + len(track)] += track
        return Sound(mixed, rate_hz, self.name)


def resampled(sound: Sound, rate_hz: float) -> np.ndarray:
    """Samples of `sound` at `rate_hz`, which is at least its own rate; interpolates linearly."""
    if sound.rate_hz == rate_hz:
        return sound.samples
    at = np.arange(round(sound.duration_s * rate_hz)) * (sound.rate_hz / rate_hz)
    return np.interp(at, np.arange(len(sound.samples)), sound.samples).astype(np.float32)


def cut(samples: np.ndarray, rate_hz: float, first_s: float, last_s: float) -> np.ndarray:
    """The samples from `first_s` to `last_s`; silence for times before the first sample."""
    first, last = round(first_s * rate_hz), round(last_s * rate_hz)
    silence = np.zeros(max(0, min(-first, last - first)), dtype=np.float32)
    return np.concatenate([silence, samples[max(first, 0) : max(last, 0)]])
