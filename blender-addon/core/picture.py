"""Small pictures of meshes, drawn without a graphics card, and files of them."""

import struct
import zlib
from dataclasses import dataclass

import numpy as np

# Samples of a pixel along each axis.
_SAMPLES = 2
_SKIN = np.array([0.87, 0.69, 0.60])
# Directions of the lights (+x to the right, +y up, +z to the viewer) and their brightness.
_LIGHTS = ((np.array([-0.45, 0.55, 0.70]), 0.72), (np.array([0.8, -0.1, 0.6]), 0.22))
_AMBIENT, _BACK = 0.16, 0.12
# Triangles reach this far beyond their edges, so that no sample between two of them is missed.
_EDGE = -1e-5


@dataclass(frozen=True)
class View:
    """What a square picture shows: its centre `x`, `y` and half of its side."""

    x: float
    y: float
    half: float


def draw(points: np.ndarray, triangles: np.ndarray, view: View, size: int = 128) -> np.ndarray:
    """A picture `[size, size, 4]` uint8 of a smooth mesh, its background transparent.

    `points` `[V, 3]`, +x to the right, +y up, +z to the viewer; `triangles` `[F, 3]`. Surfaces
    seen from behind, such as the inside of a mouth, are dark.
    """
    points, triangles = np.asarray(points, np.float32), np.asarray(triangles, np.int64)
    side = _SAMPLES * size
    # Samples count from the picture's lower left corner.
    flat = np.column_stack([points[:, 0] - view.x, points[:, 1] - view.y]) / (2.0 * view.half)
    samples = np.column_stack([(flat + 0.5) * side - 0.5, points[:, 2]]).astype(np.float32)
    normals, facing = _normals(points, triangles)
    colours = np.zeros((side * side, 4), dtype=np.float32)
    pixels, owners, shares = _cover(samples, triangles[facing > 0.0], side)
    lit = np.einsum("nk,nkd->nd", shares, normals[triangles[facing > 0.0][owners]])
    colours[pixels, :3], colours[pixels, 3] = _SKIN * _light(lit)[:, None], 1.0
    # Holes show the inside.
    inside = triangles[facing < 0.0]
    inside = inside[_reaches(samples, inside, colours[:, 3] == 0.0, side)]
    pixels = _cover(samples, inside, side)[0]
    pixels = pixels[colours[pixels, 3] == 0.0]
    colours[pixels, :3], colours[pixels, 3] = _SKIN * _BACK, 1.0
    fine = colours.reshape(size, _SAMPLES, size, _SAMPLES, 4).mean(axis=(1, 3))
    # Colours at the edge are those of the face, not of what is behind it.
    fine[..., :3] /= np.maximum(fine[..., 3:], 1e-6)
    return (np.clip(fine[::-1], 0.0, 1.0) * 255.0 + 0.5).astype(np.uint8)


def _reaches(samples, triangles, free, side: int) -> np.ndarray:
    """Whether the bounding box of each triangle holds a sample that is `free`."""
    sums = np.zeros((side + 1, side + 1), dtype=np.int32)
    sums[1:, 1:] = free.reshape(side, side).cumsum(axis=0).cumsum(axis=1)
    corners = (samples[triangles, axis].T for axis in (0, 1))
    (left, wide), (low, tall) = (_span(a, b, c, side) for a, b, c in corners)
    right, high = left + wide, low + tall
    return sums[high, right] - sums[low, right] - sums[high, left] + sums[low, left] > 0


