"""Tracks the faces of videos with MediaPipe's Face Landmarker, which also gave the ground truth of grid_s1.

Every frame is tracked by itself, because the video mode smooths and so lags by 18 ms. The folder has
`video/CLIP.mp4` (or .mov, .avi, .mkv, .mpg). It gets 68 landmarks in metres (one scale per clip, with the
head's motion), blend weights, and `head/CLIP.csv` (the head's rotation vector from the neutral pose, and its
position). ffmpeg extracts missing sounds. If clips.tsv is missing, it is written together with corpus.json.
The user supplies the model file. `pip install mediapipe` installs the rest, which only this module imports.
"""

import shutil
import subprocess
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from training.align import canonical_landmarks, steady
from training.corpus.checked import CorpusError
from training.corpus.folder import SOUNDS
from training.corpus.folder_clips import without_head
from training.corpus.readers.weights import split_of
from training.corpus.tracks import SOUND_HZ
from training.corpus.writer import CorpusWriter

VIDEOS = (".mp4", ".mov", ".avi", ".mkv", ".mpg", ".webm")
IBUG_OF_MESH = [
    162, 234, 93, 58, 172, 136, 149, 148, 152, 377, 378, 365, 397, 288, 323, 454, 389,
    71, 63, 105, 66, 107, 336, 296, 334, 293, 301, 168, 197, 5, 4, 75, 97, 2, 326, 305,
    33, 160, 158, 133, 153, 144, 362, 385, 387, 263, 373, 380,
    61, 39, 37, 0, 267, 269, 291, 405, 314, 17, 84, 181, 78, 82, 13, 312, 308, 317, 14, 87,
]  # fmt: skip
"""For each of the 68 iBUG landmarks, the nearest point of MediaPipe's mesh of 468 points or more."""
PICTURE_TO_FACE = np.array([1.0, -1.0, -1.0])
"""Turns MediaPipe's axes into the face's.

MediaPipe has +x to the right of the picture, +y down, +z away from the camera.
"""


@dataclass
class DetectedFace:
    """A face in a picture: points [478, 3] (x, z in picture widths, y in heights) and weights by name."""

    points: np.ndarray
    weights: dict[str, float]


Detect = Callable[[np.ndarray], DetectedFace | None]
"""Finds the face in an RGB picture [H, W, 3] u8. Returns None if there is no face."""


def track(folder: Path, model: Path) -> None:
    """Tracks every video of the folder."""
    detect = landmarker(model)
    videos = sorted(path for path in (folder / "video").glob("*") if path.suffix.lower() in VIDEOS)
    if not videos:
        raise CorpusError(folder / "video", None, f"videos, {', '.join(VIDEOS)}", "none")
    writer = CorpusWriter(folder, "tracked", "m", head="moves")
    for number, video in enumerate(videos):
        clip = video.stem
        pictures, fps = open_video(video)
        track_clip(writer, clip, pictures, fps, detect)
        if not any((folder / "audio" / f"{clip}{ending}").exists() for ending in SOUNDS):
            take_sound(video, writer.place("audio", f"{clip}.wav"))
        writer.clip(clip, "speaker", split_of(number))
        print(f"{clip}: tracked, {number + 1} of {len(videos)}", flush=True)
    if not (folder / "clips.tsv").exists():
        writer.close()


def track_clip(writer: CorpusWriter, clip: str, pictures: Iterable[np.ndarray], fps: float, detect: Detect):
    """Writes landmarks, weights and head pose of one clip. Frames without a face are marked as not found."""
    places, tracked_frames, weights = [], [], []
    for picture in pictures:
        face = detect(picture)
        tracked_frames.append(face is not None)
        if face is not None:
            size = np.array([picture.shape[1], picture.shape[0], picture.shape[1]])
            places.append(face.points[IBUG_OF_MESH] * size * PICTURE_TO_FACE)
            weights.append(face.weights)
    if len(places) < 2:
        raise CorpusError(writer.path / "video" / clip, None, "a face in two frames or more", len(places))
    metric = np.stack(places) * metres_per_pixel(np.stack(places))
    seconds, tracked_frames = np.arange(len(tracked_frames)) / fps, np.array(tracked_frames)
    landmarks = np.zeros((len(tracked_frames), 68, 3))
    landmarks[tracked_frames] = metric
    writer.landmarks(clip, landmarks.astype(np.float32), fps, found=tracked_frames)
    names = [name for name in weights[0] if name != "_neutral"]
    values = np.array([[frame[name] for name in names] for frame in weights])
    writer.weights(clip, names, values, seconds[tracked_frames])
    write_head(writer, clip, metric, seconds[tracked_frames])


