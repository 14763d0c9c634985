"""How an emotion changes articulation itself, and how it comes and goes.

Directions follow Lee, Yildirim, Kazemzadeh & Narayanan 2005 ("An articulatory study of emotional
speech production": angry speech moves further and faster, sad speech the opposite, happy speech
much like neutral), Magno Caldognetto et al. 2004 (labial targets under emotion) and Chin & Pisoni
1997 (slurred speech under alcohol). The numbers are our own choice.
"""

from dataclasses import dataclass

import numpy as np
import torch
from scipy.ndimage import gaussian_filter1d
from torch import Tensor

from training.corpus.clip import FPS
from training.systems.freetalk.ats import EMOTIONS

SLUR_FRAMES = 2.0
SMALLEST_GAIN = 0.3
SETTLING_FRAMES = 0.8
OFFSET_OVER_ONSET = 1.7
ONE_POLE = 1.5
"""A one-pole filter has done 1 − 1/e of its way after its time constant, 78 % after 1.5 of them."""
LOWER_FACE = [*range(3, 14), *range(48, 68)]
MOUTH = list(range(48, 68))


@dataclass(frozen=True)
class Manner:
    """Factors on neutral speech motion at intensity 1.

    `opening` scales jaw and lips up and down, `rounding` their width and protrusion; `slur` is the
    share of smoothed motion, negative where speech gets crisper; `onset_s` how fast the face comes.
    """

    opening: float = 1.0
    rounding: float = 1.0
    slur: float = 0.0
    onset_s: float = 0.3


MANNERS = {
    "neutral": Manner(),
    "happy": Manner(opening=1.12, rounding=0.75),
    "pleased": Manner(opening=1.04, rounding=0.9),
    "calm": Manner(opening=0.92, slur=0.15, onset_s=0.4),
    "surprised": Manner(opening=1.2, slur=-0.1, onset_s=0.2),
    "sad": Manner(opening=0.75, rounding=0.95, slur=0.25, onset_s=0.4),
    "upset": Manner(opening=0.9, rounding=0.95, slur=0.05),
    "ashamed": Manner(opening=0.7, rounding=0.95, slur=0.2, onset_s=0.4),
    "afraid": Manner(opening=0.95, rounding=0.85, slur=-0.15, onset_s=0.2),
    "angry": Manner(opening=1.3, rounding=1.05, slur=-0.3, onset_s=0.22),
    "disgusted": Manner(opening=1.0, rounding=0.9, onset_s=0.25),
    "contempt": Manner(opening=0.85, rounding=0.9),
    "suspicious": Manner(opening=0.85, rounding=0.95),
    "ill": Manner(opening=0.7, rounding=0.9, slur=0.35, onset_s=0.4),
    "drunk": Manner(opening=0.85, rounding=0.9, slur=0.65, onset_s=0.4),
}


def articulate(motion: Tensor, strength: Tensor, free: Tensor) -> Tensor:
    """Speech motion [B, T, 204] spoken in a mixture of emotions `strength` [B, T, 15].

    `free` [B, T] is small where the lips close: there nothing is smoothed away. Scaling keeps a gap
    of zero.
    """
    opening, rounding, slur = (
        strength @ torch.tensor([getattr(MANNERS[e], name) - rest for e in EMOTIONS])
        for name, rest in (("opening", 1.0), ("rounding", 1.0), ("slur", 0.0))
    )
    smooth = gaussian_filter1d(motion.numpy(), SLUR_FRAMES, axis=1, mode="nearest")
    share = (slur.clamp(-0.6, 0.9) * free)[..., None]
    spoken = (motion + share * (torch.from_numpy(smooth) - motion)).unflatten(-1, (68, 3)).clone()
    spoken[..., LOWER_FACE, 1] *= (1.0 + opening).clamp_min(SMALLEST_GAIN)[..., None]
    for axis in (0, 2):
        spoken[..., MOUTH, axis] *= (1.0 + rounding).clamp_min(SMALLEST_GAIN)[..., None]
    return spoken.flatten(-2)


def follow(strength: np.ndarray) -> np.ndarray:
    """What the face does when `strength` [B, T, 15] is asked: rises fast, falls slower.

    Starts settled. Four fifths of a step up are there after the emotion's onset; a step down takes
    1.7 times as long.
    """
    onset = np.array([MANNERS[e].onset_s for e in EMOTIONS], np.float32) * FPS / ONE_POLE
    up, down = 1.0 - np.exp(-1.0 / onset), 1.0 - np.exp(-1.0 / (onset * OFFSET_OVER_ONSET))
    face, now = np.empty_like(strength), strength[:, 0].copy()
    for t in range(strength.shape[1]):
        change = strength[:, t] - now
        now = now + np.where(change > 0, up, down) * change
        face[:, t] = now
    return gaussian_filter1d(face, SETTLING_FRAMES, axis=1, mode="nearest")


def episode(frames: int, height: float, random: np.random.Generator) -> np.ndarray:
    """Intensity [T] that rises in 0.2 … 0.4 s to `height`, stays, and falls in 0.4 … 0.8 s."""
    onset, offset = random.uniform(0.2, 0.4) * FPS, random.uniform(0.4, 0.8) * FPS
    start = random.uniform(0, 0.6) * frames
    end = start + onset + random.uniform(0.2, 0.6) * frames
    at = np.arange(frames)
    x = np.minimum((at - start) / onset, (end + offset - at) / offset).clip(0.0, 1.0)
    return height * x * x * (3.0 - 2.0 * x)
