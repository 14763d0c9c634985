"""Pairs of a corpus folder: one speaker says one sentence in two emotions (EmoFace §3.3.2).

The two recordings differ in tempo. Dynamic time warping on the speech encoder's features of both maps the
times of one to the other. So the content of one with the emotion of the other has a true motion.
"""

import re
from dataclasses import replace

import numpy as np
import torch
from scipy.ndimage import uniform_filter1d
from scipy.spatial.distance import cdist
from torch import Tensor

from training.corpus.windows import interpolate
from training.paper.metrics import best_path, path_costs
from training.systems.emoface.rows import Spoken

SMOOTH_FRAMES = 5
"""A path moves in whole frames. A moving mean over this many frames smooths its pace."""


def sentence(text: str) -> str:
    """A text's words without case and punctuation. If two texts match, they are the same sentence."""
    return " ".join(re.findall(r"\w+", text.casefold()))


class Pairs:
    """Knows which clips are partners, and aligns the times of partners."""

    def __init__(self, clips: list[Spoken]):
        groups: dict[tuple[str, str], list[Spoken]] = {}
        for clip in clips:
            if clip.text:
                groups.setdefault((clip.source, clip.text), []).append(clip)
        self.partners = {
            c.name: [other for other in groups.get((c.source, c.text), []) if other.label != c.label]
            for c in clips
        }
        self.paths: dict[tuple[str, str], Tensor] = {}

    def of(self, clip: Spoken) -> list[Spoken]:
        """Recordings of the same sentence by the same speaker in other emotions."""
        return self.partners[clip.name]

    def path(self, clip: Spoken, other: Spoken) -> Tensor:
        """For each frame of `clip`, the matching place in `other`, counted in its frames, [T]."""
        key = clip.name, other.name
        if key not in self.paths:
            self.paths[key] = torch.from_numpy(align(*map(_standard, (clip, other))))
        return self.paths[key]

    def cross(self, clip: Spoken, other: Spoken) -> Spoken:
        """`clip` with the emotion of `other`. The truth is the motion of `other` at the times of `clip`."""
        at = self.path(clip, other)
        emotion, weights = (interpolate(x, at) for x in (other.emotion, other.weights))
        label = {"label": other.label, "share": other.share}
        return replace(clip, emotion=emotion, weights=weights, sound=None, voice=None, **label)


def align(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """For each row of `x` [T, C], the place of a similar row in `y` [S, C], never decreasing, [T] f32."""
    path = np.array(best_path(path_costs(cdist(x, y), np.add)))
    sums = np.bincount(path[:, 0], weights=path[:, 1], minlength=len(x))
    places = sums / np.bincount(path[:, 0], minlength=len(x))
    return uniform_filter1d(places, SMOOTH_FRAMES, mode="nearest").astype(np.float32)


def _standard(clip: Spoken) -> np.ndarray:
    """F_c with each channel at mean 0 and deviation 1, which removes the constant colour of the voice."""
    x = clip.content[0].double().numpy()
    return (x - x.mean(axis=0)) / np.maximum(x.std(axis=0), 1e-6)
