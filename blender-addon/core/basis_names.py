"""Names new keys after what they do: jaw, wide, round, brows, blink left, …, rest.

The vectors of a basis are mixtures: each moves a bit of everything. `arrange` replaces them by
others that move the same vertices to the same places. The first ones follow controls: the weight of
"jaw" is how far the chin has come down. Its vector is the motion that goes along with that, by
least squares over all frames and controls at once. The other vectors hold the motion that the
controls leave, in order of size.
"""

import numpy as np

from .sliders import SliderChange
from .take import Basis

# The width (sigma) of a region around its landmarks (iBUG numbers), as a share of the distance
# between the eyes.
_NEAR = 0.18
_REGIONS = {
    "chin": range(6, 11),
    "brow right": range(17, 22),
    "brow left": range(22, 27),
    "nose": range(31, 36),
    "upper lid right": (37, 38),
    "lower lid right": (40, 41),
    "upper lid left": (43, 44),
    "lower lid left": (46, 47),
    "corner right": (48, 60),
    "corner left": (54, 64),
    "upper lip": (50, 51, 52, 61, 62, 63),
    "lower lip": (56, 57, 58, 65, 66, 67),
}
# Names of keys in their order. Each control is a weighted sum of how far regions move along an
# axis: x to the subject's left, y up, z out of the face. Motion of either sign gets the same name.
CONTROLS: dict[str, dict[tuple[str, str], float]] = {
    "jaw": {("chin", "y"): 1.0},
    "wide": {("corner left", "x"): 0.5, ("corner right", "x"): -0.5},
    "round": {("upper lip", "z"): 0.5, ("lower lip", "z"): 0.5, ("chin", "z"): -0.5},
    "upper lip": {("upper lip", "y"): 1.0, ("nose", "y"): -0.5},
    "lower lip": {("lower lip", "y"): 1.0, ("chin", "y"): -1.0},
    "corners": {
        ("corner left", "y"): 0.5,
        ("corner right", "y"): 0.5,
        ("upper lip", "y"): -0.25,
        ("lower lip", "y"): -0.25,
    },
    "mouth side": {("upper lip", "x"): 0.5, ("lower lip", "x"): 0.5},
    "jaw side": {("chin", "x"): 1.0},
    "nose": {("nose", "y"): 1.0},
    "brows": {("brow left", "y"): 0.5, ("brow right", "y"): 0.5},
    "brow left": {("brow left", "y"): 1.0},
    "brow right": {("brow right", "y"): 1.0},
    "blink": {
        ("upper lid left", "y"): 0.5,
        ("lower lid left", "y"): -0.5,
        ("upper lid right", "y"): 0.5,
        ("lower lid right", "y"): -0.5,
    },
    "blink left": {("upper lid left", "y"): 1.0, ("lower lid left", "y"): -1.0},
    "blink right": {("upper lid right", "y"): 1.0, ("lower lid right", "y"): -1.0},
}
REST = "rest"
# Controls of both sides, and the controls of each side that replace them if the sides differ.
_SIDES = {"brows": ("brow left", "brow right"), "blink": ("blink left", "blink right")}
# Columns of `Life.tongue`.
_TONGUE = ("tongue tip", "tongue middle", "tongue back", "tongue at teeth")
# These controls move by themselves. Each gets all motion that goes along with it while the others
# rest. Lips and brows go along with them, and get the motion that is left, one after the other.
_ALONE = ("jaw", "blink", *_TONGUE)
_AFTER = (
    "lower lip", "upper lip", "wide", "round", "corners", "mouth side", "jaw side", "nose", "brows",
)  # fmt: skip
_ORDER = (*CONTROLS, *_TONGUE)
# A control gets a key if it moves by at least _LEAST, in distances between the eyes, and if at
# least the share _OWN of its motion is left once the controls before it have taken theirs.
_LEAST = 0.012
_OWN = 0.25
# The largest condition number: new vectors that are nearly alike would need weights that cancel.
_WORST = 1e8
_FAINT = 1e-3
# The number of vertices that are transformed at a time, because that takes double precision.
_BLOCK = 16384