def metres_per_pixel(places: np.ndarray) -> float:
    """Metres per unit of a clip [T, 68, 3]: the scale at which its steady landmarks have human distances."""
    weight = steady()[:, None]

    def spread(points: np.ndarray) -> np.ndarray:
        centred = points - (weight * points).sum(-2, keepdims=True)
        return np.sqrt((weight * centred**2).sum((-2, -1)))

    return float(spread(canonical_landmarks()) / np.median(spread(places)))


def write_head(writer: CorpusWriter, clip: str, landmarks: np.ndarray, seconds: np.ndarray) -> None:
    """Writes `head/CLIP.csv`: the head's turn from the neutral pose, radians, and its position, metres."""
    _, turns = without_head(landmarks, canonical_landmarks())
    vectors = Rotation.from_matrix(np.swapaxes(turns, 1, 2)).as_rotvec()
    rows = np.c_[seconds, vectors, landmarks.mean(axis=1)]
    head = "seconds,turn_x,turn_y,turn_z,x_m,y_m,z_m"
    np.savetxt(writer.place("head", f"{clip}.csv"), rows, "%.6f", ",", header=head, comments="")


def landmarker(model: Path) -> Detect:
    """MediaPipe's Face Landmarker with the user's model file, one picture at a time."""
    if not model.is_file():
        raise CorpusError(model, None, "a file, face_landmarker.task of MediaPipe", "none")
    try:
        import mediapipe
        from mediapipe.tasks.python import BaseOptions, vision
    except ImportError as error:
        packages = "pip install mediapipe opencv-python"
        raise ImportError(f"tracking needs MediaPipe ({packages}): {error}") from error
    options = vision.FaceLandmarkerOptions(
        base_options=BaseOptions(model_asset_path=str(model)),
        running_mode=vision.RunningMode.IMAGE,
        output_face_blendshapes=True,
        num_faces=1,
    )
    detector = vision.FaceLandmarker.create_from_options(options)

    def detect(picture: np.ndarray) -> DetectedFace | None:
        image = mediapipe.Image(image_format=mediapipe.ImageFormat.SRGB, data=np.ascontiguousarray(picture))
        result = detector.detect(image)
        if not result.face_landmarks:
            return None
        points = np.array([[p.x, p.y, p.z] for p in result.face_landmarks[0]])
        return DetectedFace(points, {c.category_name: c.score for c in result.face_blendshapes[0]})

    return detect


def open_video(path: Path) -> tuple[Iterable[np.ndarray], float]:
    """The RGB pictures of a video and its frame rate."""
    try:
        import cv2
    except ImportError as error:
        raise ImportError(f"videos need OpenCV (pip install opencv-python): {error}") from error
    video = cv2.VideoCapture(str(path))
    fps = video.get(cv2.CAP_PROP_FPS)
    if not video.isOpened() or not fps > 0:
        raise CorpusError(path, None, "a video", "nothing that OpenCV can read")

    def pictures() -> Iterable[np.ndarray]:
        while (read := video.read())[0]:
            yield cv2.cvtColor(read[1], cv2.COLOR_BGR2RGB)

    return pictures(), fps


def take_sound(video: Path, sound: Path) -> None:
    """Extracts the sound of a video as 16 kHz wav."""
    if shutil.which("ffmpeg") is None:
        raise CorpusError(sound, None, f"a sound, or ffmpeg to take it out of {video.name}", "neither")
    command = ["ffmpeg", "-v", "error", "-y", "-i", str(video), "-ac", "1", "-ar", str(SOUND_HZ), str(sound)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode:
        raise CorpusError(video, None, "a video with sound", done.stderr.strip())
