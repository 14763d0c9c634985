"""Rows of the FreeTalk paper's tables 2 and 3, and of Sparse-To-Mesh alone, from corpus folders.

Truth and prediction are compared at 25 fps. The lips are landmarks 48 to 67, the upper face landmarks 17 to
26 and 36 to 47. On a mesh, the lips are the vertices within 1 cm of a lip landmark, the upper face those
within 1.5 cm of a brow or eye landmark (the paper prints no list). Motion is in millimetres on a head of
human size.
"""

import json
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.spatial.distance import cdist

from training.corpus.clip import FPS, Clip
from training.corpus.folder import CorpusFolder, Row
from training.corpus.folder_clips import clips as folder_clips
from training.engine import Engine
from training.paper.metrics import NAMES, measure

LIPS = np.arange(48, 68)
UPPER = np.r_[17:27, 36:48]
LIPS_WITHIN_M, UPPER_WITHIN_M = 0.01, 0.015
LONGEST_FRAMES = 250
"""At most this many frames of a clip are measured: DTW and DFD cost the square of the length."""
MM = 1000.0

Scores = dict[str, float]


@dataclass
class Table:
    """Metrics of each row, means over clips. `clips` and `points` say how many were measured."""

    corpus: str
    what: str
    rows: dict[str, Scores]
    clips: int
    points: int


def emotion_of(clip: Clip | Row) -> str:
    """Emotion that the command gets: the clip's label, or off if the clip has none."""
    return f"{clip.emotion}:{clip.intensity:g}" if clip.intensity > 0 else "off"


def landmark_table(folder: CorpusFolder, engine: Engine, count: int) -> Table | None:
    """Sound to landmarks on held-out clips; None if the folder has no held-out motion."""
    chosen = [clip for clip in folder_clips(folder) if clip.held_out][:count]
    if not chosen:
        return None
    rows: dict[str, list[Scores]] = {}
    for clip in chosen:
        frames = min(len(clip.motion), LONGEST_FRAMES)
        truth, visible = clip.motion[:frames], clip.weight[:frames].any(axis=0)
        labelled = emotion_of(clip) != "off"
        predictions = {"nothing moves": np.zeros_like(truth)}
        predictions["Anyface"] = engine.motion(clip.samples, emotion_of(clip))
        if labelled:
            predictions["Anyface, intensity 1"] = engine.motion(clip.samples, f"{clip.emotion}:1")
            predictions["Anyface, without the label"] = engine.motion(clip.samples, "neutral:0")
        for name, motion in predictions.items():
            lips, upper = LIPS[visible[LIPS]], UPPER[visible[UPPER]]
            rows.setdefault(name, []).append(scores_of(motion, truth, lips, upper))
    return Table(folder.name, "landmarks", means(rows), len(chosen), 68)


@dataclass
class Spoken:
    """A clip with vertices: truth [T, V, 3] m at 25 fps, its sound, and the files of its mesh."""

    row: Row
    truth: np.ndarray
    samples: np.ndarray
    neutral: np.ndarray
    landmarks: np.ndarray
    mesh: Path
    marks: Path
    unit_m: float


def spoken_meshes(folder: CorpusFolder, count: int, place: Path) -> Iterator[Spoken]:
    """Up to `count` held-out clips of vertex sequences."""
    left = count
    for row in folder.rows:
        track = folder.vertices(row) if row.held_out and left else None
        if track is None:
            continue
        left -= 1
        topology = folder.topology(row)
        samples = folder.sound(row)
        last_s = min(track.seconds[-1], len(samples) / 16000)
        seconds = np.arange(min(int(last_s * FPS) + 1, LONGEST_FRAMES)) / FPS
        places = CubicSpline(track.seconds, np.asarray(track.values, np.float32))(seconds)
        marks = place / f"{folder.name}.json"
        marks.write_text(json.dumps([int(v) for v in topology.nearest]))
        yield Spoken(row, folder.unit_m * places - topology.vertices, samples, topology.vertices,
                     topology.nearest, folder.mesh_file(row), marks, folder.unit_m)  # fmt: skip


def mesh_tables(folder: CorpusFolder, engine: Engine, count: int) -> list[Table]:
    """Tables of sound to mesh, and of true landmark motion to mesh (Sparse-To-Mesh alone)."""
    whole: dict[str, list[Scores]] = {}
    alone: dict[str, list[Scores]] = {}
    points = clips = 0
    with tempfile.TemporaryDirectory() as place:
        for clip in spoken_meshes(folder, count, Path(place)):
            near = cdist(clip.neutral, clip.neutral[clip.landmarks])
            lips = np.flatnonzero(near[:, LIPS].min(1) < LIPS_WITHIN_M)
            upper = np.flatnonzero(near[:, UPPER].min(1) < UPPER_WITHIN_M)
            points, clips = len(clip.neutral), clips + 1
            for rows, predictions in (
                (whole, _spoken_rows(clip, engine)),
                (alone, _spread_rows(clip, engine)),
            ):
                for name, motion in predictions:
                    rows.setdefault(name, []).append(scores_of(motion, clip.truth, lips, upper))
    tables = [("sound to mesh", whole), ("true landmarks to mesh", alone)]
    return [Table(folder.name, what, means(rows), clips, points) for what, rows in tables if rows]


def _spoken_rows(clip: Spoken, engine: Engine) -> Iterator[tuple[str, np.ndarray]]:
    yield "nothing moves", np.zeros_like(clip.truth)
    for name, more in (("Anyface", ()), ("Anyface, the paper's decoder", ("--decoder", "paper"))):
        moved = engine.mesh(clip.samples, emotion_of(clip.row), clip.mesh, clip.marks, *more)
        yield name, clip.unit_m * moved


DECODERS = {
    "static weights": (),
    "without what was learned": ("--learned", "0"),
    "the paper's decoder": ("--decoder", "paper"),
}


def _spread_rows(clip: Spoken, engine: Engine) -> Iterator[tuple[str, np.ndarray]]:
    yield "nothing moves", np.zeros_like(clip.truth)
    motion = clip.truth[:, clip.landmarks] / clip.unit_m
    neutral = clip.neutral[clip.landmarks] / clip.unit_m
    for name, more in DECODERS.items():
        yield name, clip.unit_m * engine.spread(motion, neutral, clip.mesh, clip.marks, *more)


def scores_of(motion: np.ndarray, truth: np.ndarray, lips: np.ndarray, upper: np.ndarray) -> Scores:
    frames = min(len(motion), len(truth))
    if not len(upper):
        scores = measure(MM * motion[:frames], MM * truth[:frames], lips, lips)
        return {name: np.nan if name in ("EVE", "FDD") else scores[name] for name in NAMES}
    return measure(MM * motion[:frames], MM * truth[:frames], lips, upper)


def means(rows: dict[str, list[Scores]]) -> dict[str, Scores]:
    return {name: {m: float(np.mean([s[m] for s in scores])) for m in NAMES} for name, scores in rows.items()}
