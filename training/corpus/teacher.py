"""Phones with times → ARKit weights → motion of ICT's landmarks: a co-articulation teacher.

Dominance functions of Cohen & Massaro 1993: every segment s has a target T_s for each channel and a
dominance `D_s(t) = α_s exp(-θ_s |τ|)` for each group of channels, with θ_s of its own before and
after (their exponent c is 1); a channel is `Σ D_s T_s / Σ D_s`. Pauses are segments whose targets
are the rest face.
Differs: τ is the distance from the segment's core (its middle half; all but 0.12 s at either end
of a pause), not from its centre. p, b and m override the sum: their lips meet.

`training.fit_teacher` fits targets, α and θ to the recorded motion of grid_s1 and writes
`teacher.json`. Recorded channels and ranges that the fit does not see stay near `articulation`.
"""

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from training.corpus.articulation import CHANNELS, GROUP_OF
from training.corpus.clip import FPS
from training.corpus.ict import IctLandmarks
from training.corpus.phones import PAUSE, SEGMENTS, Phone, bilabials, split

PARAMETERS = Path(__file__).with_name("teacher.json")
CORE_SHARE = 0.25
PAUSE_EDGE_S = 0.12
SHORTEST_PAUSE_S = 0.01
CHUNK_FRAMES = 200
REACH_S = 1.0
INNER_PAIRS = ((61, 67), (62, 66), (63, 65))
CLOSE_BEFORE_S, CLOSE_AFTER_S, EDGE_S = 0.05, 0.05, 0.01
CLOSED_GAP_M = -0.2e-3
SMALLEST_GAP_M = 0.1e-3
YIELDING = {
    "jawOpen": 0.75,
    "mouthFunnel": 0.75,
    "mouthLowerDown": 0.8,
    "mouthUpperUp": 0.8,
    "mouthShrugUpper": 0.8,
}
"""Share that a channel gives up where the lips close; `mouthClose` closes what is left."""


@dataclass
class Row:
    """The segments of an utterance and the pauses between them, each array [S].

    `core_s` is the middle of the core, `half_s` half its width; `index` counts in `SEGMENTS`.
    """

    core_s: np.ndarray
    half_s: np.ndarray
    index: np.ndarray


def row_of(phones: list[Phone], duration_s: float) -> Row:
    """Segments in order of time; what nobody speaks in 0 … `duration_s` is a pause."""
    parts, at = [], 0.0
    spoken = sorted(part for phone in phones for part in split(phone))
    for start, end, segment in [*spoken, (max(duration_s, 0.0) + 1.0, 0.0, "")]:
        if start - at > SHORTEST_PAUSE_S:
            parts.append((at, start, PAUSE))
        if segment:
            parts.append((start, max(end, start), segment))
            at = max(at, end)
    if parts and parts[0][2] == PAUSE:
        parts[0] = (parts[0][0] - 1.0, *parts[0][1:])
    start, end = (np.array([p[k] for p in parts]) for k in (0, 1))
    index = np.array([SEGMENTS.index(p[2]) for p in parts])
    pause = np.maximum((end - start) / 2 - PAUSE_EDGE_S, 0.0)
    half = np.where(index == 0, pause, (end - start) * CORE_SHARE)
    return Row((start + end) / 2, half, index)


