"""The corpus folder: the layout in which trainers read captures from other people.

    corpus.json          {"name": "mine", "unit": "m", "head": "moves", "topology": "flame",
                          "fps": {"landmarks": 25, "weights": 60, "vertices": 60}}
    clips.tsv            clip, speaker, split, emotion, intensity, text: one row per clip, tabs between
    audio/CLIP.wav       or .flac, .ogg; any rate of 16 kHz or more
    landmarks/CLIP.npz   `landmarks` [T, 68, 3]; may have `fps`, `found` [T], `seen` [68], `neutral`
    weights/CLIP.csv     a column for each ARKit name, and `seconds` or Live Link Face's `Timecode`
    vertices/CLIP.npy    [T, V, 3]; or .npz with `vertices` and `fps`, or a folder CLIP of .obj
    phones/CLIP.tsv      start_s, duration_s, phone (IPA or ARPABET)
    topologies/NAME/     neutral.obj, SPEAKER.obj if a speaker has a face of its own, landmarks.json

Sound is required, everything else is read if it is there. `unit` is m, cm or mm. `head` is `moves`
(its motion is removed) or `still`. `fps` must give a rate for files that do not state their own. `split` is
train, val or test. `emotion` is one of the fifteen names of `EMOTIONS`, or unknown. landmarks.json is the
output of `anyface landmarks`, or {"vertices": [68 numbers]}, or {"triangles": [68 numbers], "barycentric":
[68 triples]}. Every error is a `CorpusError` with file, row, what was expected and what was found.
"""

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from training.corpus.checked import (
    CorpusError,
    need_finite,
    need_shape,
    number_of,
    read_json,
    read_npz,
    read_text,
)
from training.corpus.conditions import EMOTIONS
from training.corpus.phones import Phone
from training.corpus.topology import Topology, topology_of
from training.corpus.tracks import Track, read_phones, read_sound_any, read_vertices, read_weights

COLUMNS = ("clip", "speaker", "split", "emotion", "intensity", "text")
SPLITS = ("train", "val", "test")
UNKNOWN_EMOTION = "unknown"
UNITS_M = {"m": 1.0, "cm": 0.01, "mm": 0.001}
HEADS = ("moves", "still")
SOUNDS = (".wav", ".flac", ".ogg")
STRONGEST = 1.5
"""Greatest intensity of an emotion that the model supports. Greater ones are rejected."""


@dataclass(frozen=True)
class Row:
    """One line of clips.tsv. `number` is its line number; the heading is line 1."""

    clip: str
    speaker: str
    split: str
    emotion: str
    intensity: float
    text: str
    number: int

    @property
    def held_out(self) -> bool:
        """Whether the clip is kept out of training."""
        return self.split != "train"


