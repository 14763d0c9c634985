"""Helpers that readers share, for numpy and pickle files, meshes, csv with numbers, and sounds."""

import csv
import pickle
from pathlib import Path

import numpy as np
import soundfile

from training.corpus.checked import CorpusError, need_shape, number_of
from training.corpus.folder import SOUNDS
from training.corpus.topology import read_obj

CORES = ("numpy.core", "numpy._core")
SAFE = {"numpy", *(f"{core}.{part}" for core in CORES for part in ("multiarray", "numeric"))}
PLY_TYPES = {"float": "f4", "float32": "f4", "double": "f8", "uchar": "u1", "uint8": "u1", "int": "i4",
             "int32": "i4", "uint": "u4", "short": "i2", "ushort": "u2", "char": "i1"}  # fmt: skip


class NumbersAlone(pickle.Unpickler):
    """Reads pickles of arrays and refuses everything else in them, because a pickle can run programs."""

    def find_class(self, module: str, name: str):
        """Allows the constructors of numpy and scipy's sparse matrices. A chumpy array becomes a `Held`."""
        if module in SAFE and name in ("_reconstruct", "ndarray", "dtype", "scalar", "_frombuffer"):
            return super().find_class(module.replace("numpy.core", "numpy._core"), name)
        if (module, name) == ("_codecs", "encode"):
            return super().find_class(module, name)
        if module.startswith("scipy.sparse") and name in ("csc_matrix", "csr_matrix"):
            return super().find_class("scipy.sparse", name)
        if module.startswith("chumpy"):
            return Held
        raise pickle.UnpicklingError(f"{module}.{name}")


class Held:
    """Stands for a chumpy array, whose state has the numbers under `x`."""


def read_pickle(path: Path):
    """Reads a pickle of numbers."""
    if not path.exists():
        raise CorpusError(path, None, "a file", "none")
    try:
        with open(path, "rb") as file:
            return NumbersAlone(file, encoding="latin1").load()
    except (pickle.UnpicklingError, EOFError) as error:
        raise CorpusError(path, None, "a pickle of numbers alone", error) from error


def numbers(value) -> np.ndarray:
    """The value as an array, unwrapped if it was a chumpy array."""
    return np.asarray(value.__dict__["x"] if isinstance(value, Held) else value)


def read_mesh(path: Path) -> tuple[np.ndarray, np.ndarray]:
    """Vertices [V, 3] and triangles [F, 3] of .obj or .ply."""
    return read_ply(path) if path.suffix == ".ply" else read_obj(path)


def read_ply(path: Path) -> tuple[np.ndarray, np.ndarray]:
    """Vertices and triangles of a .ply, ascii or little-endian."""
    if not path.exists():
        raise CorpusError(path, None, "a file", "none")
    head, _, body = path.read_bytes().partition(b"end_header\n")
    lines = [line.split() for line in head.decode("ascii", "replace").splitlines()]
    if not lines or lines[0] != ["ply"] or not body:
        raise CorpusError(path, 1, "ply", lines[:1])
    counts, fields, element = {}, {}, ""
    for line in lines:
        if line[:1] == ["element"]:
            element, counts[line[1]], fields[line[1]] = line[1], int(line[2]), []
        elif line[:1] == ["property"]:
            fields[element].append(line[1:])
    if ["format", "ascii", "1.0"] in lines:
        return _ascii_ply(body, counts)
    return _binary_ply(body, counts, fields)


def _ascii_ply(body: bytes, counts: dict[str, int]) -> tuple[np.ndarray, np.ndarray]:
    rows = body.decode("ascii").splitlines()
    vertices = [row.split()[:3] for row in rows[: counts["vertex"]]]
    faces = rows[counts["vertex"] : counts["vertex"] + counts.get("face", 0)]
    return np.array(vertices, float), np.array([row.split()[1:4] for row in faces], int).reshape(-1, 3)