def _cover(samples, triangles, side: int):
    """The covered samples `[N]`, the frontmost triangle `[N]` at each, and the shares `[N, 3]` of
    its corners. `samples` `[V, 3]` are points: x and y in samples, and depth."""
    (ax, ay, az), (bx, by, bz), (cx, cy, cz) = (samples[triangles[:, k]].T for k in range(3))
    left, wide = _span(ax, bx, cx, side)
    low, tall = _span(ay, by, cy, side)
    counts = wide * tall
    owners = np.repeat(np.arange(len(triangles), dtype=np.int32), counts)
    at = np.arange(len(owners), dtype=np.int32) - np.repeat(np.cumsum(counts) - counts, counts)
    row, column = np.divmod(at.astype(np.int32), wide[owners])
    x, y = left[owners] + column, low[owners] + row
    area = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
    # A triangle seen edge-on covers nothing.
    scale = np.divide(1.0, area, out=np.full_like(area, np.nan), where=np.abs(area) > 1e-9)
    px, py = x - ax[owners], y - ay[owners]
    second = px * ((cy - ay) * scale)[owners] - py * ((cx - ax) * scale)[owners]
    third = py * ((bx - ax) * scale)[owners] - px * ((by - ay) * scale)[owners]
    first = 1.0 - second - third
    inside = np.flatnonzero((first >= _EDGE) & (second >= _EDGE) & (third >= _EDGE))
    owners, pixels = owners[inside], y[inside] * side + x[inside]
    first, second, third = first[inside], second[inside], third[inside]
    depth = first * az[owners] + second * bz[owners] + third * cz[owners]
    order = np.argsort(depth, kind="stable")
    front = np.full(side * side, -1, dtype=np.int64)
    # Of several values written to one place the last one stays, which is the one in front.
    front[pixels[order]] = order
    covered = np.flatnonzero(front >= 0)
    front_triangles = front[covered]
    return (
        covered,
        owners[front_triangles],
        np.column_stack([first[front_triangles], second[front_triangles], third[front_triangles]]),
    )


def _span(a, b, c, side: int):
    """The first sample of each triangle along an axis, and its number of samples, `[F]` int32."""
    first = np.ceil(np.minimum(np.minimum(a, b), c)).clip(0, side)
    last = np.floor(np.maximum(np.maximum(a, b), c)).clip(-1, side - 1)
    return first.astype(np.int32), np.maximum(last - first + 1, 0).astype(np.int32)


def _normals(points, triangles):
    """Unit normals of the vertices `[V, 3]` to the outside of the mesh, and for each triangle `[F]`
    whether the viewer sees its outside (above 0) or its inside."""
    a, b, c = (points[triangles[:, k]] for k in range(3))
    areas = np.cross(b - a, c - a)
    # The volume of a mesh is negative if its faces look inwards.
    depths = (a[:, 2] + b[:, 2] + c[:, 2]) / 3.0
    volume = float((areas[:, 2] * (depths - depths.mean())).sum())
    areas *= -1.0 if volume < 0.0 else 1.0
    summed = np.empty_like(points)
    for axis in range(3):
        weights = np.repeat(areas[:, axis], 3)
        summed[:, axis] = np.bincount(triangles.ravel(), weights, minlength=len(points))
    lengths = np.linalg.norm(summed, axis=1, keepdims=True)
    return summed / np.maximum(lengths, 1e-12), areas[:, 2]


def _light(normals) -> np.ndarray:
    """How bright surfaces with these normals `[N, 3]` are."""
    lengths = np.linalg.norm(normals, axis=1, keepdims=True)
    normals = normals / np.maximum(lengths, 1e-6)
    light = np.full(len(normals), _AMBIENT)
    for way, strength in _LIGHTS:
        light += strength * np.clip(normals @ (way / np.linalg.norm(way)), 0.0, None)
    return light


def png(pixels: np.ndarray) -> bytes:
    """The bytes of a PNG file of `[height, width, 4]` uint8, the top row first."""
    height, width, _ = pixels.shape
    # Every row begins with the number of its filter: none.
    rows = np.zeros((height, 1 + 4 * width), dtype=np.uint8)
    rows[:, 1:] = pixels.reshape(height, -1)
    header = struct.pack(">IIBBBBB", width, height, 8, 6, 0, 0, 0)
    parts = (b"IHDR", header), (b"IDAT", zlib.compress(rows.tobytes(), 6)), (b"IEND", b"")
    return b"\x89PNG\r\n\x1a\n" + b"".join(_chunk(*part) for part in parts)


def _chunk(kind: bytes, data: bytes) -> bytes:
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
