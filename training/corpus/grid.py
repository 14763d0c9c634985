"""grid_s1: 909 clips of one man reading GRID sentences, landmarks estimated from video.

GRID corpus, CC BY 4.0 (Cooke, Barker, Cunningham & Shao 2006). Depth is weak and full closure is
under-reported; frame 0 of every clip has another crop and is dropped.
"""

import json
from itertools import pairwise
from pathlib import Path

import numpy as np
from safetensors import safe_open
from scipy.ndimage import gaussian_filter1d

from training.corpus.clip import FPS, Clip, inner_gap, read_sound
from training.corpus.ict import IctLandmarks
from training.corpus.split import grid_held_out

SOURCE = "grid_s1"
STABLE = [0, 16, 27, 28, 29, 30, 36, 39, 42, 45]
SMOOTHING_FRAMES = 0.6
LOST_CM = 4.0
REST_SHARE = 0.05
DROPPED = 1


def read_grid(data: Path) -> list[Clip]:
    """All clips; motion is scaled and turned so that the speaker's neutral fits ICT's."""
    folder = data / "motion" / SOURCE
    with safe_open(folder / "landmarks68.safetensors", "np") as file:
        landmarks = file.get_tensor("landmarks").astype(np.float32) / 2000.0
        offsets = file.get_tensor("clip_offsets")
        names = json.loads(file.metadata()["clips"])
    spans = [slice(a + DROPPED, b) for a, b in pairwise(offsets)]
    tracks, lost = _clean([landmarks[span] for span in spans], np.median(landmarks, axis=0))
    neutral = rest_template(tracks)
    scale, turn = similarity(neutral, IctLandmarks(data).neutral * 100.0)
    held_out = grid_held_out(names)
    clips = []
    for name, track, bad in zip(names, tracks, lost, strict=True):
        samples = read_sound(folder / "audio" / f"{name}.ogg")
        clips.append(
            Clip(
                name=name,
                source=SOURCE,
                held_out=name in held_out,
                samples=samples[int(DROPPED / FPS * 16000) :],
                motion=((track - neutral) @ turn.T * (scale * 0.01)).astype(np.float32),
                weight=np.repeat(~bad[:, None], 68, axis=1).astype(np.float32),
                neutral=(neutral @ turn.T * (scale * 0.01)).astype(np.float32),
            )
        )
    return clips


def _clean(tracks: list[np.ndarray], median: np.ndarray):
    """Fills lost frames, smooths lightly, removes each clip's residual pose."""
    cleaned, lost = [], []
    for track in tracks:
        bad = np.abs(track - median).max(axis=(1, 2)) > LOST_CM
        filled = _fill(track, bad)
        smooth = gaussian_filter1d(filled, SMOOTHING_FRAMES, axis=0, mode="nearest")
        turn, shift = rigid(np.median(smooth, axis=0)[STABLE], median[STABLE])
        cleaned.append(smooth @ turn.T + shift)
        lost.append(bad)
    return cleaned, lost


def _fill(track: np.ndarray, bad: np.ndarray) -> np.ndarray:
    """Linear interpolation over lost frames."""
    if not bad.any() or bad.all():
        return track
    time, good = np.arange(len(track)), ~bad
    flat = track.reshape(len(track), -1)
    columns = [np.interp(time, time[good], column[good]) for column in flat.T]
    return np.stack(columns, axis=1).reshape(track.shape)


def rest_template(tracks: list[np.ndarray]) -> np.ndarray:
    """Neutral face [68, 3]: the silent face with its lips together.

    The first and last quarter second of a GRID clip are silent; there the mouth is at rest, often
    slightly open. A line through every coordinate against the inner-lip gap of these frames is
    read at the 5 % quantile of gaps. (The plain median of the frames with the smallest gaps
    inherits the head pose of the few sessions they come from: 1 mm to one side.)
    """
    edges = np.concatenate([np.concatenate([track[:6], track[-6:]]) for track in tracks])
    gap = inner_gap(edges, np.zeros((68, 3), np.float32))
    slope, height = np.polyfit(gap, edges.reshape(len(edges), -1), 1)
    return (height + slope * np.quantile(gap, REST_SHARE)).reshape(68, 3)


def rigid(source: np.ndarray, target: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Rotation [3, 3] and shift [3] with target ≈ source @ Rᵀ + shift (Kabsch 1976)."""
    a, b = source - source.mean(axis=0), target - target.mean(axis=0)
    u, _, vt = np.linalg.svd(a.T @ b)
    sign = np.diag([1.0, 1.0, np.sign(np.linalg.det(vt.T @ u.T))])
    turn = vt.T @ sign @ u.T
    return turn, target.mean(axis=0) - source.mean(axis=0) @ turn.T


def similarity(source: np.ndarray, target: np.ndarray) -> tuple[float, np.ndarray]:
    """Scale and rotation between two landmark sets [68, 3] (eyes, nose, mouth; Umeyama 1991)."""
    inner = slice(27, 68)
    turn, _ = rigid(source[inner], target[inner])
    spread = [np.linalg.norm(x[inner] - x[inner].mean(axis=0)) for x in (source, target)]
    return float(spread[1] / spread[0]), turn
