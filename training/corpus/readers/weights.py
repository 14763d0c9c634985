"""Corpora of blend weights: BEAT-style json, takes of Live Link Face."""

import csv
import re
from pathlib import Path

import numpy as np

from training.corpus.checked import CorpusError, read_json
from training.corpus.readers.tables import found_files, sound_of
from training.corpus.tracks import NAMED, read_weights
from training.corpus.writer import CorpusWriter

LIVE_LINK_FPS = 60.0
TEST_EVERY = 10


def split_of(number: int) -> str:
    """The split of a clip. Every tenth one is for testing."""
    return "test" if number % TEST_EVERY == TEST_EVERY - 1 else "train"


def beat(source: Path, folder: Path, landmarks: Path | None) -> Path:
    """Reads BEAT (Liu et al. 2022).

    SPEAKER/NAME.json has `names`, and `frames` of `weights` and `time`. A sound is beside it, and sometimes
    NAME.txt with the words. BEAT labels emotions in NAME.csv with rows (emotion, start, end, …). They are not
    read, so every emotion is unknown. `landmarks` is not used.
    """
    writer = CorpusWriter(folder, "beat", "m")
    for number, path in enumerate(found_files(source, "*.json")):
        names, values, seconds = read_beat(path)
        parts = path.stem.split("_")
        speaker = "_".join(parts[:2]) if len(parts) > 1 else path.parent.name
        text = path.with_suffix(".txt")
        words = text.read_text(encoding="utf-8") if text.exists() else ""
        writer.clip(path.stem, speaker, split_of(number), "unknown", text=words)
        writer.sound_file(path.stem, sound_of(path.parent, path.stem))
        writer.weights(path.stem, names, values, seconds)
    return writer.close()


def read_beat(path: Path) -> tuple[list[str], np.ndarray, np.ndarray]:
    """ARKit names [K], weights [T, K] and seconds [T]."""
    content = read_json(path)
    names, frames = content.get("names"), content.get("frames")
    if not isinstance(names, list) or not isinstance(frames, list) or len(frames) < 2:
        raise CorpusError(path, None, "names, and two frames or more", list(content))
    known = [j for j, name in enumerate(names) if str(name).lower() in NAMED]
    if not known:
        raise CorpusError(path, None, "ARKit names", names[:4])
    for number, frame in enumerate(frames):
        if len(frame.get("weights", [])) != len(names) or "time" not in frame:
            expected = f"a time and {len(names)} weights"
            raise CorpusError(path, number, expected, f"{len(frame.get('weights', []))} weights")
    values = np.array([frame["weights"] for frame in frames], float)[:, known]
    seconds = np.array([frame["time"] for frame in frames], float)
    return [NAMED[str(names[j]).lower()] for j in known], values, seconds


def live_link_face(source: Path, folder: Path, landmarks: Path | None) -> Path:
    """Reads takes of Live Link Face: TAKE/*_iPhone.csv and a sound of the same stem, extracted from the .mov.

    If the folders of takes are nested, the folder around each names the speaker. Otherwise all takes have the
    same speaker. `landmarks` is not used.
    """
    writer = CorpusWriter(folder, "live_link_face", "m")
    takes = [p for p in found_files(source, "*.csv") if not p.stem.endswith(("_raw", "_cal", "_neutral"))]
    for number, path in enumerate(takes):
        clip = re.sub(r"[^\w-]", "_", path.stem)
        nested = path.parent != source and path.parent.parent != source
        writer.clip(clip, path.parent.parent.name if nested else "phone", split_of(number))
        sound = sound_of(path.parent, path.stem)
        writer.sound_file(clip, sound)
        copy = _without_repeats(path, writer)
        track = read_weights(copy, LIVE_LINK_FPS)
        copy.unlink()
        writer.weights(clip, track.names, track.values, track.seconds)
    return writer.close()


def _without_repeats(path: Path, writer: CorpusWriter) -> Path:
    """A copy without repeated timecodes: the app repeats a row when no new frame has arrived."""
    with open(path, newline="", encoding="utf-8-sig") as file:
        head, *rows = [row for row in csv.reader(file) if row]
    at = [name.lower() for name in head].index("timecode") if "timecode" in map(str.lower, head) else None
    if at is None:
        raise CorpusError(path, 1, "a column Timecode", head[:3])
    new_rows = [rows[i] for i in range(len(rows)) if i == 0 or rows[i][at] != rows[i - 1][at]]
    copy = writer.place("weights", "partial.csv.tmp")
    with open(copy, "w", newline="") as file:
        csv.writer(file).writerows([head, *new_rows])
    return copy
