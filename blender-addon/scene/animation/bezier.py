"""Curves of a take with few keys: their handles, and how such a curve is changed."""

import numpy as np

from ...core.sparse import REACH

# Values of the enums of a keyframe.
_BEZIER = 2
_FREE, _ALIGNED = 0, 3
_VECTORS = ("co", "handle_left", "handle_right")
_KINDS = ("interpolation", "easing", "handle_left_type", "handle_right_type")
# A frame that lies closer to a key than this is at the key.
_AT = 1e-3


def is_sparse(curve) -> bool:
    """Whether a curve of a take has few keys, with handles."""
    return bool((_kinds(curve, "interpolation") == _BEZIER).any())


def bend(curve, slopes: np.ndarray) -> None:
    """Gives the keys of a curve handles of `slopes` `[N, 2]`, before and behind, per frame."""
    count = len(curve.keyframe_points)
    vectors = _handles(_pairs(curve, "co"), slopes)
    _put(curve, vectors, _kinds_of(slopes, count))


def eased(at: np.ndarray, values: np.ndarray, slopes: np.ndarray, lead: int) -> np.ndarray:
    """Slopes `[N, 2]` before and behind the keys `[N]` of a take.

    The last key is at rest, and so is the first where `lead` is 1. The curve leaves rest and
    returns to it without overshooting.
    """
    both = np.column_stack([slopes, slopes])
    if len(at) > 2:
        for key, side, other in ((1, 0, 0), (-2, 1, -1))[1 - lead :]:
            straight = (values[key] - values[other]) / (at[key] - at[other])
            low, high = sorted((0.0, 2.0 * straight))
            both[key, side] = np.clip(both[key, side], low, high)
    return both


def sample(curve, frames: np.ndarray) -> np.ndarray:
    """The values of a curve at frames `[T]`."""
    return np.array([curve.evaluate(float(frame)) for frame in frames])


def change(curve, factor: float, moved: float, more=None) -> tuple[float, float]:
    """Scales a curve, adds `more` to it, and moves it in time.

    `more` holds frames `[T]`, before they move, and the values to add at them. No key is added or
    removed. Returns the lowest and the highest value.
    """
    vectors = {name: _pairs(curve, name) for name in _VECTORS}
    at = vectors["co"][:, 0].copy()
    inside, slopes, added = np.zeros(len(at)), np.zeros(len(at)), np.zeros(len(at))
    if more is not None:
        frames, changes = more
        half = 0.5 * (frames[1] - frames[0]) if len(frames) > 1 else 0.5
        inside = (at > frames[0] - half) & (at < frames[-1] + half)
        added = np.where(inside, np.interp(at, frames, changes), 0.0)
        slopes = np.where(inside, _slopes(at, inside, frames, changes), 0.0)
    for pairs in vectors.values():
        pairs[:, 1] = factor * pairs[:, 1] + added + slopes * (pairs[:, 0] - at)
        pairs[:, 0] += moved
    _put(curve, vectors)
    values = vectors["co"][:, 1]
    return float(values.min(initial=0.0)), float(values.max(initial=0.0))


def _slopes(at, inside, frames, changes) -> np.ndarray:
    """The handle slopes with which a curve through keys at `at` `[N]` best fits changes `[T]`.

    They are found by least squares over all segments at once.
    """
    keys = np.flatnonzero(inside)
    slopes = np.zeros(len(at))
    if len(keys) < 2:
        return slopes
    x = at[keys]
    y = np.interp(x, frames, changes)
    at_frame = frames[(frames > x[0] + _AT) & (frames < x[-1] - _AT)]
    number = np.clip(np.searchsorted(x, at_frame) - 1, 0, len(x) - 2)
    length = x[number + 1] - x[number]
    t = _parameter((at_frame - x[number]) / length)
    u = 1.0 - t
    first, second = 3.0 * u * u * t, 3.0 * u * t * t
    rest = np.interp(at_frame, frames, changes)
    rest = rest - y[number + 1] - (u**3 + first) * (y[number] - y[number + 1])
    before, behind = REACH * length * first, -REACH * length * second
    diagonal = np.bincount(number, before**2, len(x))
    diagonal += np.bincount(number + 1, behind**2, len(x))
    beside = np.bincount(number, before * behind, len(x))
    right = np.bincount(number, before * rest, len(x))
    right += np.bincount(number + 1, behind * rest, len(x))
    pull = 1e-3 * max(float(diagonal.mean()), 1e-12)
    right += pull * np.gradient(y, x)
    slopes[keys] = _tridiagonal(diagonal + pull, beside, right)
    return slopes