@dataclass
class Teacher:
    """Fitted parameters and ICT's modes.

    `targets` [N, C]; `strengths` [N, G]; `rates` [2, N, G] in 1/s, before and after; `gains` [C].
    The face runs `lead_s` ahead of the phones.
    """

    targets: np.ndarray
    strengths: np.ndarray
    rates: np.ndarray
    lead_s: float
    gains: np.ndarray
    ict: IctLandmarks

    @staticmethod
    def load(
        data: Path | str = "../shared/data", style: str = "grid_s1", path: Path = PARAMETERS
    ) -> "Teacher":
        """The fitted teacher with the ranges of one style: grid_s1 or facegood_zh."""
        saved = json.loads(Path(path).read_text())
        if saved["segments"] != list(SEGMENTS) or saved["channels"] != list(CHANNELS):
            raise ValueError(f"{path}: expected today's segments and channels, got others; fit again")
        if style not in saved["gains"]:
            raise ValueError(f"style: expected one of {', '.join(saved['gains'])}, got {style}")
        arrays = {k: np.array(saved[k], np.float32) for k in ("targets", "strengths", "rates")}
        gains = np.array(saved["gains"][style], np.float32)
        return Teacher(**arrays, lead_s=saved["lead_s"], gains=gains, ict=IctLandmarks(Path(data)))

    def motion(
        self, phones: list[Phone], frames: int, fps: float = FPS, random: np.random.Generator | None = None
    ) -> np.ndarray:
        """Displacements [T, 68, 3] f32, canonical metres; frame t stands at t / fps seconds.

        `random` varies amplitude, balance and sharpness from utterance to utterance.
        """
        weights = self.channels(phones, frames, fps, random)
        modes = np.stack([self._mode(name) for name in CHANNELS]).reshape(len(CHANNELS), -1)
        return (weights.astype(np.float32) @ modes).reshape(frames, 68, 3)

    def weights(
        self, phones: list[Phone], frames: int, fps: float = FPS, random: np.random.Generator | None = None
    ) -> dict[str, np.ndarray]:
        """ARKit weights by name, each [T] in 0 … 1."""
        found = {}
        for name, column in zip(CHANNELS, self.channels(phones, frames, fps, random).T, strict=True):
            sides = ("Left", "Right") if f"{name}_L" in self.ict.modes else ("",)
            found |= {f"{name}{side}": column for side in sides}
        return found

    def channels(self, phones, frames: int, fps: float = FPS, random=None) -> np.ndarray:
        """Weights [T, C], lips closed for p, b and m."""
        gains, sharpness = self._variation(random)
        seconds = np.arange(frames) / fps
        row = row_of(phones, frames / fps)
        chunks = range(0, frames, CHUNK_FRAMES)
        smooth = [self._blend(row, seconds[a : a + CHUNK_FRAMES], sharpness) for a in chunks]
        weights = np.concatenate([np.zeros((0, len(CHANNELS))), *smooth]) * gains
        return self._close(weights.clip(0.0, 1.0), closure(phones, seconds))

    def _variation(self, random) -> tuple[np.ndarray, float]:
        """Gains [C] and sharpness of the dominance for one utterance."""
        if random is None:
            return self.gains, 1.0
        amplitude, balance = random.uniform(0.8, 1.2), random.uniform(-0.15, 0.15)
        group = amplitude * np.array(
            [1 + balance, 1.0, random.uniform(0.85, 1.2), random.uniform(0.7, 1.3), 1 - 2 * balance]
        )
        return self.gains * group[GROUP_OF], random.uniform(0.85, 1.2)

    def _blend(self, row: Row, seconds: np.ndarray, sharpness: float) -> np.ndarray:
        """Σ D T / Σ D at some neighbouring times, [t, C]."""
        at = seconds + self.lead_s
        near = (row.core_s + row.half_s > at[0] - REACH_S) & (row.core_s - row.half_s < at[-1] + REACH_S)
        index = row.index[near]
        offset = at[:, None] - row.core_s[near]
        before, after = (np.maximum(x - row.half_s[near], 0.0)[..., None] for x in (-offset, offset))
        fall = np.exp(-sharpness * (before * self.rates[0][index] + after * self.rates[1][index]))
        dominance = self.strengths[index] * fall + 1e-9
        dominance /= dominance.sum(axis=1, keepdims=True)
        return np.einsum("tsc,sc->tc", dominance[..., GROUP_OF], self.targets[index])

    def _close(self, weights: np.ndarray, shut: np.ndarray) -> np.ndarray:
        """Weights [T, C] whose lips meet where `shut` [T] is 1 and never cross."""
        weights = weights.copy()
        for name, share in YIELDING.items():
            weights[:, CHANNELS.index(name)] *= 1.0 - share * shut
        gaps = np.array([[self._gap(name, pair) for pair in INNER_PAIRS] for name in CHANNELS])
        jaw, close = CHANNELS.index("jawOpen"), CHANNELS.index("mouthClose")
        surplus = (weights @ gaps)[:, 1] - CLOSED_GAP_M
        weights[:, close] += shut * np.maximum(surplus, 0.0) / -gaps[close, 1]
        rest = np.array([self.ict.neutral[a, 1] - self.ict.neutral[b, 1] for a, b in INNER_PAIRS])
        missing = (SMALLEST_GAP_M - rest - weights @ gaps) / gaps[jaw]
        weights[:, jaw] += np.maximum(missing.max(axis=1), 0.0)
        return weights

    def _gap(self, channel: str, pair: tuple[int, int]) -> float:
        mode = self._mode(channel)
        return float(mode[pair[0], 1] - mode[pair[1], 1])

    def _mode(self, channel: str) -> np.ndarray:
        if f"{channel}_L" in self.ict.modes:
            return self.ict.modes[f"{channel}_L"] + self.ict.modes[f"{channel}_R"]
        return self.ict.modes[channel]


def closure(phones: list[Phone], seconds: np.ndarray) -> np.ndarray:
    """1 where p, b and m hold the lips together, 0 elsewhere, smooth within about one frame: [T]."""
    shut = np.zeros(len(seconds))
    for start, end in bilabials(phones):
        rise = (seconds - (start - CLOSE_BEFORE_S)) / (CLOSE_BEFORE_S + EDGE_S)
        fall = (end + CLOSE_AFTER_S - seconds) / (CLOSE_AFTER_S + EDGE_S)
        x = np.minimum(rise, fall).clip(0.0, 1.0)
        shut = np.maximum(shut, x * x * (3.0 - 2.0 * x))
    return shut
