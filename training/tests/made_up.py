"""A small corpus folder made of noise that speaks, for tests."""

import itertools
from pathlib import Path

import numpy as np
from scipy.signal import lfilter

from training.align import canonical_landmarks
from training.corpus.folder_clips import arkit_modes
from training.corpus.writer import CorpusWriter

FPS = 25.0
RATE_HZ = 16000
SPEAKERS = {"ann": "train", "ben": "train", "cem": "test"}
EMOTIONS = {"ann": ("happy", 1.0), "ben": ("neutral", 0.0), "cem": ("sad", 0.5)}


def opening(seconds: np.ndarray, seed: int) -> np.ndarray:
    """How far the mouth opens, 0 to 1: syllables of random lengths between pauses."""
    random = np.random.default_rng(seed)
    ends = np.cumsum(random.uniform(0.12, 0.45, int(seconds[-1] / 0.1) + 10))
    height = np.where(random.random(len(ends)) < 0.3, 0.0, random.uniform(0.3, 1.0, len(ends)))
    at = np.searchsorted(ends, seconds)
    start = np.r_[0.0, ends][at]
    return height[at] * np.sin(np.pi * (seconds - start) / (ends[at] - start)) ** 2


def spoken(seconds: float, seed: int, lag_s: float = 0.0, stretch: float = 1.0) -> np.ndarray:
    """Noise as loud as the mouth is open, [S]."""
    times = np.arange(int(seconds * RATE_HZ)) / RATE_HZ
    envelope = np.interp(times, times * stretch + lag_s, opening(np.arange(times.size) / RATE_HZ, seed))
    noise = np.random.default_rng(seed).standard_normal(len(times))
    return (0.08 * (0.01 + envelope) * noise).astype(np.float32)


def talking(seconds: float, seed: int, fps: float = FPS) -> np.ndarray:
    """Landmarks [T, 68, 3] canonical metres."""
    times = np.arange(int(seconds * fps)) / fps
    modes, open_ = arkit_modes(), opening(np.arange(int(seconds * RATE_HZ)) / RATE_HZ, seed)
    at = np.minimum((times * RATE_HZ).astype(int), len(open_) - 1)
    wide = 0.3 * np.sin(3.0 * times + seed)[:, None, None] * modes["mouthSmileLeft"]
    still = 1e-5 * np.random.default_rng(seed).standard_normal((len(times), 68, 3))
    return canonical_landmarks() + 0.6 * open_[at][:, None, None] * modes["jawOpen"] + wide + still


def made_up(path: Path, seconds: float = 6.0, kind: str = "landmarks") -> Path:
    """A folder with three speakers, each with two clips of `kind`."""
    topology = "ball" if kind == "vertices" else None
    writer = CorpusWriter(path, "made_up", "m", topology=topology, fps={"vertices": FPS})
    for number, (speaker, split) in enumerate(SPEAKERS.items()):
        for take in range(2):
            clip, seed = f"{speaker}_{take}", 10 * number + take
            writer.clip(clip, speaker, split, *EMOTIONS[speaker], text="ba ba")
            writer.sound(clip, spoken(seconds, seed), RATE_HZ)
            _write_motion(writer, clip, kind, seconds, seed)
    if kind == "vertices":
        _write_ball(writer)
    return writer.close()


FELT = {"happy": (1.0, -0.9, {"mouthSmileLeft": 1.0, "mouthSmileRight": 1.0, "browInnerUp": 1.0}),
        "angry": (1.3, 0.9, {"mouthFrownLeft": 1.0, "mouthFrownRight": 1.0,
                             "browDownLeft": 1.0, "browDownRight": 1.0})}  # fmt: skip
"""For each emotion: factor on the duration of speech, dullness of the voice (−1 to 1), face weights."""


