"""Every emotion drawn on a face: what it does to the mesh in silence, as small pictures on disk."""

import contextlib
import hashlib
import os
import shutil
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from . import finding, library, model_card, picture
from .emotion import EMOTIONS, Share, mix
from .job import Progress
from .take import FaceMesh, Request, Sound

# An emotion lasts so many seconds, its picture is taken in the middle. A take has a frame a second.
_HOLD_S = 2
_RATE_HZ = 16000
_THREADS = 4
# Other ways of drawing have other numbers.
_VERSION = 1
# Sets of pictures that are kept, the latest ones.
_KEPT = 60
# Chin and brows among the landmarks, and what a picture shows around them.
_CHIN, _BROWS = 8, slice(17, 27)
_ABOVE, _AROUND = 0.08, 0.70
# What moves a face beside its emotion.
STILL = (
    "blinks_per_minute", "head_motion", "gaze", "breath", "variety", "brow_accents", "noise",
)  # fmt: skip


@dataclass
class Portraits:
    """The pictures of one face at an intensity, made once; `work` needs nothing of Blender.

    `controls` are numbers by name, as in `Request`; the pictures lie in a folder of their own below
    `cache`.
    """

    face: FaceMesh
    intensity: float
    system: str
    controls: dict[str, float]
    cache: Path
    engine: object = field(repr=False)

    def __post_init__(self):
        moving = {name: value for name, value in self.controls.items() if name not in STILL}
        self.controls = moving | dict.fromkeys(STILL, 0.0)
        self.folder = self.cache / self._key()

    def _key(self) -> str:
        models = self.engine.models
        library_file = library.library_path().stat()
        parts = (
            _VERSION,
            library_file.st_size,
            library_file.st_mtime_ns,
            self.system,
            str(models or ""),
        )
        parts += (model_card.changed_ns(models) if models else 0, round(self.intensity, 3))
        parts += (sorted(self.controls.items()), finding.digest(self.face))
        return hashlib.blake2b(repr(parts).encode(), digest_size=12).hexdigest()

    @property
    def are_drawn(self) -> bool:
        """True where all pictures lie there."""
        return all(path_of(self.folder, name).is_file() for name in EMOTIONS)

    def work(self, progress: Progress) -> Path:
        """Draws what is not there yet and returns the folder; raises `AnyfaceError`."""
        if not self.are_drawn:
            faces = self._faces(progress)
            self._write(*faces, progress)
            _forget(self.cache, self.folder)
        return self.folder

    def _faces(self, progress: Progress):
        """Points `[15, V, 3]` as a viewer sees them, triangles, and what the pictures show."""
        positions, triangles, *marks = self.face.space.to_library(self.face)
        silence = np.zeros(_HOLD_S * len(EMOTIONS) * _RATE_HZ, dtype=np.float32)
        keys = []
        for number, name in enumerate(EMOTIONS):
            row, middle = mix([Share(name, self.intensity)]), number * _HOLD_S
            keys += [(max(middle - 0.45 * _HOLD_S, 0.0), row), (middle + 0.45 * _HOLD_S, row)]
        request = Request(
            fps=1.0,
            emotion=keys,
            error_mm=None,
            controls=self.controls,
            roles=self.face.roles,
        )
        with finding.searching(self.face):
            sound = Sound(silence, _RATE_HZ, "silence")
            animation = self.engine.animate(positions, triangles, *marks, sound, request, progress)
        turn, offset = animation.life.way[:, :3], animation.life.way[:, 3]
        moved = positions + animation.displacements[::_HOLD_S]
        view = _view(animation.landmarks.neutral @ turn.T + offset)
        return moved @ turn.T + offset, triangles, view

    def _write(self, faces, triangles, view, progress: Progress) -> None:
        self.folder.mkdir(parents=True, exist_ok=True)

        def draw(number: int) -> None:
            progress.check("write", number / len(EMOTIONS))
            path = path_of(self.folder, EMOTIONS[number])
            # Another Blender may read it meanwhile.
            half = path.with_suffix(f".{os.getpid()}")
            half.write_bytes(picture.png(picture.draw(faces[number], triangles, view)))
            half.replace(path)

        with ThreadPoolExecutor(_THREADS) as pool:
            # An error of any of them is raised here.
            list(pool.map(draw, range(len(EMOTIONS))))


def path_of(folder: Path, emotion: str) -> Path:
    """The picture of an emotion among those of a face."""
    return folder / f"{emotion}.png"


def _view(landmarks: np.ndarray) -> picture.View:
    """The head about its landmarks `[68, 3]`."""
    chin, brows = landmarks[_CHIN, 1], landmarks[_BROWS, 1].mean()
    height = float(brows - chin)
    middle = float(landmarks[:, 0].mean()), float(brows + chin) / 2.0 + _ABOVE * height
    return picture.View(*middle, _AROUND * height)


def _forget(cache: Path, newest: Path) -> None:
    """Removes the oldest sets of pictures where there are many."""
    with contextlib.suppress(OSError):
        folders = [path for path in cache.iterdir() if path.is_dir() and path != newest]
        folders.sort(key=lambda path: path.stat().st_mtime_ns, reverse=True)
        for folder in folders[_KEPT - 1 :]:
            shutil.rmtree(folder, ignore_errors=True)
