"""Small pictures on disk that show a face in every emotion, without speech."""

import contextlib
import hashlib
import os
import shutil
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from . import finding, library, model_card, picture
from .emotion import EMOTIONS, Share, mix
from .job import Progress
from .take import FaceMesh, Request, Sound

# Each emotion lasts this many seconds; its picture shows the middle. The take has one frame per
# second.
_HOLD_S = 2
_RATE_HZ = 16000
_THREADS = 4
# A new way of drawing needs a new number, so that older pictures are not reused.
_VERSION = 1
# How many sets of pictures are kept: the latest ones.
_KEPT = 60
# Landmarks of chin and brows. In heights between them: how far the centre of a picture is raised,
# and half of its side.
_CHIN, _BROWS = 8, slice(17, 27)
_ABOVE, _AROUND = 0.08, 0.70
# Controls that move a face beside its emotion; the pictures set them to 0.
STILL = (
    "blinks_per_minute", "head_motion", "gaze", "breath", "variety", "brow_accents", "noise",
)  # fmt: skip


@dataclass
class Portraits:
    """The pictures of one face at an intensity, drawn only once; `work` does not need Blender.

    `controls` are numbers by name, as in `Request`. The pictures have a folder of their own in
    `cache`.
    """

    face: FaceMesh
    intensity: float
    system: str
    controls: dict[str, float]
    cache: Path
    engine: Any = field(repr=False)

    def __post_init__(self):
        moving = {name: value for name, value in self.controls.items() if name not in STILL}
        self.controls = moving | dict.fromkeys(STILL, 0.0)
        self.folder = self.cache / self._key()

    def _key(self) -> str:
        models = self.engine.models
        library_file = library.library_path().stat()
        parts: tuple = (
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
        """True if all pictures exist."""
        return all(path_of(self.folder, name).is_file() for name in EMOTIONS)

    def work(self, progress: Progress) -> Path:
        """Draws the pictures unless all exist; returns the folder. Raises `AnyfaceError`."""
        if not self.are_drawn:
            points, triangles, view = self._faces(progress)
            self._write(points, triangles, view, progress)
            _forget(self.cache, self.folder)
        return self.folder

    def _faces(self, progress: Progress):
        """Points `[15, V, 3]` as a viewer sees them, triangles, and the view of the pictures."""
        positions, triangles, *marks = self.face.space.to_library(self.face)
        silence = np.zeros(_HOLD_S * len(EMOTIONS) * _RATE_HZ, dtype=np.float32)
        keys = []
        for number, name in enumerate(EMOTIONS):
            row, middle = mix([Share(name, self.intensity)]), number * _HOLD_S
            keys += [(max(middle - 0.45 * _HOLD_S, 0.0), row), (middle + 0.45 * _HOLD_S, row)]
        request = Request(
            fps=1.0,
            fields={"emotion": keys},
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
            # Another Blender may read the picture meanwhile, so it appears only once it is whole.
            half = path.with_suffix(f".{os.getpid()}")
            half.write_bytes(picture.png(picture.draw(faces[number], triangles, view)))
            half.replace(path)

        with ThreadPoolExecutor(_THREADS) as pool:
            # If a drawing fails, its error is raised here.
            list(pool.map(draw, range(len(EMOTIONS))))


def path_of(folder: Path, emotion: str) -> Path:
    """The path of an emotion's picture in the folder of a face."""
    return folder / f"{emotion}.png"


def _view(landmarks: np.ndarray) -> picture.View:
    """The view of the head around its landmarks `[68, 3]`."""
    chin, brows = landmarks[_CHIN, 1], landmarks[_BROWS, 1].mean()
    height = float(brows - chin)
    middle = float(landmarks[:, 0].mean()), float(brows + chin) / 2.0 + _ABOVE * height
    return picture.View(*middle, _AROUND * height)


def _forget(cache: Path, newest: Path) -> None:
    """Removes the oldest sets of pictures, so that `_KEPT` sets remain at most."""
    with contextlib.suppress(OSError):
        folders = [path for path in cache.iterdir() if path.is_dir() and path != newest]
        folders.sort(key=lambda path: path.stat().st_mtime_ns, reverse=True)
        for folder in folders[_KEPT - 1 :]:
            shutil.rmtree(folder, ignore_errors=True)
