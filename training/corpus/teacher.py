"""Phones with times → motion of the 68 landmarks: a co-articulation teacher.

It uses the dominance functions of Cohen & Massaro 1993. Every segment s has a target T_s for each component
of mouth motion and a dominance `D_s(t) = α_s exp(-θ_s |τ|)`, with separate θ_s before and after (their
exponent c is 1). A component is `Σ D_s T_s / Σ D_s`. Pauses are segments whose target is the rest face.
Unlike in the paper, τ is the distance from the segment's core, not from its centre. The core is the middle
half of a segment, or all of a pause but 0.12 s at either end. p, b and m override the sum: their lips meet.

The components are patterns of grid_s1's landmarks (`measure_basis`), so the teacher moves as that
speaker does. `training.corpus.fit_teacher` fits T, α and θ to his recorded motion and writes `teacher.json`.
He reads fast and hardly distinguishes vowels. Clear speech does (Lindblom 1990), so `CLARITY` moves the
targets of vowels by their textbook features.
"""

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from training.corpus.articulation import COMPONENTS
from training.corpus.clip import FPS
from training.corpus.closures import inner_depths, inner_gaps, narrowed
from training.corpus.phones import FEATURES, PAUSE, SEGMENTS, Phone, bilabials, feature_table, split

PARAMETERS = Path(__file__).with_name("teacher.json")
CORE_SHARE = 0.25
PAUSE_EDGE_S = 0.12
SHORTEST_PAUSE_S = 0.01
CHUNK_FRAMES = 200
REACH_S = 1.0
CLOSE_BEFORE_S, CLOSE_AFTER_S, EDGE_S = 0.05, 0.05, 0.01
CLOSED_GAP_M = -0.2e-3
LEAST_GAP_M = -0.5e-3
"""Opening of the lips where they meet, in metres relative to the neutral face (`CLOSED_GAP_M`).

Pressed lips have an opening of at least `LEAST_GAP_M`.
"""
CLARITY = {
    "chin": {"open": 0.9},
    "lower": {"open": -0.7},
    "width": {"round": -1.2, "front": 0.5},
    "protrusion": {"round": 1.3},
}
"""For each component, what a vowel's features add to its target. The values are our own choice.

The unit is one standard deviation of the speaker's motion.
"""
MIDDLE = {"open": 0.5, "round": 0.0, "front": 0.0}
LOWER_FACE = [*range(3, 14), *range(31, 36), *range(48, 68)]


@dataclass
class Row:
    """The segments of an utterance and the pauses between them, each array [S].

    `core_s` is the middle of the core, `half_s` half its width; `index` is the index into `SEGMENTS`.
    """

    core_s: np.ndarray
    half_s: np.ndarray
    index: np.ndarray


