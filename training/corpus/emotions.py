"""Expressions of the fifteen emotions on ICT's landmarks: the table that is added to neutral speech.

    python -m training.corpus.emotions       # prints what the shipped table moves in the six basic emotions

Emotion → action units → ARKit shapes → displacements. The prototypes of happy, sad, afraid, angry,
surprised, disgusted and contempt are those of Ekman & Friesen's tables (`happy 6+12`, …) with small
units added; ill borrows from the pain units 4, 7, 9 and 43 of Prkachin & Solomon 2008, ashamed lowers
its lids and presses its lips (Keltner 1995). We chose pleased, calm, upset, suspicious and drunk ourselves,
and all strengths. ICT's brows and corners move little at weight 1, so some weights exceed 1. A negative
weight moves a brow the other way where ICT has no shape for that. `manner` says how an emotion changes
articulation; `training.export expressions` writes both for `rust-core/src/motion/expression`.
"""

from pathlib import Path

import numpy as np

from training import shipped
from training.corpus.conditions import EMOTIONS
from training.corpus.faces import CHANNELS
from training.corpus.ict import IctLandmarks
from training.flags import run_command
from training.nn.checkpoint import read_arrays

AU_TO_ARKIT = {
    "1": ["browInnerUp"],
    "2": ["browOuterUp_L", "browOuterUp_R"],
    "2L": ["browOuterUp_L"],
    "4": ["browDown_L", "browDown_R"],
    "4R": ["browDown_R"],
    "5": ["eyeWide_L", "eyeWide_R"],
    "6": ["cheekSquint_L", "cheekSquint_R"],
    "7": ["eyeSquint_L", "eyeSquint_R"],
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
"""Units that part, lift or stretch the lips. Their effect on the mouth weakens when lips close."""
YIELDING = [*range(3, 14), *range(48, 68)]
BASIC = ("happy", "sad", "afraid", "angry", "surprised", "disgusted")
PROTOTYPES = {
    "neutral": {},
    "happy": {"6": 0.75, "12": 0.8, "10": 0.1},
    "pleased": {"6": 0.35, "12": 0.42, "14": 0.2, "1": 0.15},
    "calm": {"12": 0.15, "45": 0.28},
    "surprised": {"1": 1.0, "2": 1.0, "5": 0.9, "26": 0.2},
    "sad": {"1": 1.22, "2": -0.2, "4": 0.35, "7": 0.2, "15": 1.12, "17": 0.25, "45": 0.34},
    "upset": {"1": 0.6, "2": -0.2, "4": 0.9, "7": 0.2, "15": 0.55, "17": 0.25, "20": 0.2},
    "ashamed": {"1": 0.5, "14": 0.5, "15": 0.45, "28": 0.3, "45": 0.5},
    "afraid": {"1": 1.1, "2": 0.4, "4": 0.9, "5": 1.0, "7": 0.2, "16": 0.2, "20": 0.7, "26": 0.06},
    "angry": {
        **{"1": -0.3, "2": -0.22, "4": 1.0, "5": 0.6, "7": 0.8, "9": 0.35},
        **{"10": 0.1, "15": 0.4, "16": 0.25, "17": 0.2, "23": 0.4},
    },
    "disgusted": {"4": 0.3, "6": 0.4, "7": 0.6, "9": 0.95, "10": 0.42, "15": 0.85, "17": 0.4},
    "contempt": {"2L": 0.3, "7": 0.2, "10R": 0.25, "12R": 0.6, "14R": 0.7, "45": 0.1},
    "suspicious": {"2L": 0.7, "4": 0.15, "4R": 0.9, "7": 0.8, "23": 0.3},
    "ill": {"1": 0.3, "4": 0.5, "7": 0.35, "9": 0.2, "15": 0.35, "45": 0.4},
    "drunk": {"1": 0.4, "2": 0.3, "12": 0.1, "12L": 0.35, "26": 0.06, "45": 0.35, "45L": 0.15},
}


def expressions(data: Path) -> tuple[np.ndarray, np.ndarray]:
    """Displacement of each emotion at intensity 1, [15, 68, 3] canonical metres, in two parts.

    The first part lasts through speech. The second part opens or stretches the lips and yields to closures.
    """
    ict = IctLandmarks(data)
    parts = np.zeros((2, len(EMOTIONS), 68, 3), np.float32)
    for row, emotion in enumerate(EMOTIONS):
        for unit, strength in PROTOTYPES[emotion].items():
            for shape in AU_TO_ARKIT[unit]:
                moved = strength * ict.mode(shape)
                yields = np.zeros((68, 1), np.float32)
                yields[YIELDING] = unit in OPENING
                parts[0, row] += (1.0 - yields) * moved
                parts[1, row] += yields * moved
    return parts[0], parts[1]


def channel_of(shape: str) -> int:
    """The index in `CHANNELS` of a shape of `AU_TO_ARKIT`."""
    return CHANNELS.index(shape.replace("_L", "Left").replace("_R", "Right"))


def shape_weights() -> np.ndarray:
    """Each emotion at intensity 1 as weights of `CHANNELS`, [15, 51]."""
    rows = np.zeros((len(PROTOTYPES), len(CHANNELS)))
    for row, units in zip(rows, PROTOTYPES.values(), strict=True):
        for unit, strength in units.items():
            for shape in AU_TO_ARKIT[unit]:
                row[channel_of(shape)] += strength
    return rows


def strengths(motion: np.ndarray) -> dict[str, float]:
    """What an expression moves, in the unit of its landmark displacements [68, 3]. Both sides in the mean."""

    def up(*landmarks: int) -> float:
        return float(motion[list(landmarks), 1].mean())

    def apart(left: int, right: int) -> float:
        return float(motion[left, 0] - motion[right, 0])

    return {
        "inner brows up": up(21, 22),
        "mid brows up": up(19, 24),
        "brows nearer": -apart(22, 21),
        "lid gap": up(37, 38, 43, 44) - up(40, 41, 46, 47),
        "lower lids up": up(40, 41, 46, 47),
        "nostrils up": up(31, 35),
        "upper lip up": up(50, 51, 52),
        "corners up": up(48, 54),
        "corners apart": apart(54, 48),
        "chin up": up(8),
    }


def main() -> None:
    """Prints the table of the model card, mm at intensity 1."""
    parts = read_arrays(shipped("expressions"))
    moved = 1000.0 * (parts["lasting"] + parts["opening"]).numpy()
    rows = {emotion: strengths(moved[EMOTIONS.index(emotion)]) for emotion in BASIC}
    names = list(rows["happy"])
    print("| | " + " | ".join(names) + " |\n|" + " --- |" * (len(names) + 1))
    for emotion, row in rows.items():
        print(f"| {emotion} | " + " | ".join(f"{round(v, 1) + 0.0:.1f}" for v in row.values()) + " |")


if __name__ == "__main__":
    run_command(main)
