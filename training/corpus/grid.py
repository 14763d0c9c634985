"""GRID sentences with faces tracked in the video: 909 clips of one man, 73 clips of five other speakers.

GRID corpus, CC BY 4.0 (Cooke, Barker, Cunningham & Shao 2006); tracked by MediaPipe Face Landmarker
v2 (Apache-2.0), each frame by itself. Head motion is already removed. Depth is a monocular estimate.
The speakers blink and look down at the text. Their voices do not cause this, so the eye landmarks are
kept at rest and carry no weight. `tracked_lids` has what the tracker saw of the lids, for models that differ
between seeds.
"""

import json
from itertools import pairwise
from pathlib import Path

import numpy as np
from safetensors import safe_open
from scipy.ndimage import gaussian_filter1d

from training.align import similarity
from training.corpus.clip import Clip, inner_gap, read_sound
from training.corpus.ict import IctLandmarks
from training.corpus.split import grid_held_out

SOURCE = "grid_s1"
FIVE = "grid_five"
TRACK = "face_track.safetensors"
UNITS_PER_CM = 2000.0
SMOOTHING_FRAMES = 0.6
REST_SHARE = 0.05
EDGE_FRAMES = 6
EYES = list(range(36, 48))
INNER = slice(27, 68)


def read_grid(data: Path) -> list[Clip]:
    """All clips of grid_s1. Every tenth is held out."""
    return _read(data / "motion" / SOURCE)


def read_grid_five(data: Path) -> list[Clip]:
    """All clips of the five other speakers. None is held out: `leave_clips` leaves a speaker out."""
    return _read(data / "motion" / FIVE)


def _read(folder: Path) -> list[Clip]:
    """Clips of a folder. The motion of each speaker is rotated so that his neutral face fits ICT's; its size
    stays."""
    with safe_open(folder / TRACK, "np") as file:
        landmarks = file.get_tensor("landmarks").astype(np.float32) / UNITS_PER_CM
        tracked_frames = file.get_tensor("found").astype(bool)
        offsets = file.get_tensor("clip_offsets")
        names = json.loads(file.metadata()["clips"])
        speakers = json.loads(file.metadata().get("speakers", "null")) or ["s1"] * len(names)
    spans = [slice(a, b) for a, b in pairwise(offsets)]
    tracks = [_smooth(_fill(landmarks[span], ~tracked_frames[span])) for span in spans]
    ict = 100.0 * IctLandmarks(folder.parent.parent).neutral[INNER]
    held_out = grid_held_out(names) if folder.name == SOURCE else set()
    clips = []
    for speaker in dict.fromkeys(speakers):
        own = [i for i, name in enumerate(speakers) if name == speaker]
        neutral = rest_template([tracks[i] for i in own], [tracked_frames[spans[i]] for i in own])
        turn = similarity(neutral[INNER], ict).rotation
        for i in own:
            motion = ((tracks[i] - neutral) @ turn.T * 0.01).astype(np.float32)
            weight = np.repeat(tracked_frames[spans[i], None], 68, axis=1).astype(np.float32)
            motion[:, EYES], weight[:, EYES] = 0.0, 0.0
            clips.append(
                Clip(
                    name=names[i],
                    source=folder.name,
                    held_out=names[i] in held_out,
                    samples=read_sound(folder / "audio" / f"{names[i]}.ogg"),
                    motion=motion,
                    weight=weight,
                    neutral=(neutral @ turn.T * 0.01).astype(np.float32),
                )
            )
    return clips


def tracked_lids(data: Path, channels: list[str]) -> dict[tuple[str, str], np.ndarray]:
    """Tracked weights of the lids' `channels` from the speaker's usual pose on, by source and clip, [T, L].

    The tracker gives every speaker another weight at rest, and one who reads looks down all the time. So the
    median over the speaker's frames becomes 0 and full weight stays 1. Lost frames are interpolated.
    """
    lids = {}
    for source in (SOURCE, FIVE):
        with safe_open(data / "motion" / source / TRACK, "np") as file:
            columns = json.loads(file.metadata()["weight_names"])
            names = json.loads(file.metadata()["clips"])
            speakers = json.loads(file.metadata().get("speakers", "null")) or ["s1"] * len(names)
            weights = file.get_tensor("weights")[:, [columns.index(c) for c in channels]] / 255.0
            tracked_frames = file.get_tensor("found").astype(bool)
            offsets = file.get_tensor("clip_offsets")
        spans = [slice(a, b) for a, b in pairwise(offsets)]
        tracks = [_smooth(_fill(weights[span], ~tracked_frames[span])) for span in spans]
        for speaker in dict.fromkeys(speakers):
            own = [i for i, name in enumerate(speakers) if name == speaker]
            usual = np.median(np.concatenate([tracks[i] for i in own]), axis=0)
            for i in own:
                raised = np.clip((tracks[i] - usual) / (1.0 - usual), 0.0, 1.0)
                lids[source, names[i]] = raised.astype(np.float32)
    return lids


def _smooth(track: np.ndarray) -> np.ndarray:
    return gaussian_filter1d(track, SMOOTHING_FRAMES, axis=0, mode="nearest")


def _fill(track: np.ndarray, bad: np.ndarray) -> np.ndarray:
    """Linear interpolation over lost frames."""
    if not bad.any() or bad.all():
        return track
    time, good = np.arange(len(track)), ~bad
    flat = track.reshape(len(track), -1)
    columns = [np.interp(time, time[good], column[good]) for column in flat.T]
    return np.stack(columns, axis=1).reshape(track.shape)


def rest_template(tracks: list[np.ndarray], tracked_frames: list[np.ndarray]) -> np.ndarray:
    """Neutral face [68, 3]: the silent face with its lips together.

    The first and last quarter second of a GRID clip are silent. The mouth is at rest there, but often
    slightly open. So a line is fitted to each coordinate over the inner-lip gap of these frames, and read
    at the 5 % quantile of the gaps.
    """
    ends = [np.r_[:EDGE_FRAMES, len(t) - EDGE_FRAMES : len(t)] for t in tracks]
    edges = np.concatenate([t[e][s[e]] for t, s, e in zip(tracks, tracked_frames, ends, strict=True)])
    return closed_shape(edges)


def closed_shape(frames: np.ndarray) -> np.ndarray:
    """Shape [68, 3] of quiet frames [T, 68, 3] at the 5 % quantile of their inner-lip gaps."""
    gap = inner_gap(frames, np.zeros((68, 3), np.float32))
    slope, height = np.polyfit(gap, frames.reshape(len(frames), -1), 1)
    return (height + slope * np.quantile(gap, REST_SHARE)).reshape(68, 3)