def row_of(phones: list[Phone], duration_s: float) -> Row:
    """Segments in order of time. Gaps between 0 and `duration_s` without a phone become pauses."""
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
    """Fitted parameters.

    `basis` [K, 68, 3] metres; `targets` [N, K]; `strengths` [N, K]; `rates` [2, N, K] in 1/s, before
    and after the core. The face runs `lead_s` ahead of the phones.
    """

    basis: np.ndarray
    targets: np.ndarray
    strengths: np.ndarray
    rates: np.ndarray
    lead_s: float

    @staticmethod
    def load(path: Path = PARAMETERS, clear: bool = True) -> "Teacher":
        """Loads the fitted teacher, which speaks clearly if `clear`, else as the recorded man does."""
        saved = json.loads(Path(path).read_text())
        if saved["segments"] != list(SEGMENTS) or saved["components"] != list(COMPONENTS):
            raise ValueError(f"{path}: expected today's segments and components, got others; fit again")
        arrays = {k: np.array(saved[k], np.float32) for k in ("basis", "targets", "strengths", "rates")}
        arrays["basis"] = arrays["basis"].reshape(len(COMPONENTS), 68, 3) * 1e-3
        teacher = Teacher(**arrays, lead_s=saved["lead_s"])
        if clear:
            teacher.targets = clearer(teacher.targets)
        return teacher

    def motion(
        self, phones: list[Phone], frames: int, fps: float = FPS, random: np.random.Generator | None = None
    ) -> np.ndarray:
        """Displacements [T, 68, 3] f32, canonical metres; frame t is at t / fps seconds.

        `random` varies amplitude, balance and sharpness from utterance to utterance.
        """
        gains, sharpness = _variation(random)
        seconds = np.arange(frames) / fps
        row = row_of(phones, frames / fps)
        chunks = range(0, frames, CHUNK_FRAMES)
        smooth = [self._blend(row, seconds[a : a + CHUNK_FRAMES], sharpness) for a in chunks]
        weights = np.concatenate([np.zeros((0, len(COMPONENTS))), *smooth]) * gains
        moved = (weights.astype(np.float32) @ self.basis.reshape(len(COMPONENTS), -1)).reshape(-1, 68, 3)
        return met(moved, closure(phones, seconds))

    def _blend(self, row: Row, seconds: np.ndarray, sharpness: float) -> np.ndarray:
        """Σ D T / Σ D at a few neighbouring times, [t, K]."""
        at = seconds + self.lead_s
        near = (row.core_s + row.half_s > at[0] - REACH_S) & (row.core_s - row.half_s < at[-1] + REACH_S)
        index = row.index[near]
        offset = at[:, None] - row.core_s[near]
        before, after = (np.maximum(x - row.half_s[near], 0.0)[..., None] for x in (-offset, offset))
        fall = np.exp(-sharpness * (before * self.rates[0][index] + after * self.rates[1][index]))
        dominance = self.strengths[index] * fall + 1e-9
        dominance /= dominance.sum(axis=1, keepdims=True)
        return np.einsum("tsk,sk->tk", dominance, self.targets[index])


def _variation(random) -> tuple[np.ndarray, float]:
    """Gains [K] and sharpness of the dominance for one utterance."""
    if random is None:
        return np.ones(len(COMPONENTS)), 1.0
    gains = random.uniform(0.85, 1.2) * random.uniform(0.85, 1.15, len(COMPONENTS))
    return gains, random.uniform(0.85, 1.2)


def clearer(targets: np.ndarray) -> np.ndarray:
    """Targets [N, K] with vowels moved by `CLARITY`."""
    f = dict(zip(FEATURES, feature_table().T, strict=True))
    f["front"] = f["front"] * (1.0 - f["round"])
    out = targets.copy()
    for component, shares in CLARITY.items():
        added = sum(share * (f[name] - MIDDLE[name]) for name, share in shares.items())
        out[:, COMPONENTS.index(component)] += added * f["vowel"]
    return out


def met(motion: np.ndarray, shut: np.ndarray) -> np.ndarray:
    """Makes the lips of motion [T, 68, 3] meet where `shut` [T] is 1, and never press too far."""
    gaps = inner_gaps(motion, np.zeros((68, 3), motion.dtype))
    target_gaps = gaps - shut[:, None] * np.maximum(gaps - CLOSED_GAP_M, 0.0)
    target_gaps = np.maximum(target_gaps, LEAST_GAP_M)
    depths = shut[:, None] * inner_depths(motion)
    return narrowed(motion, (gaps - target_gaps).astype(motion.dtype), depths.astype(motion.dtype))


def closure(phones: list[Phone], seconds: np.ndarray) -> np.ndarray:
    """1 where p, b and m hold the lips together, 0 elsewhere, smooth within about one frame: [T]."""
    shut = np.zeros(len(seconds))
    for start, end in bilabials(phones):
        rise = (seconds - (start - CLOSE_BEFORE_S)) / (CLOSE_BEFORE_S + EDGE_S)
        fall = (end + CLOSE_AFTER_S - seconds) / (CLOSE_AFTER_S + EDGE_S)
        x = np.minimum(rise, fall).clip(0.0, 1.0)
        shut = np.maximum(shut, x * x * (3.0 - 2.0 * x))
    return shut
