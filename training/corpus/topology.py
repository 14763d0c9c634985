"""Neutral meshes of a corpus folder and the landmarks on them."""

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np

from training.corpus.checked import CorpusError, need_shape, number_of, read_json, read_text


@dataclass
class Topology:
    """A neutral mesh: `vertices` [V, 3] m, `triangles` [F, 3], landmarks as `corners` [68, 3] vertex
    numbers and their `shares` [68, 3]."""

    vertices: np.ndarray
    triangles: np.ndarray
    corners: np.ndarray
    shares: np.ndarray

    def landmarks(self, vertices: np.ndarray) -> np.ndarray:
        """Positions of the landmarks on `vertices` [..., V, 3]: [..., 68, 3]."""
        return np.einsum("nk,...nkx->...nx", self.shares, vertices[..., self.corners, :])

    @property
    def nearest(self) -> np.ndarray:
        """The vertex with the largest share in each landmark, [68]."""
        return self.corners[np.arange(68), self.shares.argmax(1)]


@lru_cache(maxsize=32)
def topology_of(folder: Path, speaker: str, unit_m: float) -> Topology:
    """The neutral mesh of a speaker, or else of the folder. Its file is in units of `unit_m` metres."""
    speaker_file = folder / f"{speaker}.obj"
    path = speaker_file if speaker_file.exists() else folder / "neutral.obj"
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


def write_obj(path: Path, vertices: np.ndarray, triangles: np.ndarray) -> None:
    """Writes a mesh of nothing but vertices [V, 3] and triangles [F, 3]."""
    lines = ["v {:.7g} {:.7g} {:.7g}".format(*v) for v in vertices]
    lines += ["f {} {} {}".format(*(t + 1)) for t in triangles]
    path.write_text("\n".join(lines) + "\n")


def read_landmark_table(path: Path, vertices: int, triangles: np.ndarray):
    """Reads vertex numbers [68, 3] and shares [68, 3] of the landmarks."""
    table = read_json(path)
    if "barycentric" in table:
        at, shares = np.array(table.get("triangles", [])), np.array(table["barycentric"], float)
        need_shape(path, shares, (68, 3), "barycentric")
        _need_numbers(path, at, len(triangles), "triangles")
        return triangles[at], shares
    rows = table.get("vertices")
    if rows is None:
        vertex_of_landmark = {mark["index"]: mark.get("vertex") for mark in table.get("landmarks", [])}
        rows = [vertex_of_landmark.get(i) for i in range(68)]
    at = np.array([-1 if row is None else row for row in rows])
    _need_numbers(path, at, vertices, "vertices")
    return np.repeat(at[:, None], 3, axis=1), np.tile([1.0, 0.0, 0.0], (68, 1))


def _need_numbers(path: Path, numbers: np.ndarray, count: int, what: str) -> None:
    if numbers.shape != (68,):
        raise CorpusError(path, None, f"68 numbers of {what}", f"shape {numbers.shape}")
    for row, number in enumerate(numbers):
        if not 0 <= number < count:
            raise CorpusError(path, row, f"{what}: 0 to {count - 1}", "none" if number == -1 else number)
