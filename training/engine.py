"""The command as users run it: sound to landmarks, sound to a mesh, landmark motion to a mesh."""

import json
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
    """The `anyface` command at `binary`. Every call gets `options`."""

    binary: Path
    options: list[str] = field(default_factory=list)

    def motion(self, samples: np.ndarray, emotion: str, fps: float = FPS) -> np.ndarray:
        """Sound at 16 kHz to displacements of the landmarks, [T, 68, 3] canonical metres at `fps`."""
        return self._speech("motion", samples, emotion, fps=fps)["landmark_displacements"]

    def mesh(self, samples: np.ndarray, emotion: str, mesh: Path, marks: Path, *more: str) -> np.ndarray:
        """Sound to displacements of a mesh, [T, V, 3] in its own units."""
        place = ("--mesh", mesh, "--landmarks", marks)
        return self._speech("animate", samples, emotion, *place, *more)["displacements"]

    def spread(
        self, motion: np.ndarray, neutral: np.ndarray, mesh: Path, marks: Path | None, *more: str
    ) -> np.ndarray:
        """Motion [T, 68, 3] about `neutral` [68, 3], mesh units, to displacements [T, V, 3]."""
        return self._spread(motion, neutral, mesh, marks, *more)["displacements"]

    def attention(self, motion: np.ndarray, neutral: np.ndarray, mesh: Path, marks: Path) -> np.ndarray:
        """How each vertex shares its attention among the landmarks, [V, 68] (figure 7 of the paper).

        Runs the paper's decoder.
        """
        with tempfile.TemporaryDirectory() as folder:
            maps = Path(folder) / "attention.npz"
            self._spread(motion, neutral, mesh, marks, "--decoder", "paper", "--attention", maps)
            return np.load(maps)["attention"]

    def run(self, command: str, *arguments) -> dict[str, np.ndarray]:
        """The arrays that a subcommand writes."""
        with tempfile.TemporaryDirectory() as folder:
            out = Path(folder) / "out.npz"
            self.call(command, *arguments, "--out", out)
            return dict(np.load(out))

    def run_with_report(self, command: str, *arguments) -> tuple[dict[str, np.ndarray], dict]:
        """The arrays and the report that a subcommand writes."""
        with tempfile.TemporaryDirectory() as folder:
            report = Path(folder) / "report.json"
            return self.run(command, *arguments, "--report", report), json.loads(report.read_text())

    def call(self, command: str, *arguments) -> None:
        """Runs a subcommand. If it fails, raises `RuntimeError` with its error message."""
        line = [str(self.binary), command, *map(str, arguments), *self.options]
        done = subprocess.run(line, capture_output=True, text=True)
        if done.returncode:
            raise RuntimeError(f"{' '.join(line)}: {done.stderr.strip()}")

    def _speech(
        self, command: str, samples: np.ndarray, emotion: str, *more, fps: float = FPS
    ) -> dict[str, np.ndarray]:
        with tempfile.TemporaryDirectory() as folder:
            sound = Path(folder) / "sound.wav"
            soundfile.write(sound, samples, SOUND_HZ, subtype="FLOAT")
            return self.run(command, "--audio", sound, "--fps", fps, "--emotion", emotion, *more)

    def _spread(self, motion: np.ndarray, neutral: np.ndarray, mesh: Path, marks: Path | None, *more):
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "motion.npz"
            np.savez(path, landmarks_neutral=neutral.astype(np.float32),
                     landmark_displacements=motion.astype(np.float32), fps=FPS)  # fmt: skip
            place = () if marks is None else ("--landmarks", marks)
            return self.run("deform", "--mesh", mesh, *place, "--motion", path, *more)