def arrange(basis: Basis, positions: np.ndarray, landmarks: np.ndarray, tongue=None) -> None:
    """Replaces vectors and weights of a basis by named ones that make the same take.

    `positions` `[V, 3]` and `landmarks` `[68, 3]` lie in the space of the vectors; `tongue`
    `[T, 4]` is that of `take.Life`, where it is known. Speech and emotion keep separate vectors.
    Names are those of `CONTROLS` and of the tongue; all other vectors are called rest.
    """
    axes = _axes(landmarks)
    if axes is None or not len(basis.vectors):
        return
    regions = _weights(positions, landmarks)
    first, count = basis.emotion_first, len(basis.vectors)
    layers = [(0, count, "")] if first is None else [(0, first, ""), (first, count, "emotion ")]
    names = []
    for start, end, layer in layers:
        part, spoken = slice(start, end), tongue if not layer else None
        names += [layer + name for name in _arrange(basis, part, axes, regions, spoken)]
    basis.names = names


def _arrange(basis: Basis, part: slice, axes, regions: np.ndarray, tongue) -> list[str]:
    """Arranges some of the vectors; returns their names."""
    vectors, weights = basis.vectors[part], basis.weights[:, part].astype(np.float64)
    count = len(vectors)
    if not count:
        return []
    moved = np.einsum("rv,kvc->krc", regions, vectors) @ axes.T
    amounts = {name: _amount(moved, name) for name in CONTROLS} | _of_tongue(weights, tongue)
    named, into = _way(weights, _products(vectors), amounts)
    if not np.linalg.cond(into) < _WORST:
        return _numbered([REST] * count)
    arranged = weights @ into
    peak = arranged[np.abs(arranged).argmax(axis=0), np.arange(count)]
    into = into / np.where(np.abs(peak) > 1e-12, peak, 1.0)
    back = np.linalg.inv(into)
    for at in range(0, vectors.shape[1], _BLOCK):
        block = slice(at, at + _BLOCK)
        basis.vectors[part, block] = np.tensordot(back, vectors[:, block], axes=1)
    basis.weights[:, part] = weights @ into
    for name, change in basis.sliders.items():
        changes = change.changes.copy()
        changes[:, :, part] = change.changes[:, :, part] @ into
        basis.sliders[name] = SliderChange(change.knots, changes)
    return named + _numbered([REST] * (count - len(named)))


def _of_tongue(weights: np.ndarray, tongue) -> dict[str, np.ndarray]:
    """How far each vector moves the tongue towards each of its places, `[K]`.

    Leaves out places whose motion the weights do not explain.
    """
    names = {}
    for name, over_time in zip(_TONGUE, () if tongue is None else tongue.T, strict=False):
        amount = np.linalg.lstsq(weights, over_time, rcond=1e-6)[0]
        missing = np.linalg.norm(over_time - weights @ amount)
        if missing < _OWN * np.linalg.norm(over_time):
            names[name] = amount
    return names


def _amount(moved: np.ndarray, control: str) -> np.ndarray:
    """How far each vector moves a control, `[K]`, in distances between the eyes."""
    number = {name: n for n, name in enumerate(_REGIONS)}
    amount = np.zeros(len(moved))
    for (region, axis), share in CONTROLS[control].items():
        amount += moved[:, number[region], "xyz".index(axis)] * share
    return amount


