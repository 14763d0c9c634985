"""Writes a corpus folder (see `folder`); every reader of a foreign source uses it."""

import json
import shutil
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import soundfile

from training.corpus.folder import COLUMNS
from training.corpus.phones import Phone, segments
from training.corpus.topology import write_obj

PLAIN = str.maketrans("\t\r\n", "   ")


@dataclass
class CorpusWriter:
    """Collects clips; `close` writes clips.tsv and corpus.json."""

    path: Path
    name: str
    unit: str
    head: str = "still"
    topology: str | None = None
    fps: dict[str, float] = field(default_factory=dict)
    rows: list[str] = field(default_factory=list)

    def clip(self, clip: str, speaker: str, split: str = "train", emotion: str = "neutral",
             intensity: float = 0.0, text: str = "") -> None:  # fmt: skip
        """Adds a row to clips.tsv."""
        cells = (clip, speaker, split, emotion, f"{intensity:g}", text.translate(PLAIN))
        self.rows.append("\t".join(cells))

    def sound_file(self, clip: str, source: Path) -> None:
        """Copies a sound. Its format must be one that `folder` reads."""
        shutil.copyfile(source, self.place("audio", f"{clip}{source.suffix.lower()}"))

    def sound(self, clip: str, samples: np.ndarray, rate_hz: int) -> None:
        """Writes samples [S] or [S, channels], in −1 … 1 or as 16-bit integers."""
        soundfile.write(self.place("audio", f"{clip}.wav"), samples, rate_hz)

    def landmarks(self, clip: str, landmarks: np.ndarray, fps: float, **others) -> None:
        """Writes landmarks [T, 68, 3]; others: `found` [T], `seen` [68], `neutral` [68, 3]."""
        np.savez(self.place("landmarks", f"{clip}.npz"), landmarks=landmarks, fps=fps, **others)

    def weights(self, clip: str, names: list[str], values: np.ndarray, seconds: np.ndarray) -> None:
        """Writes ARKit weights [T, K] at `seconds` [T]."""
        lines = [",".join(["seconds", *names])]
        for second, row in zip(seconds, values, strict=True):
            lines.append(",".join([f"{second:.6f}", *(f"{value:.6g}" for value in row)]))
        self.place("weights", f"{clip}.csv").write_text("\n".join(lines) + "\n")

    def phones(self, clip: str, phones: list[Phone]) -> None:
        """Writes phones with times. Leaves out phones with an unknown label."""
        lines = ["start_s\tduration_s\tphone"]
        lines += [f"{p.start_s:.4f}\t{p.duration_s:.4f}\t{p.label}" for p in phones if segments(p.label)]
        self.place("phones", f"{clip}.tsv").write_text("\n".join(lines) + "\n", encoding="utf-8")

    def vertices(self, clip: str, vertices: np.ndarray) -> None:
        """Writes vertices [T, V, 3] as f32."""
        np.save(self.place("vertices", f"{clip}.npy"), np.asarray(vertices, np.float32))

    def mesh(self, name: str, vertices: np.ndarray, triangles: np.ndarray) -> None:
        """Writes a neutral face of the topology. `name` is `neutral` or a speaker."""
        write_obj(self.place(f"topologies/{self.topology}", f"{name}.obj"), vertices, triangles)

    def landmark_table(self, source: Path) -> None:
        """Copies the table of the landmarks of the topology."""
        shutil.copyfile(source, self.place(f"topologies/{self.topology}", "landmarks.json"))

    def place(self, kind: str, name: str) -> Path:
        """Makes the folder of a file and returns the file's path."""
        folder = self.path / kind
        folder.mkdir(parents=True, exist_ok=True)
        return folder / name

    def close(self) -> Path:
        """Writes corpus.json and clips.tsv; returns the folder's path."""
        about = {"name": self.name, "unit": self.unit, "head": self.head, "fps": self.fps}
        if self.topology is not None:
            about["topology"] = self.topology
        self.place(".", "corpus.json").write_text(json.dumps(about, indent=1) + "\n")
        text = "\n".join(["\t".join(COLUMNS), *sorted(self.rows)]) + "\n"
        self.place(".", "clips.tsv").write_text(text, encoding="utf-8")
        return self.path
