"""Clips of a corpus folder as the trainers use them: landmark motion in canonical metres at 25 fps."""

import json
from functools import lru_cache

import numpy as np
from scipy.interpolate import CubicSpline

from training import shipped
from training.align import canonical_landmarks, similarity, steady
from training.corpus.checked import CorpusError
from training.corpus.clip import FPS, Clip
from training.corpus.folder import UNKNOWN_EMOTION, CorpusFolder, Row
from training.corpus.grid import closed_shape
from training.corpus.topology import Topology
from training.corpus.tracks import SOUND_HZ, Track
from training.nn.checkpoint import read_arrays

MODES = shipped("face_modes")
INNER = slice(27, 68)
QUIET_SHARE = 0.2
HOP = int(SOUND_HZ / FPS)
FEWEST_FRAMES = 8


def clips(folder: CorpusFolder) -> list[Clip]:
    """All clips with face motion: from landmarks, else from vertices, else from blend weights."""
    tracks = [(row, observed(folder, row)) for row in folder.rows]
    sounds = {row.clip: folder.sound(row) for row, track in tracks if track is not None}
    neutrals = speaker_neutrals([(row, track) for row, track in tracks if track], sounds)
    face_clips = []
    for row, track in tracks:
        if track is None:
            continue
        neutral = neutrals[row.speaker] if track.neutral is None else track.neutral
        motion, weight = displacement(track, neutral, folder.head_moves and not track.names)
        face_clips.append(_clip(folder, row, sounds[row.clip], motion, weight, track.seconds, neutral))
    return [clip for clip in face_clips if len(clip.motion) >= FEWEST_FRAMES]


def observed(folder: CorpusFolder, row: Row) -> Track | None:
    """Landmarks of one clip over time, [T, 68, 3] metres: as stored, else from vertices or weights."""
    track = folder.landmarks(row)
    if track is not None:
        return track
    track = folder.vertices(row)
    if track is not None:
        topology = folder.topology(row)
        return _of_vertices(track, topology, folder.unit_m)
    track = folder.weights(row)
    return None if track is None else _of_weights(track)


def blend_weights(folder: CorpusFolder, row: Row) -> Track | None:
    """ARKit weights of a clip that has neither landmarks nor vertices, else None."""
    landmarks, vertices = (
        folder.file("landmarks", row, (".npz",)),
        folder.file("vertices", row, (".npy", ".npz", "")),
    )
    return folder.weights(row) if landmarks is None and vertices is None else None


def _of_weights(track: Track) -> Track:
    modes, neutral = arkit_modes(), canonical_landmarks()
    moved = sum(w[:, None, None] * modes[n] for n, w in zip(track.names, track.values.T, strict=True))
    return Track(neutral + moved, track.seconds, track.tracked_frames, neutral, track.names)


def _of_vertices(track: Track, topology: Topology, unit_m: float) -> Track:
    places = unit_m * topology.landmarks(np.asarray(track.values, np.float32))
    return Track(places, track.seconds, track.tracked_frames, topology.landmarks(topology.vertices))


@lru_cache(maxsize=1)
def arkit_modes() -> dict[str, np.ndarray]:
    """Displacement of the landmarks at weight 1 of each ARKit channel, [68, 3] canonical metres."""
    names = json.loads((MODES / "config.json").read_text())["modes"]
    modes = dict(zip(names, read_arrays(MODES)["modes"].numpy(), strict=True))
    for name in list(modes):
        if name.endswith("_L"):
            stem = name[:-2]
            modes[f"{stem}Left"], modes[f"{stem}Right"] = modes[name], modes[f"{stem}_R"]
            modes.setdefault(stem, modes[name] + modes[f"{stem}_R"])
    return modes | {"tongueOut": np.zeros((68, 3), np.float32)}


