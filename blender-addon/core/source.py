"""A sound that was found but not decoded yet: decoding takes time and belongs to the worker."""

from collections.abc import Callable
from dataclasses import dataclass
from tempfile import TemporaryDirectory

import numpy as np

from .take import Sound

# decode(path) returns mono samples `[S]` float32 and their rate in Hz.
Decode = Callable[[str], tuple[np.ndarray, float]]


@dataclass
class SoundSource:
    """A file and the part of it that plays, from `first_s` to `last_s` (None: to its end).

    `start_frame` is the scene frame at which it begins. `folder` holds the file where it is
    temporary, and goes with this object.
    """

    path: str
    name: str
    start_frame: float
    first_s: float = 0.0
    last_s: float | None = None
    folder: TemporaryDirectory | None = None

    def load(self, decode: Decode) -> Sound:
        """Decodes and cuts; raises what `decode` raises."""
        samples, rate_hz = decode(self.path)
        last_s = len(samples) / rate_hz if self.last_s is None else self.last_s
        return Sound(cut(samples, rate_hz, self.first_s, last_s), rate_hz, self.name)


def cut(samples: np.ndarray, rate_hz: float, first_s: float, last_s: float) -> np.ndarray:
    """The samples from `first_s` to `last_s`; silence where that lies before the first."""
    first, last = round(first_s * rate_hz), round(last_s * rate_hz)
    silence = np.zeros(max(0, min(-first, last - first)), dtype=np.float32)
    return np.concatenate([silence, samples[max(first, 0) : max(last, 0)]])
