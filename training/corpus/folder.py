"""The corpus folder: the one layout from which every trainer reads captures that are not ours.

    corpus.json          {"name": "mine", "unit": "m", "head": "moves", "topology": "flame",
                          "fps": {"landmarks": 25, "weights": 60, "vertices": 60}}
    clips.tsv            clip, speaker, split, emotion, intensity, text: one row a clip, tabs between
    audio/CLIP.wav       or .flac, .ogg; any rate from 16 kHz on
    landmarks/CLIP.npz   `landmarks` [T, 68, 3]; may have `fps`, `found` [T], `neutral` [68, 3]
    weights/CLIP.csv     a column for each ARKit name, and `seconds` or Live Link Face's `Timecode`
    vertices/CLIP.npy    [T, V, 3]; or .npz with `vertices` and `fps`, or a folder CLIP of .obj
    phones/CLIP.tsv      start_s, duration_s, phone (IPA or ARPABET)
    topologies/NAME/     neutral.obj, SPEAKER.obj where a speaker has a face of its own, landmarks.json

Sound is needed, everything else is read where it is there. `unit` is m, cm or mm, `head` is `moves`
(its motion is taken out) or `still`; rates are needed of what does not carry its own. `split` is train,
val or test. `emotion` is one of the fifteen names of `EMOTIONS`, or unknown. landmarks.json is what
`anyface landmarks` writes, or {"vertices": [68 numbers]}, or {"triangles": [68 numbers], "barycentric":
[68 triples]}. Every error is a `CorpusError`: file, row, what was expected and what was found.
"""

from __future__ import annotations

import csv
import json
import math
import re
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path

import numpy as np
import soundfile
from scipy.signal import resample_poly

from training.corpus.faces import CHANNELS
from training.corpus.phones import Phone, segments
from training.systems.freetalk.ats import EMOTIONS

COLUMNS = ("clip", "speaker", "split", "emotion", "intensity", "text")
SPLITS = ("train", "val", "test")
UNKNOWN_EMOTION = "unknown"
UNITS_M = {"m": 1.0, "cm": 0.01, "mm": 0.001}
HEADS = ("moves", "still")
SOUNDS = (".wav", ".flac", ".ogg")
SOUND_HZ = 16000
SHORTEST_S = 0.3
STRONGEST = 1.5
"""Greatest intensity of an emotion that the model knows."""
NAMED = {name.lower(): name for name in [*CHANNELS, "tongueOut"]}
NOT_WEIGHTS = {"timecode", "seconds", "blendshapecount", "frame", "time"}
TURNS = {f"{part}{axis}" for part in ("head", "lefteye", "righteye") for axis in ("yaw", "pitch", "roll")}


class CorpusError(ValueError):
    """A corpus that cannot be read: `file`, `row` (none for the whole file), `expected`, `found`."""

    def __init__(self, file: Path, row: int | str | None, expected: str, found: object):
        self.file, self.row, self.expected, self.found = file, row, expected, found
        place = str(file) if row is None else f"{file}, row {row}"
        super().__init__(f"{place}: expected {expected}, found {found}")


@dataclass(frozen=True)
class Row:
    """One line of clips.tsv; `number` counts from 1, the heading."""

    clip: str
    speaker: str
    split: str
    emotion: str
    intensity: float
    text: str
    number: int

    @property
    def held_out(self) -> bool:
        """Whether training must not see it."""
        return self.split != "train"


@dataclass
class Track:
    """Something over time: `values` [T, ...], `seconds` [T] ascending, `found` [T] bool."""

    values: np.ndarray
    seconds: np.ndarray
    found: np.ndarray
    neutral: np.ndarray | None = None
    names: list[str] = field(default_factory=list)


@dataclass
class Topology:
    """A neutral mesh: `vertices` [V, 3] m, `triangles` [F, 3], landmarks as `corners` [68, 3] vertex
    numbers and their `shares` [68, 3]."""

    vertices: np.ndarray
    triangles: np.ndarray
    corners: np.ndarray
    shares: np.ndarray

    def landmarks(self, vertices: np.ndarray) -> np.ndarray:
        """Places of the landmarks on `vertices` [..., V, 3]: [..., 68, 3]."""
        return np.einsum("nk,...nkx->...nx", self.shares, vertices[..., self.corners, :])

    @property
    def nearest(self) -> np.ndarray:
        """The vertex that counts most for each landmark, [68]."""
        return self.corners[np.arange(68), self.shares.argmax(1)]