def speaker_neutrals(tracks: list[tuple[Row, Track]], sounds) -> dict[str, np.ndarray]:
    """Neutral face [68, 3] m of each speaker whose tracks state none: from quiet frames, lips together."""
    quiet: dict[str, list[np.ndarray]] = {}
    for row, track in tracks:
        if track.neutral is not None:
            continue
        level = loudness(sounds[row.clip], track.seconds)
        chosen = (level <= np.quantile(level, QUIET_SHARE)) & track.tracked_frames
        quiet.setdefault(row.speaker, []).append(track.values[chosen])
    neutrals = {}
    for speaker, parts in quiet.items():
        frames = np.concatenate(parts)
        still, _ = without_head(frames, frames[len(frames) // 2]) if len(frames) else (frames, None)
        neutrals[speaker] = closed_shape(still) if len(frames) > 2 else np.zeros((68, 3))
    return neutrals


def displacement(track: Track, neutral: np.ndarray, head_moves: bool) -> tuple[np.ndarray, np.ndarray]:
    """Motion [T, 68, 3] relative to the neutral face, in canonical axes, and weight [T, 68]."""
    values = track.values
    if head_moves:
        values, _ = without_head(values, neutral)
    motion = (values - neutral) @ to_canonical_axes(neutral)
    weight = np.repeat(track.tracked_frames[:, None], 68, axis=1).astype(np.float32)
    if not track.tracked_frames.all() and track.tracked_frames.any():
        good = track.tracked_frames
        flat = motion.reshape(len(motion), -1)
        filled = [np.interp(track.seconds, track.seconds[good], column[good]) for column in flat.T]
        motion = np.stack(filled, axis=1).reshape(motion.shape)
    if track.names and not any(name.startswith(("brow", "eyeBlink")) for name in track.names):
        weight[:, [*range(17, 27), *range(36, 48)]] = 0.0
    if track.visible is not None:
        weight[:, ~track.visible] = 0.0
    return motion, weight


def to_canonical_axes(landmarks: np.ndarray) -> np.ndarray:
    """Rotation [3, 3] from the axes of a neutral face with these landmarks [68, 3] to canonical axes."""
    return similarity(landmarks[INNER], canonical_landmarks()[INNER]).rotation.T


def without_head(values: np.ndarray, neutral: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Aligns every frame of [T, 68, 3] rigidly to the neutral face by its steadiest landmarks.

    Also returns the rotations [T, 3, 3] that it used.
    """
    fit = similarity(values, neutral, steady())
    return (values - fit.centre[:, None]) @ np.swapaxes(fit.rotation, 1, 2) + fit.goal, fit.rotation


def loudness(samples: np.ndarray, seconds: np.ndarray) -> np.ndarray:
    """Level of the sound in the 40 ms around each time, [T] decibels."""
    power = np.concatenate([[0.0], np.cumsum(samples.astype(float) ** 2)])
    centre = (seconds * SOUND_HZ).astype(int)
    last = np.clip(centre + HOP // 2, 1, len(samples))
    first = np.clip(centre - HOP // 2, 0, last - 1)
    return 10.0 * np.log10((power[last] - power[first]) / (last - first) + 1e-9)


def _clip(folder: CorpusFolder, row: Row, samples, motion, weight, seconds, neutral) -> Clip:
    """A clip at 25 fps, cut to the shorter of sound and motion."""
    length_s = min(seconds[-1], len(samples) / SOUND_HZ)
    times = np.arange(int(length_s * FPS + 1e-6) + 1) / FPS
    if len(seconds) < 2:
        raise CorpusError(folder.path, row.number, "two frames of motion or more", len(seconds))
    at = np.minimum(np.searchsorted(seconds, times), len(seconds) - 1)
    return Clip(
        name=row.clip,
        source=folder.name,
        held_out=row.held_out,
        samples=samples[: len(times) * HOP],
        motion=CubicSpline(seconds, motion)(times).astype(np.float32),
        weight=weight[at],
        neutral=neutral.astype(np.float32),
        emotion="neutral" if row.emotion == UNKNOWN_EMOTION else row.emotion,
        intensity=0.0 if row.emotion == UNKNOWN_EMOTION else row.intensity,
        phones=folder.phones(row),
    )
