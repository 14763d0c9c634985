"""OpenFace 2 (Baltrušaitis et al. 2018): csv of 68 landmarks in millimetres beside the sound."""

from pathlib import Path

import numpy as np

from training.corpus.checked import CorpusError
from training.corpus.readers.tables import found_files, read_numbers, sound_of
from training.corpus.readers.weights import split_of
from training.corpus.writer import CorpusWriter

SURE = 0.8
"""A frame counts as tracked from this confidence on."""
CAMERA_TO_FACE = np.array([1.0, -1.0, -1.0])
"""Turns OpenFace's axes into the face's.

OpenFace has +x to the right of the picture (the subject's left), +y down, +z away from the camera.
"""


def openface(source: Path, folder: Path, landmarks: Path | None) -> Path:
    """Reads every NAME.csv of `FeatureExtraction -3Dfp` and the sound NAME beside it.

    Each folder is a speaker. `landmarks` is not used.
    """
    writer = CorpusWriter(folder, "openface", "mm", head="moves")
    for number, path in enumerate(found_files(source, "*.csv")):
        places, tracked_frames, fps = read_openface(path)
        speaker = path.parent.name if path.parent != source else "speaker"
        writer.clip(path.stem, speaker, split_of(number))
        writer.sound_file(path.stem, sound_of(path.parent, path.stem))
        writer.landmarks(path.stem, places, fps, found=tracked_frames)
    return writer.close()


def read_openface(path: Path) -> tuple[np.ndarray, np.ndarray, float]:
    """Landmarks [T, 68, 3] mm in the face's axes, which frames were tracked [T], and the frame rate."""
    axes = [f"{axis}_{i}" for axis in "XYZ" for i in range(68)]
    columns = read_numbers(path, ["timestamp", "confidence", "success", *axes])
    seconds = columns["timestamp"]
    if len(seconds) < 2 or (np.diff(seconds) <= 0).any():
        at = int(np.argmax(np.r_[np.diff(seconds) <= 0, True])) + 3
        raise CorpusError(path, at, "two frames or more with times that rise", f"{len(seconds)} frames")
    places = np.stack([[columns[f"{axis}_{i}"] for i in range(68)] for axis in "XYZ"], axis=-1)
    tracked_frames = (columns["success"] > 0) & (columns["confidence"] >= SURE)
    return (
        places.transpose(1, 0, 2) * CAMERA_TO_FACE,
        tracked_frames,
        float(1.0 / np.median(np.diff(seconds))),
    )