def _parameter(share: np.ndarray) -> np.ndarray:
    """The Bézier parameter at which a segment has covered a share of its frames (Newton)."""
    t = share.copy()
    for _ in range(8):
        u = 1.0 - t
        x = 3.0 * u * u * t * REACH + 3.0 * u * t * t * (1.0 - REACH) + t**3
        speed = 3.0 * REACH * (u * u + t * t) + 6.0 * u * t * (1.0 - 2.0 * REACH)
        t = np.clip(t - (x - share) / speed, 0.0, 1.0)
    return t


def _tridiagonal(diagonal, beside, right) -> np.ndarray:
    """The solution of a symmetric system; `beside` `[N]` are the numbers right of the diagonal."""
    diagonal, right, beside = diagonal.tolist(), right.tolist(), beside.tolist()
    for n in range(1, len(diagonal)):
        share = beside[n - 1] / diagonal[n - 1]
        diagonal[n] -= share * beside[n - 1]
        right[n] -= share * right[n - 1]
    solution = [0.0] * (len(diagonal) + 1)
    for n in range(len(diagonal) - 1, -1, -1):
        solution[n] = (right[n] - beside[n] * solution[n + 1]) / diagonal[n]
    return np.array(solution[:-1])


def splice(curve, at: np.ndarray, new: np.ndarray, stretch, few_keys) -> bool:
    """Mixes a curve inside a `core.redo.Stretch` with values `new` `[n]` at frames `at` `[n]`.

    Keys outside stay. `few_keys(values)` says which frames of the new stretch get a key. Returns
    False if no frame lies inside.
    """
    shares = stretch.shares(at)
    inside = np.flatnonzero(shares > 0.0)
    if len(inside) == 0:
        return False
    first, last = max(inside[0] - 1, 0), min(inside[-1] + 1, len(at) - 1)
    at, shares, new = (row[first : last + 1] for row in (at, shares, new))
    old = sample(curve, at)
    values = old + shares * (new - old)
    keys = few_keys(values)
    rows = np.arange(len(at)) if keys is None else keys.rows
    step = (at[-1] - at[0]) / max(len(at) - 1, 1)
    slopes = np.gradient(values, at) if keys is None else keys.slopes / max(step, 1e-9)
    new_vectors = _handles(np.column_stack([at, values])[rows], np.column_stack([slopes, slopes]))
    kinds = _kinds_of(np.column_stack([slopes, slopes]), len(rows))
    old_vectors = {name: _pairs(curve, name) for name in _VECTORS}
    before, behind = _cut(old_vectors, at[0]), _cut(old_vectors, at[-1])
    frames = old_vectors["co"][:, 0]
    earlier, later = frames < at[0] - _AT, frames > at[-1] + _AT
    # The pieces of the segments that were cut keep their shape.
    if before is not None and earlier.any() and shares[0] == 0.0:
        new_vectors["handle_left"][0] = before[1]
        old_vectors["handle_right"][np.flatnonzero(earlier)[-1]] = before[0]
        kinds["handle_left_type"][0] = kinds["handle_right_type"][0] = _FREE
    if behind is not None and later.any() and shares[-1] == 0.0:
        new_vectors["handle_right"][-1] = behind[2]
        old_vectors["handle_left"][np.flatnonzero(later)[0]] = behind[3]
        kinds["handle_left_type"][-1] = kinds["handle_right_type"][-1] = _FREE
    parts = {
        name: np.concatenate([pairs[earlier], new_vectors[name], pairs[later]])
        for name, pairs in old_vectors.items()
    }
    types = {name: _kinds(curve, name) for name in _KINDS}
    types = {
        name: np.concatenate([old[earlier], kinds[name], old[later]]) for name, old in types.items()
    }
    curve.keyframe_points.clear()
    curve.keyframe_points.add(len(parts["co"]))
    _put(curve, parts, types)
    return True


