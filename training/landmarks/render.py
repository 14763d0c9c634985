"""Depth pictures of a mesh as the landmark network sees them; `find_landmarks/depth_view.rs` is
its twin.

An orthographic z-buffer of 256² pixels gives the nearest surface; four features are averaged
down to 128². Everything comes from depth, so triangulation, winding and smoothing groups of the
mesh do not matter. Pixel (row, column) of the 256² buffer covers the view's plane like this:
column grows with view x (the subject's left), row grows with -y, z grows towards the viewer.
"""

import numba
import numpy as np
from scipy.ndimage import gaussian_filter

RESOLUTION = 128
SUPERSAMPLE = 2
BACKGROUND_DEPTH = -1.0


@numba.njit(cache=True, fastmath=False)
def depth_buffer(points, triangles, centre_x, centre_y, half_size, size):
    """Largest z per pixel, `[size, size]` f32, -inf where there is no surface.

    `points`: `[V, 3]` f32 in view space. The window is `centre ± half_size`.
    """
    buffer = np.full((size, size), -np.inf, np.float32)
    scale = np.float32(0.5 * size / half_size)
    half = np.float32(0.5 * size)
    for t in range(triangles.shape[0]):
        a, b, c = points[triangles[t, 0]], points[triangles[t, 1]], points[triangles[t, 2]]
        ax, ay = (a[0] - centre_x) * scale + half, (centre_y - a[1]) * scale + half
        bx, by = (b[0] - centre_x) * scale + half, (centre_y - b[1]) * scale + half
        cx, cy = (c[0] - centre_x) * scale + half, (centre_y - c[1]) * scale + half
        low_x, high_x = min(ax, bx, cx), max(ax, bx, cx)
        low_y, high_y = min(ay, by, cy), max(ay, by, cy)
        if high_x < 0 or high_y < 0 or low_x > size or low_y > size:
            continue
        area = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
        if abs(area) < 1e-12:
            continue
        column_from, column_to = max(0, int(low_x - 0.5)), min(size - 1, int(high_x + 0.5))
        row_from, row_to = max(0, int(low_y - 0.5)), min(size - 1, int(high_y + 0.5))
        for row in range(row_from, row_to + 1):
            y = np.float32(row) + np.float32(0.5)
            for column in range(column_from, column_to + 1):
                x = np.float32(column) + np.float32(0.5)
                wa = ((bx - x) * (cy - y) - (by - y) * (cx - x)) / area
                wb = ((cx - x) * (ay - y) - (cy - y) * (ax - x)) / area
                wc = np.float32(1.0) - wa - wb
                if wa < -1e-5 or wb < -1e-5 or wc < -1e-5:
                    continue
                z = wa * a[2] + wb * b[2] + wc * c[2]
                if z > buffer[row, column]:
                    buffer[row, column] = z
    return buffer


@numba.njit(cache=True)
def slope(before, here, after, pixel):
    """Central difference if both neighbours exist, one-sided if only one does, else zero."""
    if before > -np.inf and after > -np.inf:
        return (after - before) / (2 * pixel)
    if after > -np.inf:
        return (after - here) / pixel
    if before > -np.inf:
        return (here - before) / pixel
    return 0.0


@numba.njit(cache=True)
def features(buffer, half_size):
    """`[4, size/2, size/2]` f32: depth, normal x, normal y, coverage. Empty pixels count as zero
    normal, zero coverage and depth -1.

    Depth is relative to the mean of the covered pixels, in half-sizes of the window, cut at ±1.5.
    """
    size = buffer.shape[0]
    pixel = 2.0 * half_size / size
    total, count = 0.0, 0
    for row in range(size):
        for column in range(size):
            if buffer[row, column] > -np.inf:
                total += buffer[row, column]
                count += 1
    mean = total / max(count, 1)
    out = np.zeros((4, size // 2, size // 2), np.float32)
    nothing = np.float32(-np.inf)
    for row in range(size):
        for column in range(size):
            z = buffer[row, column]
            r, c = row // 2, column // 2
            if z == -np.inf:
                out[0, r, c] += 0.25 * BACKGROUND_DEPTH
                continue
            left = buffer[row, column - 1] if column > 0 else nothing
            right = buffer[row, column + 1] if column + 1 < size else nothing
            above = buffer[row - 1, column] if row > 0 else nothing
            below = buffer[row + 1, column] if row + 1 < size else nothing
            dx = slope(left, z, right, pixel)
            dy = -slope(above, z, below, pixel)
            length = np.sqrt(dx * dx + dy * dy + 1.0)
            out[0, r, c] += 0.25 * min(max((z - mean) / half_size, -1.5), 1.5)
            out[1, r, c] += 0.25 * (-dx / length)
            out[2, r, c] += 0.25 * (-dy / length)
            out[3, r, c] += 0.25
    return out


def softened(buffer: np.ndarray, deviation: float) -> np.ndarray:
    """The mean depth around every drawn pixel, weighted by a Gaussian of `deviation` pixels."""
    drawn = buffer > -np.inf
    depth = np.where(drawn, buffer, 0).astype(np.float32)
    weight, total = (
        gaussian_filter(x, deviation, mode="constant", truncate=3.0)
        for x in (drawn.astype(np.float32), depth)
    )
    return np.where(drawn, total / np.maximum(weight, 1e-6), -np.inf).astype(np.float32)


def picture(
    points: np.ndarray, triangles: np.ndarray, centre, half_size: float, softness: float = 0.0
) -> np.ndarray:
    """The network's input for one window, `[4, 128, 128]` f32, softened by `softness` pixels."""
    size = RESOLUTION * SUPERSAMPLE
    buffer = depth_buffer(
        np.ascontiguousarray(points, np.float32),
        np.ascontiguousarray(triangles, np.int32),
        np.float32(centre[0]),
        np.float32(centre[1]),
        np.float32(half_size),
        size,
    )
    if softness > 0:
        buffer = softened(buffer, softness)
    return features(buffer, float(half_size))


def to_window(points: np.ndarray, centre, half_size: float) -> np.ndarray:
    """Converts view x, y of points to the window's coordinates, (column, row) from 0 to 1."""
    column = 0.5 + 0.5 * (points[..., 0] - centre[0]) / half_size
    row = 0.5 + 0.5 * (centre[1] - points[..., 1]) / half_size
    return np.stack([column, row], -1)


def yaw(angle: float) -> np.ndarray:
    """Rotation about y; positive brings the subject's right cheek to the viewer's middle."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])


def come_out(
    marks: np.ndarray, region: slice, shapes: list, room: float = 0.012, pixels: int = 192
) -> np.ndarray:
    """Moves the landmarks of `region` along z to the front of `shapes` wherever these cover them.

    This keeps landmarks on the visible surface. `shapes` are (points, triangles) in metres. Returns all
    landmarks, `[68, 3]`.
    """
    middle = marks[region, :2].mean(0)
    half = float(np.abs(marks[region, :2] - middle).max() + room)
    front = np.full((pixels, pixels), -np.inf, np.float32)
    for points, triangles in shapes:
        points, triangles = points.astype(np.float32), triangles.astype(np.int32)
        drawn = depth_buffer(points, triangles, *middle.astype(np.float32), np.float32(half), pixels)
        front = np.maximum(front, drawn)
    column, row = np.clip((to_window(marks[region], middle, half).T * pixels).astype(int), 0, pixels - 1)
    out = marks.copy()
    out[region, 2] = np.maximum(marks[region, 2], front[row, column])
    return out
