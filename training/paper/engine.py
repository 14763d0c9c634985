"""The command as it is used: sound to landmarks, sound to a mesh, landmark motion to a mesh."""

import subprocess
import tempfile
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import soundfile

from training.corpus.clip import FPS
from training.corpus.tracks import SOUND_HZ


@dataclass
class Engine:
    """`anyface` at `binary`; `options` go with every call."""

    binary: Path
    options: list[str] = field(default_factory=list)

    def motion(self, samples: np.ndarray, emotion: str) -> np.ndarray:
        """Sound at 16 kHz to displacements of the landmarks, [T, 68, 3] canonical metres at 25 fps."""
        with tempfile.TemporaryDirectory() as folder:
            place = Path(folder)
            sound = _sound(place, samples)
            arrays = self._run("motion", place, "--audio", sound, *_asked(emotion))
        return arrays["landmark_displacements"]

    def mesh(self, samples: np.ndarray, emotion: str, mesh: Path, marks: Path, *more: str) -> np.ndarray:
        """Sound to displacements of a mesh, [T, V, 3] in its own units."""
        with tempfile.TemporaryDirectory() as folder:
            place = Path(folder)
            sound = _sound(place, samples)
            given = ("--mesh", mesh, "--landmarks", marks, "--audio", sound, *_asked(emotion), *more)
            arrays = self._run("animate", place, *given)
        return arrays["displacements"]

    def spread(
        self, motion: np.ndarray, neutral: np.ndarray, mesh: Path, marks: Path, *more: str
    ) -> np.ndarray:
        """Motion [T, 68, 3] about `neutral` [68, 3], mesh units, to displacements [T, V, 3]."""
        with tempfile.TemporaryDirectory() as folder:
            place = Path(folder)
            np.savez(place / "motion.npz", landmarks_neutral=neutral.astype(np.float32),
                     landmark_displacements=motion.astype(np.float32), fps=FPS)  # fmt: skip
            given = ("--mesh", mesh, "--landmarks", marks, "--motion", place / "motion.npz", *more)
            arrays = self._run("deform", place, *given)
        return arrays["displacements"]

    def attention(self, motion: np.ndarray, neutral: np.ndarray, mesh: Path, marks: Path) -> np.ndarray:
        """By which share each vertex attends to each landmark, [V, 68]: the paper's decoder, figure 7."""
        with tempfile.TemporaryDirectory() as folder:
            place = Path(folder)
            np.savez(place / "motion.npz", landmarks_neutral=neutral.astype(np.float32),
                     landmark_displacements=motion.astype(np.float32), fps=FPS)  # fmt: skip
            maps = place / "attention.npz"
            given = ("--mesh", mesh, "--landmarks", marks, "--motion", place / "motion.npz")
            self._run("deform", place, *given, "--decoder", "paper", "--attention", maps)
            return np.load(maps)["attention"]

    def _run(self, command: str, place: Path, *arguments) -> dict[str, np.ndarray]:
        out = place / "out.npz"
        line = [str(self.binary), command, *map(str, arguments), "--out", str(out), *self.options]
        done = subprocess.run(line, capture_output=True, text=True)
        if done.returncode:
            raise RuntimeError(f"{' '.join(line)}: {done.stderr.strip()}")
        with np.load(out) as file:
            return {name: file[name] for name in file}


def _sound(place: Path, samples: np.ndarray) -> Path:
    path = place / "sound.wav"
    soundfile.write(path, samples, SOUND_HZ, subtype="FLOAT")
    return path


def _asked(emotion: str) -> tuple[str, ...]:
    return "--fps", str(int(FPS)), "--emotion", emotion