def _cut(vectors, frame: float):
    """The four inner handles `[4, 2]` that the segment around a frame has once it is cut there.

    They belong to its beginning, to both sides of the cut, and to its end (de Casteljau). At a key
    they are the handles around the key. None where there is no segment.
    """
    vectors = {name: pairs.astype(np.float64) for name, pairs in vectors.items()}
    frames = vectors["co"][:, 0]
    number = int(np.abs(frames - frame).argmin())
    if abs(frames[number] - frame) <= _AT and 0 < number < len(frames) - 1:
        return np.array([
            vectors["handle_right"][number - 1], vectors["handle_left"][number],
            vectors["handle_right"][number], vectors["handle_left"][number + 1],
        ])  # fmt: skip
    number = int(np.searchsorted(frames, frame)) - 1
    if number < 0 or number + 1 >= len(frames):
        return None
    a, d = vectors["co"][number], vectors["co"][number + 1]
    b, c = vectors["handle_right"][number], vectors["handle_left"][number + 1]
    low, high = 0.0, 1.0
    for _ in range(50):
        t = 0.5 * (low + high)
        u = 1.0 - t
        x = u**3 * a[0] + 3 * u * u * t * b[0] + 3 * u * t * t * c[0] + t**3 * d[0]
        low, high = (t, high) if x < frame else (low, t)
    ab, bc, cd = a + t * (b - a), b + t * (c - b), c + t * (d - c)
    return np.array([ab, ab + t * (bc - ab), bc + t * (cd - bc), cd])


def _handles(points: np.ndarray, slopes: np.ndarray) -> dict[str, np.ndarray]:
    """The positions `[N, 2]` of keys, and those of their handles."""
    gaps = np.diff(points[:, 0])
    ends = gaps[:1] if len(gaps) else np.ones(1)
    before = REACH * np.concatenate([ends, gaps])
    behind = REACH * np.concatenate([gaps, gaps[-1:] if len(gaps) else np.ones(1)])
    return {
        "co": points,
        "handle_left": points - np.column_stack([before, before * slopes[:, 0]]),
        "handle_right": points + np.column_stack([behind, behind * slopes[:, 1]]),
    }


def _kinds_of(slopes: np.ndarray, count: int) -> dict[str, np.ndarray]:
    """The types of keys and handles; the handles of a key are aligned if their slopes agree."""
    same = np.where(slopes[:, 0] == slopes[:, 1], _ALIGNED, _FREE).astype(np.int32)
    return {
        "interpolation": np.full(count, _BEZIER, dtype=np.int32),
        "easing": np.zeros(count, dtype=np.int32),
        "handle_left_type": same,
        "handle_right_type": same.copy(),
    }


def _pairs(curve, name: str) -> np.ndarray:
    flat = np.empty(len(curve.keyframe_points) * 2, dtype=np.float32)
    curve.keyframe_points.foreach_get(name, flat)
    return flat.reshape(-1, 2)


def _kinds(curve, name: str) -> np.ndarray:
    numbers = np.empty(len(curve.keyframe_points), dtype=np.int32)
    curve.keyframe_points.foreach_get(name, numbers)
    return numbers


def _put(curve, vectors: dict[str, np.ndarray], kinds=None) -> None:
    for name, values in (kinds or {}).items():
        curve.keyframe_points.foreach_set(name, np.ascontiguousarray(values, dtype=np.int32))
    for name, pairs in vectors.items():
        curve.keyframe_points.foreach_set(name, pairs.astype(np.float32).ravel())
    curve.update()