class CorpusFolder:
    """A corpus folder; reads clips on demand."""

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
        """Frames a second of a file that does not say so itself."""
        if kind not in self.fps:
            raise CorpusError(path, None, f"a rate: fps.{kind} in corpus.json", "none")
        return float(self.fps[kind])

    def sound(self, row: Row) -> np.ndarray:
        """Mono samples [S] f32 at 16 kHz."""
        path = self.file("audio", row, SOUNDS)
        if path is None:
            wanted = f"audio/{row.clip} with one of {', '.join(SOUNDS)}"
            raise CorpusError(self.path / "clips.tsv", row.number, wanted, "no such file")
        return read_sound_any(path)

    def landmarks(self, row: Row) -> Track | None:
        """`values` [T, 68, 3] metres."""
        path = self.file("landmarks", row, (".npz",))
        if path is None:
            return None
        arrays = read_npz(path)
        values = need_shape(path, arrays.get("landmarks"), (None, 68, 3), "landmarks")
        fps = float(arrays["fps"]) if "fps" in arrays else self.rate("landmarks", path)
        found = np.asarray(arrays.get("found", np.ones(len(values))), bool)
        if found.shape != (len(values),):
            raise CorpusError(path, None, f"found of shape ({len(values)},)", found.shape)
        need_finite(path, values[found], np.flatnonzero(found))
        neutral = arrays.get("neutral")
        if neutral is not None:
            neutral = self.unit_m * need_shape(path, neutral, (68, 3), "neutral")
        filled = np.where(found[:, None, None], values, 0.0) * self.unit_m
        return Track(filled, np.arange(len(values)) / fps, found, neutral)

    def weights(self, row: Row) -> Track | None:
        """`values` [T, K] of the ARKit channels `names`."""
        path = self.file("weights", row, (".csv",))
        return None if path is None else read_weights(path, self.fps.get("weights"))

    def vertices(self, row: Row) -> Track | None:
        """`values` [T, V, 3] in the folder's unit, mapped from the file where it can be."""
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
            wanted = "topology: the name of a folder in topologies"
            raise CorpusError(self.path / "corpus.json", None, wanted, self.topology_name)
        return _topology(self.path / "topologies" / self.topology_name, row.speaker, self.unit_m)

    def phones(self, row: Row) -> list[Phone] | None:
        """Phones with times."""
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
        wanted = "clip: a name without / that does not begin with ."
        raise CorpusError(path, number, wanted, repr(cells["clip"]))
    if not cells["speaker"]:
        raise CorpusError(path, number, "speaker: a name", "nothing")
    if cells["split"] not in SPLITS:
        raise CorpusError(path, number, f"split: {', '.join(SPLITS)}", repr(cells["split"]))
    if cells["emotion"] not in (*EMOTIONS, UNKNOWN_EMOTION):
        wanted = f"emotion: {', '.join(EMOTIONS)} or {UNKNOWN_EMOTION}"
        raise CorpusError(path, number, wanted, repr(cells["emotion"]))
    intensity = number_of(path, number, "intensity", cells["intensity"])
    if not 0.0 <= intensity <= STRONGEST:
        raise CorpusError(path, number, f"intensity: 0 to {STRONGEST}", intensity)
    fixed = {name: cells[name] for name in ("clip", "speaker", "split", "emotion", "text")}
    return Row(**fixed, intensity=intensity, number=number)


def read_weights(path: Path, fps: float | None) -> Track:
    """ARKit weights from a csv; Live Link Face's own files are such. Names in any case."""
    with open(path, newline="", encoding="utf-8-sig") as file:
        table = [row for row in csv.reader(file) if row]
    heads = [name.strip().lower() for name in table[0]] if table else []
    known = [j for j, name in enumerate(heads) if name in NAMED]
    strange = [name for name in heads if name not in {*NAMED, *NOT_WEIGHTS, *TURNS}]
    if not known or strange:
        raise CorpusError(path, 1, "ARKit names (jawOpen, mouthSmileLeft, …)", strange or "none")
    if len(table) < 3:
        raise CorpusError(path, len(table), "two frames or more", len(table) - 1)
    values = np.zeros((len(table) - 1, len(known)), np.float32)
    for number, cells in enumerate(table[1:], 2):
        if len(cells) != len(heads):
            raise CorpusError(path, number, f"{len(heads)} cells", len(cells))
        values[number - 2] = [number_of(path, number, heads[j], cells[j]) for j in known]
    seconds = _csv_seconds(path, heads, table[1:], fps)
    backwards = np.flatnonzero(np.diff(seconds) <= 0)
    if len(backwards):
        at = int(backwards[0])
        raise CorpusError(path, at + 3, f"a time after {seconds[at]:.3f} s", f"{seconds[at + 1]:.3f} s")
    return Track(values, seconds, np.ones(len(values), bool), names=[NAMED[heads[j]] for j in known])


