"""Curves over time as a small picture, drawn without a graphics card."""

import numpy as np

_BACK, _GRID = (0.11, 0.11, 0.12), 0.24
# Half the width of a line, and the width in which its edge fades, in pixels.
_HALF, _EDGE = 1.1, 1.0
_MARGIN = 6
# Values of the grid lines.
_LEVELS = (0.25, 0.5, 0.75)


def draw(
    times: np.ndarray, curves: list[tuple[np.ndarray, tuple[float, float, float]]], size: int = 256
) -> np.ndarray:
    """A picture `[size, size, 4]` uint8, the top row first, of values 0 to 1 over time.

    `times` `[N]` are in rising order; each curve is a pair of values `[N]` and colour, 0 to 1. The
    last curve is drawn over the others. A sound of a single instant gives a level line.
    """
    pixels = np.empty((size, size, 3))
    pixels[:] = _BACK
    side = size - 2 * _MARGIN - 1
    for level in _LEVELS:
        pixels[_MARGIN + round((1.0 - level) * side), _MARGIN:-_MARGIN] = _GRID
    columns = np.arange(size, dtype=np.float64)
    span = max(float(times[-1] - times[0]), 1e-9)
    at = times[0] + span * np.clip((columns - _MARGIN) / side, 0.0, 1.0)
    inside = (columns >= _MARGIN) & (columns < size - _MARGIN)
    rows = columns[:, None]
    for values, colour in curves:
        height = _MARGIN + (1.0 - np.clip(np.interp(at, times, values), 0.0, 1.0)) * side
        # Makes steep parts of a line as wide as level ones.
        slope = np.gradient(height)
        away = np.abs(rows - height) / np.sqrt(1.0 + slope**2)
        share = np.clip((_HALF + _EDGE - away) / _EDGE, 0.0, 1.0) * inside
        pixels += share[..., None] * (np.array(colour) - pixels)
    opaque = np.ones((size, size, 1))
    return (np.concatenate([pixels, opaque], axis=2) * 255.0 + 0.5).astype(np.uint8)


def swatch(colour: tuple[float, float, float], size: int = 16) -> np.ndarray:
    """A picture `[size, size, 4]` uint8 of one colour, with a margin that is transparent."""
    pixels = np.zeros((size, size, 4), dtype=np.uint8)
    margin = size // 5
    pixels[margin:-margin, margin:-margin] = [*(round(255 * part) for part in colour), 255]
    return pixels