class CorpusFolder:
    """A corpus folder. Reads clips on demand."""

    def __init__(self, path: Path):
        self.path = path
        about = read_json(path / "corpus.json")
        self.name = self._of(about, "name", "a word of letters, digits, _", r"\w+")
        self.unit_m = UNITS_M[self._of(about, "unit", "m, cm or mm", "m|cm|mm")]
        self.head_moves = self._of(about, "head", "moves or still", "moves|still") == "moves"
        self.topology_name = about.get("topology")
        self.fps = about.get("fps", {})
        for kind, fps in self.fps.items():
            if not isinstance(fps, int | float) or not 1 <= fps <= 1000:
                raise CorpusError(path / "corpus.json", None, f"fps of {kind}: 1 to 1000", fps)
        self.rows = read_rows(path / "clips.tsv")

    def _of(self, about: dict, key: str, expected: str, pattern: str) -> str:
        value = about.get(key)
        if not isinstance(value, str) or not re.fullmatch(pattern, value):
            raise CorpusError(self.path / "corpus.json", None, f"{key}: {expected}", value)
        return value

    def file(self, kind: str, row: Row, endings: tuple[str, ...]) -> Path | None:
        """The file of a clip in the folder `kind`, or none."""
        for ending in endings:
            path = self.path / kind / f"{row.clip}{ending}"
            if path.exists():
                return path
        return None

    def rate(self, kind: str, path: Path) -> float:
        """Frame rate for a file that does not state one."""
        if kind not in self.fps:
            raise CorpusError(path, None, f"a rate: fps.{kind} in corpus.json", "none")
        return float(self.fps[kind])

    def sound(self, row: Row) -> np.ndarray:
        """Mono samples [S] f32 at 16 kHz."""
        path = self.file("audio", row, SOUNDS)
        if path is None:
            expected = f"audio/{row.clip} with one of {', '.join(SOUNDS)}"
            raise CorpusError(self.path / "clips.tsv", row.number, expected, "no such file")
        return read_sound_any(path)

    def landmarks(self, row: Row) -> Track | None:
        """`values` [T, 68, 3] metres."""
        path = self.file("landmarks", row, (".npz",))
        if path is None:
            return None
        arrays = read_npz(path)
        values = need_shape(path, arrays.get("landmarks"), (None, 68, 3), "landmarks")
        fps = float(arrays["fps"]) if "fps" in arrays else self.rate("landmarks", path)
        tracked_frames = np.asarray(arrays.get("found", np.ones(len(values))), bool)
        if tracked_frames.shape != (len(values),):
            raise CorpusError(path, None, f"found of shape ({len(values)},)", tracked_frames.shape)
        need_finite(path, values[tracked_frames], np.flatnonzero(tracked_frames))
        neutral = arrays.get("neutral")
        if neutral is not None:
            neutral = self.unit_m * need_shape(path, neutral, (68, 3), "neutral")
        visible = arrays.get("seen")
        if visible is not None:
            visible = need_shape(path, visible.astype(np.uint8), (68,), "seen").astype(bool)
        filled = np.where(tracked_frames[:, None, None], values, 0.0) * self.unit_m
        return Track(filled, np.arange(len(values)) / fps, tracked_frames, neutral, visible=visible)

    def weights(self, row: Row) -> Track | None:
        """`values` [T, K] of the ARKit channels `names`."""
        path = self.file("weights", row, (".csv",))
        return None if path is None else read_weights(path, self.fps.get("weights"))

    def vertices(self, row: Row) -> Track | None:
        """`values` [T, V, 3] in the folder's unit, memory-mapped if the file allows it."""
        path = self.file("vertices", row, (".npy", ".npz", ""))
        if path is None:
            return None
        values, fps = read_vertices(path)
        fps = self.rate("vertices", path) if fps is None else fps
        count = len(self.topology(row).vertices)
        need_shape(path, values, (None, count, 3), f"vertices of topology {self.topology_name}")
        for start in range(0, len(values), 64):
            part = np.asarray(values[start : start + 64])
            need_finite(path, part, np.arange(start, start + len(part)))
        return Track(values, np.arange(len(values)) / fps, np.ones(len(values), bool))

    def topology(self, row: Row) -> Topology:
        """The neutral mesh of the clip's speaker, metres."""
        if not isinstance(self.topology_name, str):
            expected = "topology: the name of a folder in topologies"
            raise CorpusError(self.path / "corpus.json", None, expected, self.topology_name)
        return topology_of(self.path / "topologies" / self.topology_name, row.speaker, self.unit_m)

    def mesh_file(self, row: Row) -> Path:
        """The file of the neutral mesh of the clip's speaker."""
        inside = self.path / "topologies" / self.topology_name
        speaker_file = inside / f"{row.speaker}.obj"
        return speaker_file if speaker_file.exists() else inside / "neutral.obj"

    def phones(self, row: Row) -> list[Phone] | None:
        """Phones with times; None if the clip has no phone file."""
        path = self.file("phones", row, (".tsv",))
        return None if path is None else read_phones(path)


def read_rows(path: Path) -> list[Row]:
    """All lines of clips.tsv, checked."""
    lines = read_text(path).splitlines()
    names = lines[0].split("\t") if lines else []
    missing = [c for c in COLUMNS if c not in names]
    if missing:
        raise CorpusError(path, 1, f"columns {', '.join(COLUMNS)}", f"no {', '.join(missing)}")
    rows: dict[str, Row] = {}
    for number, line in enumerate(lines[1:], 2):
        if not line.strip():
            continue
        cells = line.split("\t")
        if len(cells) != len(names):
            raise CorpusError(path, number, f"{len(names)} cells between tabs", len(cells))
        row = _row(path, number, dict(zip(names, cells, strict=True)))
        if row.clip in rows:
            raise CorpusError(path, number, "a new clip", f"{row.clip} of row {rows[row.clip].number}")
        rows[row.clip] = row
    if not rows:
        raise CorpusError(path, 2, "a clip", "no rows")
    return list(rows.values())


def _row(path: Path, number: int, cells: dict[str, str]) -> Row:
    if not re.fullmatch(r"[^/\\\x00]+", cells["clip"]) or cells["clip"].startswith("."):
        expected = "clip: a name without / that does not begin with ."
        raise CorpusError(path, number, expected, repr(cells["clip"]))
    if not cells["speaker"]:
        raise CorpusError(path, number, "speaker: a name", "nothing")
    if cells["split"] not in SPLITS:
        raise CorpusError(path, number, f"split: {', '.join(SPLITS)}", repr(cells["split"]))
    if cells["emotion"] not in (*EMOTIONS, UNKNOWN_EMOTION):
        expected = f"emotion: {', '.join(EMOTIONS)} or {UNKNOWN_EMOTION}"
        raise CorpusError(path, number, expected, repr(cells["emotion"]))
    intensity = number_of(path, number, "intensity", cells["intensity"])
    if not 0.0 <= intensity <= STRONGEST:
        raise CorpusError(path, number, f"intensity: 0 to {STRONGEST}", intensity)
    fixed = {name: cells[name] for name in ("clip", "speaker", "split", "emotion", "text")}
    return Row(**fixed, intensity=intensity, number=number)