def felt_pairs(path: Path, sentences: int = 4, seconds: float = 2.4, intensity: float = 1.0) -> Path:
    """Vertex sequences of one speaker who says every sentence twice, in the emotions of `FELT`; the last two
    sentences are held out."""
    writer = CorpusWriter(path, "pairs", "m", topology="ball", fps={"vertices": FPS})
    for number in range(sentences):
        split = "test" if number >= sentences - 2 else "train"
        for take, (emotion, (slower, dull, face)) in enumerate(FELT.items()):
            clip = f"{number}_{emotion}"
            writer.clip(clip, "ann", split, emotion, intensity, text=f"Sentence {number}{'.!'[take]}")
            base = np.arange(int(seconds * RATE_HZ)) / RATE_HZ
            open_ = opening(base, 100 + number)
            times = np.arange(int(slower * seconds * RATE_HZ)) / RATE_HZ
            noise = lfilter([1.0], [1.0, -dull], np.random.default_rng(take).standard_normal(len(times)))
            loud = 0.01 + np.interp(times / slower, base, open_)
            writer.sound(clip, (0.08 * loud * noise / noise.std()).astype(np.float32), RATE_HZ)
            at = np.arange(int(slower * seconds * FPS)) / FPS / slower
            moved = sum(weight * arkit_modes()[name] for name, weight in face.items())
            jaw = 0.6 * np.interp(at, base, open_)[:, None, None] * arkit_modes()["jawOpen"]
            writer.vertices(clip, follow(canonical_landmarks() + jaw + moved))
    _write_ball(writer)
    return writer.close()


def felt_grades(path: Path, intensities: tuple[float, ...] = (0.5, 1.0)) -> Path:
    """Landmarks of a speaker who says three sentences of 2 s in the emotions of `FELT`, each in all strengths
    and in one voice, so that only the label tells them apart; the third is held out."""
    writer = CorpusWriter(path, "grades", "m")
    for number, (emotion, (_, _, face)), intensity in itertools.product(range(3), FELT.items(), intensities):
        clip, split = f"{number}_{emotion}_{intensity}", "test" if number == 2 else "train"
        writer.clip(clip, "ann", split, emotion, intensity, text=f"Sentence {number}")
        writer.sound(clip, spoken(2.0, number), RATE_HZ)
        worn = sum(intensity * weight * arkit_modes()[name] for name, weight in face.items())
        writer.landmarks(clip, talking(2.0, number) + worn, FPS, neutral=canonical_landmarks())
    return writer.close()


def _write_ball(writer: CorpusWriter) -> None:
    vertices, triangles = face_mesh()
    writer.mesh("neutral", vertices, triangles)
    table = writer.place("topologies/ball", "landmarks.json")
    table.write_text('{"vertices": ' + str(list(range(68))) + "}")


def _write_motion(writer: CorpusWriter, clip: str, kind: str, seconds: float, seed: int) -> None:
    landmarks = talking(seconds, seed)
    if kind == "landmarks":
        writer.landmarks(clip, landmarks, FPS, neutral=canonical_landmarks())
    elif kind == "vertices":
        writer.vertices(clip, follow(landmarks))
    else:
        times = np.arange(int(seconds * 60)) / 60.0
        at = np.minimum((times * RATE_HZ).astype(int), int(seconds * RATE_HZ) - 1)
        open_ = opening(np.arange(int(seconds * RATE_HZ)) / RATE_HZ, seed)[at]
        writer.weights(clip, ["jawOpen", "mouthSmileLeft"], np.stack([open_, 0.1 * open_], 1), times)


def face_mesh() -> tuple[np.ndarray, np.ndarray]:
    """A half ellipsoid behind the canonical landmarks, which are its first 68 vertices.

    Returns vertices [V, 3] m and triangles [F, 3].
    """
    from scipy.spatial import Delaunay

    grid = np.stack(np.meshgrid(np.linspace(-1, 1, 21), np.linspace(-1, 1, 21)), -1).reshape(-1, 2)
    grid = grid[(grid**2).sum(1) < 1.0]
    marks = canonical_landmarks()
    plane = np.r_[marks[:, :2], grid * [0.085, 0.12] + marks[:, :2].mean(0)]
    gone = np.linalg.norm(plane[68:, None] - plane[None, :68], axis=-1).min(1) < 0.004
    plane = np.r_[plane[:68], plane[68:][~gone]]
    squared = (((plane - marks[:, :2].mean(0)) / [0.09, 0.13]) ** 2).sum(axis=1)
    depth = 0.08 * np.sqrt(np.maximum(1.2 - squared, 0.01))
    return np.c_[plane, depth], Delaunay(plane).simplices.astype(np.int64)


def follow(landmarks: np.ndarray) -> np.ndarray:
    """Vertices [T, V, 3] of `face_mesh` that follow landmarks [T, 68, 3] m near them."""
    vertices, _ = face_mesh()
    near = np.exp(-0.5 * (np.linalg.norm(vertices[:, None] - vertices[None, :68], axis=-1) / 0.012) ** 2)
    near = near / np.maximum(near.sum(1, keepdims=True), 0.5)
    near[:68] = np.eye(68)
    return vertices + np.einsum("vn,tnx->tvx", near, landmarks - canonical_landmarks())