def _binary_ply(body: bytes, counts: dict[str, int], fields) -> tuple[np.ndarray, np.ndarray]:
    kind = np.dtype([(name, "<" + PLY_TYPES[kind]) for kind, name in fields["vertex"]])
    rows = np.frombuffer(body, kind, counts["vertex"])
    triangles = np.zeros((0, 3), int)
    if counts.get("face"):
        _, size, index, _ = fields["face"][0]
        face = np.dtype([("n", "<" + PLY_TYPES[size]), ("v", "<" + PLY_TYPES[index], 3)])
        triangles = np.frombuffer(body, face, counts["face"], rows.nbytes)["v"].astype(int)
    return np.stack([rows[axis] for axis in "xyz"], axis=1).astype(float), triangles


def read_sequence(path: Path, vertices: int | None = None) -> np.ndarray:
    """Vertices [T, V, 3] from a .npy ([T, V, 3] or [T, 3 V]) or from a folder of .ply or .obj."""
    if path.is_dir():
        meshes = sorted([*path.glob("*.ply"), *path.glob("*.obj")])
        if not meshes:
            raise CorpusError(path, None, "meshes, .ply or .obj", "none")
        values = np.stack([read_mesh(mesh)[0] for mesh in meshes])
    else:
        values = np.load(path, mmap_mode="r")
        values = values.reshape(len(values), -1, 3) if values.ndim == 2 else values
    return need_shape(path, values, (None, vertices or values.shape[1], 3), "vertices")


def sound_of(folder: Path, stem: str) -> Path:
    """The path of a clip's sound; raises if there is none."""
    for ending in SOUNDS:
        if (folder / f"{stem}{ending}").exists():
            return folder / f"{stem}{ending}"
    expected = f"a sound, {stem} with one of {', '.join(SOUNDS)}"
    others = sorted(path.name for path in folder.glob(f"{stem}.*")) or "none"
    raise CorpusError(
        folder, None, expected + " (ffmpeg -i CLIP.mov -ar 16000 CLIP.wav takes it out)", others
    )


def pairs_of(motions: Path, sounds: Path) -> list[tuple[Path, Path]]:
    """Motion NAME.npy and sound NAME of the clips that have both, as public loaders pair them."""
    motion_files, pairs = found_files(motions, "*.npy"), []
    for path in motion_files:
        kinds = [sounds / f"{path.stem}{ending}" for ending in SOUNDS]
        pairs += [(path, sound) for sound in kinds if sound.exists()][:1]
    if not pairs:
        sound_of(sounds, motion_files[0].stem)
    return pairs


def rate_of(pairs: list[tuple[Path, Path]], rates: tuple[float, ...]) -> float:
    """The one of `rates` that is nearest to the frames per second of sound in the clips."""
    measured = []
    for motion, sound in pairs:
        seconds = soundfile.info(sound).duration
        measured.append(len(np.load(motion, mmap_mode="r")) / max(seconds, 1e-3))
    rate = max(float(np.median(measured)), 1e-3)
    return min(rates, key=lambda known: abs(np.log(known / rate)))


def found_files(source: Path, pattern: str) -> list[Path]:
    """Files that match a pattern; raises if there is none."""
    files = sorted(source.rglob(pattern))
    if not files:
        raise CorpusError(source, None, f"files {pattern}", "none")
    return files


def read_numbers(path: Path, names: list[str]) -> dict[str, np.ndarray]:
    """Columns of a csv by name, each [T]. Spaces around names are ignored."""
    with open(path, newline="", encoding="utf-8-sig") as file:
        rows = [row for row in csv.reader(file) if row]
    heads = [name.strip() for name in rows[0]] if rows else []
    missing = [name for name in names if name not in heads]
    if missing:
        raise CorpusError(path, 1, f"columns {', '.join(names[:4])}, …", f"no {', '.join(missing[:4])}")
    columns = {name: np.zeros(len(rows) - 1) for name in names}
    for number, row in enumerate(rows[1:], 2):
        if len(row) != len(heads):
            raise CorpusError(path, number, f"{len(heads)} cells", len(row))
        for name in names:
            columns[name][number - 2] = number_of(path, number, name, row[heads.index(name)])
    return columns


def need_table(landmarks: Path | None, topology: str) -> Path:
    """The table of landmarks; raises if the user did not supply it."""
    if landmarks is None:
        expected = f"--landmarks FILE: the 68 landmarks of {topology} (`anyface landmarks --mesh` finds them)"
        raise CorpusError(Path(topology), None, expected, "nothing")
    return landmarks
