"""What a textbook would have the mouth do for each segment: the start and the prior of the teacher.

Targets are ARKit weights, drawn from the articulatory features of `phones`; strengths and rates are
those of Cohen & Massaro's dominance functions ("Modeling coarticulation in synthetic visual
speech", 1993). k g h n t d s z are weak: they take the shape of their neighbours. All numbers here
are our own guesses; `training.fit_teacher` corrects them with recorded motion.
"""

import numpy as np

from training.corpus.phones import FEATURES, SEGMENTS, feature_table

CHANNELS = (
    "jawOpen",
    "mouthClose",
    "mouthFunnel",
    "mouthPucker",
    "mouthLowerDown",
    "mouthUpperUp",
    "mouthStretch",
    "mouthSmile",
    "mouthRollLower",
    "mouthRollUpper",
    "mouthPress",
    "mouthShrugLower",
    "mouthShrugUpper",
)
"""Speech channels; those with two sides move both alike."""

GROUPS = ("jaw", "close", "round", "spread", "height")
GROUP_OF = np.array([0, 1, 2, 2, 4, 4, 3, 3, 1, 1, 1, 1, 4])
"""Group of each channel: its channels share dominance functions."""

NARROWING = 0.12
"""Pucker of every segment: a mouth that speaks is narrower than one at rest (grid_s1, 1 mm)."""
SIBILANTS = "szʃʒʂʐɕʑ"
BILABIALS = "pbmʙ"


def targets() -> np.ndarray:
    """Weight of each channel at each segment's centre, [N, C] in 0 … 1."""
    f = dict(zip(FEATURES, feature_table().T, strict=True))
    speech = 1.0 - f["silence"]
    spread = (1.0 - f["round"]) * f["front"]
    sibilant = f["coronal"] * f["fricative"]
    shut = np.maximum(f["closed"], f["labiodental"])
    free = 1.0 - shut
    columns = {
        "jawOpen": speech * (0.05 + 0.26 * f["open"] + 0.02 * f["coronal"] * (1 - f["fricative"])) * free,
        "mouthClose": 0.04 * f["closed"],
        "mouthFunnel": 0.26 * f["round"],
        "mouthPucker": NARROWING * speech * free + 0.2 * f["round"] * f["high"] + 0.08 * f["round"],
        "mouthLowerDown": speech * free * (0.04 + 0.08 * f["open"] + 0.06 * sibilant),
        "mouthUpperUp": speech * (0.03 + 0.05 * f["open"] + 0.04 * sibilant + 0.07 * f["labiodental"]),
        "mouthStretch": 0.12 * spread * f["high"] + 0.06 * sibilant,
        "mouthSmile": 0.08 * spread * f["vowel"],
        "mouthRollLower": 0.30 * f["labiodental"] + 0.06 * f["closed"],
        "mouthRollUpper": 0.06 * f["closed"],
        "mouthPress": 0.12 * f["closed"],
        "mouthShrugLower": 0.12 * f["labiodental"] + 0.03 * f["closed"],
        "mouthShrugUpper": 0.05 * f["round"] * sibilant,
    }
    return np.stack([columns[name] for name in CHANNELS], axis=1).astype(np.float32)


def strengths() -> np.ndarray:
    """Dominance α of each segment in each group, [N, G]."""
    f = dict(zip(FEATURES, feature_table().T, strict=True))
    vowel, shut = f["vowel"], np.maximum(f["closed"], f["labiodental"])
    sibilant = np.array([float(s in SIBILANTS) for s in SEGMENTS])
    weak = 0.15 + 0.85 * vowel
    columns = {
        "jaw": weak + 0.5 * shut + 0.8 * sibilant + 0.25 * f["coronal"],
        "close": weak + 4.0 * shut,
        "round": 0.15 + 0.5 * vowel + 2.0 * f["round"],
        "spread": weak + 0.3 * sibilant,
        "height": weak + 2.5 * shut + 0.2 * sibilant,
    }
    silent = f["silence"][:, None]
    table = np.stack([columns[name] for name in GROUPS], axis=1)
    return (table * (1 - silent) + 0.7 * silent).astype(np.float32)


def rates() -> np.ndarray:
    """Fall θ of the dominance before and after the segment, [2, N, G], 1/s.

    Rounding starts early: its dominance falls slowly before the segment.
    """
    table = np.full((2, len(SEGMENTS), len(GROUPS)), 14.0, np.float32)
    table[0, :, GROUPS.index("round")] = 9.0
    return table