def _way(
    weights: np.ndarray, products: np.ndarray, amounts: dict[str, np.ndarray]
) -> tuple[list[str], np.ndarray]:
    """The names of the controls that move, and the matrix `[K, K]` from weights to new weights.

    Its first columns belong to these controls. The last ones hold the rest of the motion, the
    largest first. `products` `[K, K]` are the products of the vectors with one another.
    """
    count = len(products)
    # Motions belong together if they change together, not if they are merely there together: a
    # smile that stays is no part of a blink. `faint` is for vectors that only sliders use, which
    # may have no weight in the take itself.
    faint = _FAINT * np.eye(count)
    steps = np.concatenate([np.diff(weights, axis=0), faint])
    gram = steps.T @ steps
    left = np.eye(count)
    directions: dict[str, np.ndarray] = {}

    def take(names: list[str]) -> np.ndarray:
        """Removes from `left` all motion that goes along with the controls `names`, at once."""
        columns = left @ np.stack([amounts[name] for name in names], axis=1)
        directions.update(zip(names, columns.T, strict=True))
        return left - columns @ np.linalg.pinv(columns.T @ gram @ columns) @ columns.T @ gram @ left

    def is_own(name: str, shape: np.ndarray) -> bool:
        """Whether a control moves in a way of its own; `shape` `[K]` is what is left of it."""
        size, whole = np.linalg.norm(steps @ shape), np.linalg.norm(steps @ amounts[name])
        return np.ptp(weights @ shape) >= _LEAST and size >= _OWN * whole

    alone: list[str] = []
    for one in _moving(_ALONE, weights, amounts):
        others = np.stack([np.zeros(count), *(amounts[name] for name in alone)], axis=1)
        alike = np.linalg.lstsq(steps @ others, steps @ amounts[one], rcond=1e-9)[0]
        alone += [one] if is_own(one, amounts[one] - others @ alike) else []
    left = take(alone[: count - 1]) if alone[: count - 1] else left
    for one in _moving(_AFTER, weights, amounts):
        if len(directions) < count - 1 and is_own(one, left @ amounts[one]):
            left = take([one])
    named = [name for name in _ORDER if name in directions]
    values, turned = np.linalg.eigh(products)
    rest = left @ turned * np.sqrt(np.maximum(values, 1e-12 * values.max()))
    _, _, turned_rest = np.linalg.svd(np.concatenate([weights, faint]) @ rest, full_matrices=False)
    columns = [directions[name][:, None] for name in named]
    into = np.concatenate([*columns, rest @ turned_rest[: count - len(named)].T], axis=1)
    scale = np.linalg.norm(weights @ into, axis=0)
    # A vector that only sliders use has no size in the take: the size of its change counts.
    scale = np.maximum(scale, 0.1 * np.linalg.norm(into, axis=0))
    return named, into / np.where(scale > 0.0, scale, 1.0)


def _moving(names, weights: np.ndarray, amounts: dict[str, np.ndarray]) -> list[str]:
    """The controls that move: both sides as one, or each side if the two differ."""
    chosen: list[str] = []
    for name in names:
        sides = _SIDES.get(name, ())
        one, other = (weights @ amounts[side] for side in sides or ("jaw", "jaw"))
        apart = sides and np.ptp(one - other) > _OWN * np.ptp(one + other)
        chosen += sides if apart else [name] if name in amounts else []
    return [name for name in chosen if np.ptp(weights @ amounts[name]) >= _LEAST]


def _products(vectors: np.ndarray) -> np.ndarray:
    flat = vectors.reshape(len(vectors), -1)
    return (flat @ flat.T).astype(np.float64)


def _axes(landmarks: np.ndarray) -> np.ndarray | None:
    """Left, up and forward of a face as rows `[3, 3]`, None if the landmarks have no extent.

    The unit of length is the distance between the eyes.
    """
    right, left = landmarks[36:42].mean(axis=0), landmarks[42:48].mean(axis=0)
    x = left - right
    up = (right + left) / 2.0 - landmarks[48:68].mean(axis=0)
    size = np.linalg.norm(x)
    if not size > 0.0:
        return None
    x = x / size
    y = up - (up @ x) * x
    height = np.linalg.norm(y)
    if not height > 0.0:
        return None
    y = y / height
    return np.stack([x, y, np.cross(x, y)]) / size


def _weights(positions: np.ndarray, landmarks: np.ndarray) -> np.ndarray:
    """How much each vertex counts in each of `_REGIONS`, `[R, V]`, rows add up to 1."""
    eyes = landmarks[36:42].mean(axis=0) - landmarks[42:48].mean(axis=0)
    near = _NEAR * np.linalg.norm(eyes)
    weights = []
    for name, numbers in _REGIONS.items():
        distance = np.min(
            [((positions - landmarks[number]) ** 2).sum(axis=1) for number in numbers], axis=0
        )
        # Upper and lower lids and lips lie close together: narrow regions tell them apart.
        sigma = near * (0.3 if "li" in name else 1.0)
        share = np.exp(-distance / (2.0 * sigma**2))
        weights.append(share / max(share.sum(), 1e-12))
    return np.array(weights, dtype=np.float32)


def _numbered(labels: list[str]) -> list[str]:
    """The labels, with a number from the second of a kind on: jaw, jaw 2."""
    numbered: list[str] = []
    counts: dict[str, int] = {}
    for label in labels:
        counts[label] = counts.get(label, 0) + 1
        numbered.append(label if counts[label] == 1 else f"{label} {counts[label]}")
    return numbered
