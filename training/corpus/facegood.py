"""facegood_zh: five takes of Mandarin with blend weights at 30 fps, MIT.

Only mouth and jaw were animated (every brow and lid weight is zero), so the landmarks of brows,
eyes and the upper face contour carry no weight.
"""

import csv
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from scipy.interpolate import CubicSpline

from training.corpus.clip import FPS, Clip, read_sound
from training.corpus.faces import CHANNELS
from training.corpus.ict import IctLandmarks
from training.corpus.split import facegood_first_held_out

SOURCE = "facegood_zh"
CAPTURE_FPS = 30.0
UNSEEN = [0, 1, 2, 14, 15, 16, *range(17, 27), *range(36, 48)]


def read_facegood(data: Path) -> list[Clip]:
    """The five takes on ICT's landmarks at 25 fps, each cut into a training and a held-out part."""
    folder = data / "motion" / SOURCE
    ict = IctLandmarks(data)
    observed = np.ones(68, np.float32)
    observed[UNSEEN] = 0.0
    clips = []
    for name, columns in arkit_takes(data):
        motion = resample(ict.displace(columns), CAPTURE_FPS, FPS)
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


def arkit_takes(data: Path, kind: type = np.float32) -> Iterator[tuple[str, dict[str, np.ndarray]]]:
    """Yields each take's name and the columns of its csv by name, each [T], without the frame numbers."""
    for path in sorted((data / "motion" / SOURCE).glob("*.arkit.csv")):
        with open(path, newline="") as file:
            rows = list(csv.reader(file))
        values = np.array(rows[1:], dtype=kind)
        columns = {name: values[:, j] for j, name in enumerate(rows[0]) if not name.startswith("frame")}
        yield path.name.removesuffix(".arkit.csv"), columns


def channel_rows(columns: dict[str, np.ndarray]) -> np.ndarray:
    """Columns as weights of `CHANNELS`, [T, 51]; 0 where a channel was not captured."""
    still = np.zeros_like(next(iter(columns.values())))
    return np.stack([columns.get(name, still) for name in CHANNELS], axis=1)


def resample(motion: np.ndarray, from_fps: float, to_fps: float) -> np.ndarray:
    """Resamples motion [T, ...] to another frame rate by a cubic spline."""
    seconds = np.arange(len(motion)) / from_fps
    frames = int(np.floor(seconds[-1] * to_fps)) + 1
    return CubicSpline(seconds, motion, axis=0)(np.arange(frames) / to_fps).astype(np.float32)
