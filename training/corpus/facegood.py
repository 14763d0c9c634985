"""facegood_zh: five takes of Mandarin with blend weights at 30 fps, MIT.

Only mouth and jaw were animated (every brow and lid weight is zero), so the landmarks of brows,
eyes and the upper face contour carry no weight.
"""

import csv
from pathlib import Path

import numpy as np
from scipy.interpolate import CubicSpline

from training.corpus.clip import FPS, Clip, read_sound
from training.corpus.ict import IctLandmarks
from training.corpus.split import facegood_first_held_out

SOURCE = "facegood_zh"
CAPTURE_FPS = 30.0
UNSEEN = [0, 1, 2, 14, 15, 16, *range(17, 27), *range(36, 48)]


def read_facegood(data: Path) -> list[Clip]:
    """The five takes, each cut in a training and a held-out part, on ICT's landmarks at 25 fps."""
    folder = data / "motion" / SOURCE
    ict = IctLandmarks(data)
    observed = np.ones(68, np.float32)
    observed[UNSEEN] = 0.0
    clips = []
    for path in sorted(folder.glob("*.arkit.csv")):
        name = path.name.removesuffix(".arkit.csv")
        motion = resample(ict.displace(read_arkit(path)), CAPTURE_FPS, FPS)
        samples = read_sound(folder / f"{name}.ogg")
        cut = facegood_first_held_out(len(motion))
        for held_out, span in ((False, slice(0, cut)), (True, slice(cut, len(motion)))):
            clips.append(
                Clip(
                    name=f"{name}/{'end' if held_out else 'start'}",
                    source=SOURCE,
                    held_out=held_out,
                    samples=samples[span.start * 640 : span.stop * 640],
                    motion=motion[span],
                    weight=np.tile(observed, (len(motion[span]), 1)),
                    neutral=ict.neutral,
                )
            )
    return clips


def read_arkit(path: Path) -> dict[str, np.ndarray]:
    """Columns of an ARKit csv by name, each [T]; the first column counts frames."""
    with open(path, newline="") as file:
        rows = list(csv.reader(file))
    values = np.array(rows[1:], dtype=np.float32)
    return {name: values[:, j] for j, name in enumerate(rows[0]) if not name.startswith("frame")}


def resample(motion: np.ndarray, from_fps: float, to_fps: float) -> np.ndarray:
    """[T, 68, 3] to another frame rate by a cubic spline."""
    seconds = np.arange(len(motion)) / from_fps
    frames = int(np.floor(seconds[-1] * to_fps)) + 1
    return CubicSpline(seconds, motion, axis=0)(np.arange(frames) / to_fps).astype(np.float32)
