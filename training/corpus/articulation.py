"""How strongly each segment holds the mouth, after the textbook: start and prior of the teacher.

Strengths and rates are those of Cohen & Massaro's dominance functions ("Modeling coarticulation in
synthetic visual speech", 1993), drawn from the articulatory features of `phones`. k g h n t d s z
are weak: they take the shape of their neighbours. All numbers here are our own guesses, which
`training.corpus.fit_teacher` corrects with recorded motion.
"""

import numpy as np

from training.corpus.phones import FEATURES, SEGMENTS, feature_table

COMPONENTS = ("chin", "width", "protrusion", "upper", "lower", "corners")
"""Components of mouth motion. Each is a landmark pattern with its own dominance functions."""

SIBILANTS = "szʃʒʂʐɕʑ"


def strengths() -> np.ndarray:
    """Dominance α of each segment over each component, [N, K]."""
    f = dict(zip(FEATURES, feature_table().T, strict=True))
    vowel, shut = f["vowel"], np.maximum(f["closed"], f["labiodental"])
    sibilant = np.array([float(s in SIBILANTS) for s in SEGMENTS])
    weak = 0.15 + 0.85 * vowel
    height = weak + 2.5 * shut + 0.2 * sibilant
    rounding = 0.15 + 0.5 * vowel + 2.0 * f["round"]
    columns = {
        "chin": weak + 0.5 * shut + 0.8 * sibilant + 0.25 * f["coronal"],
        "width": np.maximum(rounding, weak) + 0.3 * sibilant,
        "protrusion": rounding,
        "upper": height,
        "lower": height,
        "corners": weak,
    }
    silent = f["silence"][:, None]
    table = np.stack([columns[name] for name in COMPONENTS], axis=1)
    return (table * (1 - silent) + 0.7 * silent).astype(np.float32)


def rates() -> np.ndarray:
    """Rate θ at which the dominance falls before and after the segment, [2, N, K], 1/s.

    Rounding starts early: its dominance falls slowly before the segment.
    """
    table = np.full((2, len(SEGMENTS), len(COMPONENTS)), 14.0, np.float32)
    table[0, :, [COMPONENTS.index("width"), COMPONENTS.index("protrusion")]] = 9.0
    return table
