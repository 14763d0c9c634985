"""Tracking of videos, with a landmarker that knows the truth in MediaPipe's place."""

import builtins

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from training.align import canonical_landmarks
from training.corpus import track
from training.corpus.__main__ import main
from training.corpus.check import check
from training.corpus.checked import CorpusError
from training.corpus.folder import CorpusFolder
from training.corpus.folder_clips import clips
from training.corpus.track import IBUG_OF_MESH, PICTURE_TO_FACE, DetectedFace
from training.corpus.writer import CorpusWriter
from training.tests.made_up import RATE_HZ, spoken, talking

SECONDS, LOST = 6.0, (30, 31)
WIDTH, HEIGHT = 640, 360


def truth() -> tuple[np.ndarray, np.ndarray]:
    """A talking face that nods, [T, 68, 3] m, and its rotation vectors [T, 3]."""
    face = talking(SECONDS, 1)
    vectors = np.zeros((len(face), 3))
    vectors[:, 0] = 0.1 * np.sin(np.arange(len(face)) / 9.0)
    return np.einsum("tij,tnj->tni", Rotation.from_rotvec(vectors).as_matrix(), face), vectors


def detector(faces: np.ndarray):
    """Sees the faces one after the other, 3000 pixels a metre."""
    left = iter(enumerate(faces))

    def detect(picture: np.ndarray) -> DetectedFace | None:
        number, face = next(left)
        if number in LOST:
            return None
        points = np.zeros((478, 3))
        pixels = 3000.0 * face * PICTURE_TO_FACE + [320.0, 180.0, 0.0]
        points[IBUG_OF_MESH] = pixels / [WIDTH, HEIGHT, WIDTH]
        return DetectedFace(points, {"_neutral": 0.9, "jawOpen": 0.1 + 0.001 * number, "browInnerUp": 0.0})

    return detect


@pytest.fixture
def tracked(tmp_path) -> CorpusFolder:
    """A folder with one tracked clip."""
    writer = CorpusWriter(tmp_path, "tracked", "m", head="moves")
    faces, _ = truth()
    pictures = [np.zeros((HEIGHT, WIDTH, 3), np.uint8)] * len(faces)
    track.track_clip(writer, "one", pictures, 25.0, detector(faces))
    writer.clip("one", "eve")
    writer.sound("one", spoken(SECONDS, 1), RATE_HZ)
    return CorpusFolder(writer.close())


def test_a_tracked_clip_is_a_corpus_in_metres(tracked):
    report = check(tracked.path)
    assert report.errors == [] and report.kinds == {"landmarks": 1, "weights": 1}
    assert not any("wide" in odd or "exchanged" in odd for odd in report.odd)
    landmarks = tracked.landmarks(tracked.rows[0])
    assert tuple(np.flatnonzero(~landmarks.tracked_frames)) == LOST
    eyes = np.linalg.norm(landmarks.values[0, 36] - landmarks.values[0, 45])
    canonical = canonical_landmarks()
    assert abs(eyes / np.linalg.norm(canonical[36] - canonical[45]) - 1.0) < 0.02


def test_head_is_told_and_taken_out(tracked):
    rows = np.loadtxt(tracked.path / "head/one.csv", delimiter=",", skiprows=1)
    _, vectors = truth()
    frames = np.delete(np.arange(len(vectors)), LOST)
    assert np.abs(rows[:, 1:4] - vectors[frames]).max() < 0.03
    motion = clips(tracked)[0].motion
    expected = talking(SECONDS, 1) - canonical_landmarks()
    drop = (motion - motion[0])[:, 8, 1], (expected - expected[0])[:, 8, 1]
    assert np.corrcoef(*drop)[0, 1] > 0.98


def test_weights_leave_the_lost_frames_out(tracked):
    weights = tracked.weights(tracked.rows[0])
    assert weights.names == ["jawOpen", "browInnerUp"]
    assert len(weights.seconds) == int(SECONDS * 25) - len(LOST)


def test_a_clip_without_a_face_is_told(tmp_path):
    writer = CorpusWriter(tmp_path, "tracked", "m")
    with pytest.raises(CorpusError, match="a face in two frames or more, found 0"):
        track.track_clip(writer, "one", [np.zeros((4, 4, 3), np.uint8)] * 5, 25.0, lambda picture: None)


def test_what_is_missing_is_told(tmp_path, capsys, monkeypatch):
    model = tmp_path / "face_landmarker.task"
    assert main(["track", str(tmp_path), "--model", str(model)]) == 1
    assert "face_landmarker.task of MediaPipe, found none" in capsys.readouterr().err
    model.write_bytes(b"x")
    real = builtins.__import__

    def without(name, *rest, **more):
        if name.startswith("mediapipe"):
            raise ImportError("No module named 'mediapipe'")
        return real(name, *rest, **more)

    monkeypatch.setattr(builtins, "__import__", without)
    assert main(["track", str(tmp_path), "--model", str(model)]) == 1
    assert "pip install mediapipe" in capsys.readouterr().err