def _csv_seconds(path: Path, heads: list[str], rows: list[list[str]], fps: float | None) -> np.ndarray:
    """Times of the frames from the first one on; Live Link Face counts hours:minutes:seconds:frames."""
    if "seconds" in heads:
        at = heads.index("seconds")
        return np.array([number_of(path, n, "seconds", row[at]) for n, row in enumerate(rows, 2)])
    if fps is None:
        raise CorpusError(path, 1, "a column seconds, or fps.weights in corpus.json", "neither")
    if "timecode" not in heads:
        return np.arange(len(rows)) / fps
    at, seconds = heads.index("timecode"), []
    for number, row in enumerate(rows, 2):
        parts = re.split("[:;]", row[at])
        if len(parts) != 4:
            raise CorpusError(path, number, "Timecode: hours:minutes:seconds:frames", repr(row[at]))
        h, m, s, f = (number_of(path, number, "Timecode", part) for part in parts)
        seconds.append(3600 * h + 60 * m + s + f / fps)
    return np.array(seconds) - seconds[0]


def read_phones(path: Path) -> list[Phone]:
    """phones/CLIP.tsv."""
    lines = read_text(path).splitlines()
    if not lines or lines[0].split("\t") != ["start_s", "duration_s", "phone"]:
        raise CorpusError(path, 1, "start_s, duration_s, phone", lines[0] if lines else "nothing")
    phones = []
    for number, line in enumerate(lines[1:], 2):
        cells = line.split("\t")
        if len(cells) != 3:
            raise CorpusError(path, number, "3 cells between tabs", len(cells))
        start, duration = (number_of(path, number, "seconds", cell) for cell in cells[:2])
        if duration <= 0 or start < 0:
            raise CorpusError(path, number, "start_s from 0 and duration_s above 0", cells[:2])
        if not segments(cells[2]):
            raise CorpusError(path, number, "phone: IPA or ARPABET", repr(cells[2]))
        phones.append(Phone(start, duration, cells[2]))
    return phones


def read_vertices(path: Path) -> tuple[np.ndarray, float | None]:
    """[T, V, 3] of .npy (mapped), .npz or a folder of .obj; the rate where the file says it."""
    if path.is_dir():
        meshes = [read_obj(file)[0] for file in sorted(path.glob("*.obj"))]
        if not meshes or any(len(mesh) != len(meshes[0]) for mesh in meshes):
            raise CorpusError(path, None, ".obj files of one topology", [len(m) for m in meshes])
        return np.stack(meshes), None
    if path.suffix == ".npz":
        arrays = read_npz(path)
        fps = float(arrays["fps"]) if "fps" in arrays else None
        return np.asarray(arrays.get("vertices")), fps
    try:
        return np.load(path, mmap_mode="r"), None
    except (OSError, ValueError, EOFError) as error:
        raise CorpusError(path, None, "a numpy array", error) from error


