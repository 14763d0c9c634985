"""Emotion on landmarks: synthesised, because no open emotional speech with face capture exists.

Emotion → action units → ARKit shapes → displacements of ICT's landmarks. The prototypes of happy,
sad, afraid, angry, surprised, disgusted and contempt are those of Ekman & Friesen's tables
(`happy 6+12`, …) with small units added; ill borrows from the pain units 4, 7, 9 and 43 of Prkachin
& Solomon 2008, ashamed lowers its lids and presses its lips (Keltner 1995); pleased, calm, upset,
suspicious and drunk are our own choice, and all strengths are. An expression is added to real
neutral speech motion, whose own articulation `manner` changes; units that open the mouth give way
where the lips close for p, b and m, and lips never cross.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from scipy.ndimage import gaussian_filter1d, minimum_filter1d
from torch import Tensor

from training.corpus.ict import IctLandmarks
from training.corpus.manner import articulate, episode, follow
from training.losses import lip_gap
from training.systems.freetalk.ats import EMOTIONS

AU_TO_ARKIT = {
    "1": ["browInnerUp"],
    "2": ["browOuterUp_L", "browOuterUp_R"],
    "2L": ["browOuterUp_L"],
    "4": ["browDown_L", "browDown_R"],
    "5": ["eyeWide_L", "eyeWide_R"],
    "6": ["cheekSquint_L", "cheekSquint_R"],
    "7": ["eyeSquint_L", "eyeSquint_R"],
    "4R": ["browDown_R"],
    "9": ["noseSneer_L", "noseSneer_R"],
    "10": ["mouthUpperUp_L", "mouthUpperUp_R"],
    "10R": ["mouthUpperUp_R"],
    "12": ["mouthSmile_L", "mouthSmile_R"],
    "12L": ["mouthSmile_L"],
    "12R": ["mouthSmile_R"],
    "14": ["mouthDimple_L", "mouthDimple_R"],
    "14R": ["mouthDimple_R"],
    "15": ["mouthFrown_L", "mouthFrown_R"],
    "16": ["mouthLowerDown_L", "mouthLowerDown_R"],
    "17": ["mouthShrugLower"],
    "20": ["mouthStretch_L", "mouthStretch_R"],
    "23": ["mouthPress_L", "mouthPress_R"],
    "26": ["jawOpen"],
    "28": ["mouthRollLower", "mouthRollUpper"],
    "45": ["eyeBlink_L", "eyeBlink_R"],
    "45L": ["eyeBlink_L"],
}
OPENING = {"9", "10", "10R", "16", "17", "20", "26"}
PROTOTYPES = {
    "neutral": {},
    "happy": {"6": 0.7, "12": 0.75, "10": 0.1},
    "pleased": {"6": 0.3, "12": 0.35, "14": 0.2, "1": 0.15},
    "calm": {"12": 0.15, "45": 0.28},
    "surprised": {"1": 0.9, "2": 0.9, "5": 0.7, "26": 0.15},
    "sad": {"1": 0.9, "4": 0.35, "15": 0.65, "17": 0.15},
    "upset": {"1": 0.3, "4": 0.65, "15": 0.3, "17": 0.35, "20": 0.2},
    "ashamed": {"1": 0.35, "14": 0.5, "15": 0.25, "28": 0.3, "45": 0.45},
    "afraid": {"1": 0.8, "2": 0.5, "4": 0.4, "5": 0.8, "7": 0.3, "20": 0.5, "26": 0.08},
    "angry": {"4": 0.9, "5": 0.4, "7": 0.5, "23": 0.4},
    "disgusted": {"4": 0.35, "9": 0.65, "10": 0.15, "15": 0.45, "16": 0.05},
    "contempt": {"12R": 0.5, "14R": 0.6, "10R": 0.15},
    "suspicious": {"2L": 0.6, "4R": 0.7, "4": 0.15, "7": 0.7, "23": 0.2},
    "ill": {"1": 0.15, "4": 0.45, "7": 0.35, "9": 0.2, "15": 0.2, "45": 0.4},
    "drunk": {"1": 0.4, "2": 0.3, "12L": 0.35, "12": 0.1, "26": 0.06, "45": 0.35, "45L": 0.15},
}
CLOSED_M = 1.5e-3
YIELD = 0.85
REST_FRAMES = 15
LOWEST_GAP_M = -0.5e-3
INNER_PAIRS = ((61, 67), (62, 66), (63, 65))


@dataclass
class EmotionOptions:
    """How often and how windows get an emotion."""

    neutral_share: float = 0.5
    blend_share: float = 0.35
    step_share: float = 0.3
    episode_share: float = 0.25
    maximum: float = 1.5


class EmotionSynthesiser:
    """Draws emotion curves and adds their expressions to neutral motion."""

    def __init__(self, data: Path, seed: int, options: EmotionOptions | None = None):
        self.options = options or EmotionOptions()
        self.random = np.random.default_rng(seed)
        lasting, opening = expressions(data)
        self.lasting = torch.from_numpy(lasting)
        self.opening = torch.from_numpy(opening)

    def draw(self, count: int, frames: int) -> Tensor:
        """Conditions [B, T, 16]: mixture of 15 and intensity."""
        return torch.stack([self._curve(frames) for _ in range(count)])

    def apply(self, motion: Tensor, affect: Tensor) -> Tensor:
        """Neutral motion [B, T, 204] in metres → the same with its expression."""
        strength = affect[..., :15] * affect[..., 15:]
        if not (strength[..., 1:] > 0).any():
            return motion
        strength = torch.from_numpy(follow(strength.numpy()))
        free = 1.0 - YIELD * brief_closure(lip_gap(motion))
        felt = articulate(motion, strength, free) + strength @ self.lasting
        return uncrossed(felt + free[..., None] * (strength @ self.opening), motion)

    def _curve(self, frames: int) -> Tensor:
        affect = torch.zeros(frames, 16)
        options, random = self.options, self.random
        if random.random() < options.neutral_share:
            affect[:, 0] = 1.0
            return affect
        chosen = random.choice(np.arange(1, 15), 2, replace=False)
        share = random.uniform(0, 1) if random.random() < options.blend_share else 1.0
        affect[:, chosen[0]], affect[:, chosen[1]] = share, 1.0 - share
        affect[:, 15] = torch.from_numpy(self._intensity(frames)).float()
        return affect

    def _intensity(self, frames: int) -> np.ndarray:
        """Constant, a ramp, steps, or one episode that comes and goes: [T] in 0 … maximum."""
        random, top = self.random, self.options.maximum
        low, high = random.uniform(0, top, 2)
        kind = random.random()
        if kind < self.options.step_share:
            edges = np.sort(random.integers(0, frames, 2))
            inside = (np.arange(frames) >= edges[0]) & (np.arange(frames) < edges[1])
            return np.where(inside, high, low * (random.random() < 0.5))
        if kind < self.options.step_share + self.options.episode_share:
            return episode(frames, max(low, high), random)
        if kind < 0.75:
            return np.linspace(low, high, frames)
        return np.full(frames, high)


def expressions(data: Path) -> tuple[np.ndarray, np.ndarray]:
    """Displacement of each emotion at intensity 1, [15, 204] metres, in two parts.

    The first part lasts through speech; the second opens the mouth and yields to closures.
    """
    ict = IctLandmarks(data)
    parts = np.zeros((2, len(EMOTIONS), 68, 3), np.float32)
    for row, emotion in enumerate(EMOTIONS):
        for unit, strength in PROTOTYPES[emotion].items():
            for shape in AU_TO_ARKIT[unit]:
                parts[int(unit in OPENING), row] += strength * ict.mode(shape)
    flat = parts.reshape(2, len(EMOTIONS), 204)
    return flat[0], flat[1]


def uncrossed(felt: Tensor, spoken: Tensor) -> Tensor:
    """Parts inner lips [B, T, 204] that crossed by more than those of the speech itself."""
    felt = felt.clone()
    for upper, lower in INNER_PAIRS:
        up, low = 3 * upper + 1, 3 * lower + 1
        least = (spoken[..., up] - spoken[..., low]).clamp_max(LOWEST_GAP_M)
        missing = (least - felt[..., up] + felt[..., low]).clamp_min(0.0) / 2
        felt[..., up] += missing
        felt[..., low] -= missing
    return felt


def brief_closure(gap: Tensor) -> Tensor:
    """1 where the lips close in the middle of speech, 0 where they are open or at rest.

    `gap` [B, T] metres of opening over neutral. Closed for longer than 0.6 s is rest.
    """
    closed = (1.0 - gap / CLOSED_M).clamp(0, 1).numpy()
    resting = minimum_filter1d(closed, REST_FRAMES, axis=1, mode="nearest")
    resting = gaussian_filter1d(resting, 2.0, axis=1, mode="nearest")
    return torch.from_numpy(closed * (1.0 - resting))
