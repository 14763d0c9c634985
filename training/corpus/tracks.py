"""Reads the time series of a corpus folder: sound, blend weights, vertices, phones."""

import csv
import re
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import soundfile
from scipy.signal import resample_poly

from training.corpus.checked import CorpusError, number_of, read_npz, read_text
from training.corpus.faces import CHANNELS
from training.corpus.phones import Phone, segments
from training.corpus.topology import read_obj

SOUND_HZ = 16000
SHORTEST_S = 0.3
NAMED = {name.lower(): name for name in [*CHANNELS, "tongueOut"]}
NOT_WEIGHTS = {"timecode", "seconds", "blendshapecount", "frame", "time"}
TURNS = {f"{part}{axis}" for part in ("head", "lefteye", "righteye") for axis in ("yaw", "pitch", "roll")}


@dataclass
class Track:
    """Values over time: `values` [T, ...] at `seconds` [T], which ascend.

    `tracked_frames` [T] bool tells in which frames the tracker saw the face. `visible` [68] bool tells which
    landmarks the source observes; None means all.
    """

    values: np.ndarray
    seconds: np.ndarray
    tracked_frames: np.ndarray
    neutral: np.ndarray | None = None
    names: list[str] = field(default_factory=list)
    visible: np.ndarray | None = None


def read_weights(path: Path, fps: float | None) -> Track:
    """Reads ARKit weights from a csv, such as Live Link Face writes. Names may have any case."""
    with open(path, newline="", encoding="utf-8-sig") as file:
        table = [row for row in csv.reader(file) if row]
    heads = [name.strip().lower() for name in table[0]] if table else []
    known = [j for j, name in enumerate(heads) if name in NAMED]
    strange = [name for name in heads if name not in {*NAMED, *NOT_WEIGHTS, *TURNS}]
    if not known or strange:
        raise CorpusError(path, 1, "ARKit names (jawOpen, mouthSmileLeft, …)", strange or "none")
    if len(table) < 3:
        raise CorpusError(path, len(table), "two frames or more", len(table) - 1)
    values = np.zeros((len(table) - 1, len(known)), np.float32)
    for number, cells in enumerate(table[1:], 2):
        if len(cells) != len(heads):
            raise CorpusError(path, number, f"{len(heads)} cells", len(cells))
        values[number - 2] = [number_of(path, number, heads[j], cells[j]) for j in known]
    seconds = _csv_seconds(path, heads, table[1:], fps)
    backwards = np.flatnonzero(np.diff(seconds) <= 0)
    if len(backwards):
        at = int(backwards[0])
        raise CorpusError(path, at + 3, f"a time after {seconds[at]:.3f} s", f"{seconds[at + 1]:.3f} s")
    return Track(values, seconds, np.ones(len(values), bool), names=[NAMED[heads[j]] for j in known])


def _csv_seconds(path: Path, heads: list[str], rows: list[list[str]], fps: float | None) -> np.ndarray:
    """Times of the frames. Live Link Face's hours:minutes:seconds:frames count from the first frame."""
    if "seconds" in heads:
        at = heads.index("seconds")
        return np.array([number_of(path, n, "seconds", row[at]) for n, row in enumerate(rows, 2)])
    if fps is None:
        raise CorpusError(path, 1, "a column seconds, or fps.weights in corpus.json", "neither")
    if "timecode" not in heads:
        return np.arange(len(rows)) / fps
    at, seconds = heads.index("timecode"), []
    for number, row in enumerate(rows, 2):
        parts = re.split("[:;]", row[at])
        if len(parts) != 4:
            raise CorpusError(path, number, "Timecode: hours:minutes:seconds:frames", repr(row[at]))
        h, m, s, f = (number_of(path, number, "Timecode", part) for part in parts)
        seconds.append(3600 * h + 60 * m + s + f / fps)
    return np.array(seconds) - seconds[0]


def read_phones(path: Path) -> list[Phone]:
    """Reads phones/CLIP.tsv."""
    lines = read_text(path).splitlines()
    if not lines or lines[0].split("\t") != ["start_s", "duration_s", "phone"]:
        raise CorpusError(path, 1, "start_s, duration_s, phone", lines[0] if lines else "nothing")
    phones = []
    for number, line in enumerate(lines[1:], 2):
        cells = line.split("\t")
        if len(cells) != 3:
            raise CorpusError(path, number, "3 cells between tabs", len(cells))
        start, duration = (number_of(path, number, "seconds", cell) for cell in cells[:2])
        if duration <= 0 or start < 0:
            raise CorpusError(path, number, "start_s from 0 and duration_s above 0", cells[:2])
        if not segments(cells[2]):
            raise CorpusError(path, number, "phone: IPA or ARPABET", repr(cells[2]))
        phones.append(Phone(start, duration, cells[2]))
    return phones


def read_vertices(path: Path) -> tuple[np.ndarray, float | None]:
    """[T, V, 3] of .npy (mapped), .npz or a folder of .obj, and the frame rate if the file has it."""
    if path.is_dir():
        meshes = [read_obj(file)[0] for file in sorted(path.glob("*.obj"))]
        if not meshes or any(len(mesh) != len(meshes[0]) for mesh in meshes):
            raise CorpusError(path, None, ".obj files of one topology", [len(m) for m in meshes])
        return np.stack(meshes), None
    if path.suffix == ".npz":
        arrays = read_npz(path)
        fps = float(arrays["fps"]) if "fps" in arrays else None
        return np.asarray(arrays.get("vertices")), fps
    try:
        return np.load(path, mmap_mode="r"), None
    except (OSError, ValueError, EOFError) as error:
        raise CorpusError(path, None, "a numpy array", error) from error


def read_sound_any(path: Path) -> np.ndarray:
    """Reads mono samples [S] f32 at 16 kHz. The file must have that rate or a higher one."""
    try:
        samples, rate_hz = soundfile.read(path, dtype="float32", always_2d=True)
    except soundfile.LibsndfileError as error:
        raise CorpusError(path, None, "sound", error) from error
    if rate_hz < SOUND_HZ:
        raise CorpusError(path, None, f"{SOUND_HZ} samples a second or more", rate_hz)
    if len(samples) < SHORTEST_S * rate_hz:
        raise CorpusError(path, None, f"{SHORTEST_S} s of sound or more", f"{len(samples) / rate_hz:.2f} s")
    if not np.isfinite(samples).all():
        at = int(np.flatnonzero(~np.isfinite(samples).all(1))[0])
        raise CorpusError(path, at, "finite samples", samples[at])
    return mono_16_khz(samples, rate_hz)


def mono_16_khz(samples: np.ndarray, rate_hz: int) -> np.ndarray:
    """Samples [S, channels] at any rate → [S] f32 at 16 kHz."""
    mono = samples.mean(axis=1)
    return mono if rate_hz == SOUND_HZ else resample_poly(mono, SOUND_HZ, rate_hz).astype(np.float32)