def read_sound_any(path: Path) -> np.ndarray:
    """Mono samples [S] f32 at 16 kHz, from any rate at or above."""
    try:
        samples, rate_hz = soundfile.read(path, dtype="float32", always_2d=True)
    except soundfile.LibsndfileError as error:
        raise CorpusError(path, None, "sound", error) from error
    if rate_hz < SOUND_HZ:
        raise CorpusError(path, None, f"{SOUND_HZ} samples a second or more", rate_hz)
    if len(samples) < SHORTEST_S * rate_hz:
        raise CorpusError(path, None, f"{SHORTEST_S} s of sound or more", f"{len(samples) / rate_hz:.2f} s")
    if not np.isfinite(samples).all():
        at = int(np.flatnonzero(~np.isfinite(samples).all(1))[0])
        raise CorpusError(path, at, "finite samples", samples[at])
    mono = samples.mean(axis=1)
    if rate_hz == SOUND_HZ:
        return mono
    common = math.gcd(rate_hz, SOUND_HZ)
    return resample_poly(mono, SOUND_HZ // common, rate_hz // common).astype(np.float32)


@lru_cache(maxsize=32)
def _topology(folder: Path, speaker: str, unit_m: float) -> Topology:
    own = folder / f"{speaker}.obj"
    path = own if own.exists() else folder / "neutral.obj"
    vertices, triangles = read_obj(path)
    corners, shares = read_landmark_table(folder / "landmarks.json", len(vertices), triangles)
    return Topology(unit_m * vertices, triangles, corners, shares)


def read_obj(path: Path) -> tuple[np.ndarray, np.ndarray]:
    """Vertices [V, 3] and triangles [F, 3] of a Wavefront file; polygons become fans."""
    vertices, triangles = [], []
    for number, line in enumerate(read_text(path).splitlines(), 1):
        kind, *cells = line.split() or [""]
        if kind == "v":
            vertices.append([number_of(path, number, "v", cell) for cell in cells[:3]])
        elif kind == "f":
            polygon = [int(number_of(path, number, "f", cell.split("/")[0])) for cell in cells]
            polygon = [i - 1 if i > 0 else len(vertices) + i for i in polygon]
            if min(polygon) < 0 or max(polygon) >= len(vertices):
                raise CorpusError(path, number, f"vertices 1 to {len(vertices)}", cells)
            triangles += [[polygon[0], *polygon[k : k + 2]] for k in range(1, len(polygon) - 1)]
    if not triangles:
        raise CorpusError(path, None, "a mesh with triangles", f"{len(vertices)} vertices, no face")
    return np.array(vertices, float), np.array(triangles)


def read_landmark_table(path: Path, vertices: int, triangles: np.ndarray):
    """Vertex numbers [68, 3] and shares [68, 3] of the landmarks."""
    table = read_json(path)
    if "barycentric" in table:
        at, shares = np.array(table.get("triangles", [])), np.array(table["barycentric"], float)
        need_shape(path, shares, (68, 3), "barycentric")
        _need_numbers(path, at, len(triangles), "triangles")
        return triangles[at], shares
    rows = table.get("vertices")
    if rows is None:
        found = {mark["index"]: mark.get("vertex") for mark in table.get("landmarks", [])}
        rows = [found.get(i) for i in range(68)]
    at = np.array([-1 if row is None else row for row in rows])
    _need_numbers(path, at, vertices, "vertices")
    return np.repeat(at[:, None], 3, axis=1), np.tile([1.0, 0.0, 0.0], (68, 1))


def _need_numbers(path: Path, numbers: np.ndarray, count: int, what: str) -> None:
    if numbers.shape != (68,):
        raise CorpusError(path, None, f"68 numbers of {what}", f"shape {numbers.shape}")
    for row, number in enumerate(numbers):
        if not 0 <= number < count:
            raise CorpusError(path, row, f"{what}: 0 to {count - 1}", "none" if number == -1 else number)


def read_json(path: Path) -> dict:
    """A json object."""
    try:
        found = json.loads(read_text(path))
    except json.JSONDecodeError as error:
        raise CorpusError(path, error.lineno, "json", error.msg) from error
    if not isinstance(found, dict):
        raise CorpusError(path, 1, "a json object", type(found).__name__)
    return found


def read_text(path: Path) -> str:
    """A text file in UTF-8."""
    try:
        return path.read_text(encoding="utf-8-sig")
    except FileNotFoundError:
        raise CorpusError(path, None, "a file", "none") from None
    except UnicodeDecodeError as error:
        raise CorpusError(path, None, "text in UTF-8", error.reason) from error


def read_npz(path: Path) -> dict[str, np.ndarray]:
    """All arrays of a .npz, without pickles."""
    try:
        with np.load(path) as file:
            return {name: file[name] for name in file.files}
    except (OSError, ValueError, EOFError) as error:
        raise CorpusError(path, None, "a .npz of numbers", error) from error


def need_shape(path: Path, values, shape: tuple[int | None, ...], what: str) -> np.ndarray:
    """`values`, if they are numbers of the shape; `None` stands for any count above 1."""
    wanted = str(["T" if n is None else n for n in shape]).replace("'", "")
    if values is None or np.asarray(values).dtype.kind not in "fiu":
        raise CorpusError(path, None, f"{what} {wanted}", "none")
    found = values.shape
    if len(found) != len(shape) or any(n != m if n else m < 2 for n, m in zip(shape, found, strict=True)):
        raise CorpusError(path, None, f"{what} {wanted}", list(found))
    return values


def need_finite(path: Path, values: np.ndarray, frames: np.ndarray) -> None:
    """Raises for the first frame of `values` [T, ...] with a number that is none."""
    bad = ~np.isfinite(values.reshape(len(values), -1)).all(axis=1)
    if bad.any():
        frame = int(frames[np.flatnonzero(bad)[0]])
        raise CorpusError(path, frame, "finite numbers in the frame", "NaN or infinity")


def number_of(path: Path, row: int, what: str, text: str) -> float:
    """A finite number."""
    try:
        value = float(text)
    except ValueError:
        raise CorpusError(path, row, f"{what}: a number", repr(text)) from None
    if not math.isfinite(value):
        raise CorpusError(path, row, f"{what}: a finite number", text)
    return value
