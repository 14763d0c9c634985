"""Solves for the values of a rig's controls that move the skin as it should, without Blender.

Each control moves the skin along a direction, which turns with the jaw. In each frame the solver
makes the sum of squared misses as small as the limits of the controls allow. A small share of the
same measure keeps values near rest and steps between frames short, so that controls with the same
effect do not fight each other. The method is coordinate descent with bounds (Hildreth 1957), on all
even frames at once and then on all odd ones, in the space of the directions' products.
"""

from collections.abc import Generator
from dataclasses import dataclass, field

import numpy as np

# Shares of a control's own effect that pull it to rest, and to the frames before and after.
_TO_REST, _TO_NEXT = 2e-3, 1e-2
# Descent ends when no value changes the skin by more than this share of the largest motion.
_NEAR = 1e-3
# The same limit for a solution that is only used to tell how far the jaw turns.
ROUGH = 2e-2
_MAX_SWEEPS = 60
# How often the solver runs anew with the turn of the jaw from the solution before.
_TURNS = 2
# The number of frames in a block; a block takes no longer than some hundredths of a second.
_BLOCK = 64


@dataclass
class Response:
    """How the skin responds to `C` controls.

    `directions` `[K, C, P, 3]` is the motion of each point for a unit of each control, while the
    control `jaw` stands at `knots` `[K]`, which rise. `jaw_motion` `[K, P, 3]` is the motion of the
    jaw at the knots. With one knot, at 0, the response is linear.
    """

    directions: np.ndarray
    jaw_motion: np.ndarray
    knots: np.ndarray
    jaw: int = 0

    @classmethod
    def linear(cls, directions: np.ndarray) -> "Response":
        """The response of directions `[C, P, 3]` that do not turn."""
        points = directions.shape[1]
        return cls(directions[None], np.zeros((1, points, 3)), np.zeros(1))

    def at(self, values: np.ndarray) -> np.ndarray:
        """Motion `[T, P, 3]` for values `[T, C]`."""
        shares = hats(values[:, self.jaw], self.knots)
        others = values.copy()
        others[:, self.jaw] = 0.0
        moved = np.einsum("tk,kpx->tpx", shares, self.jaw_motion)
        if len(self.knots) == 1:
            moved = moved + values[:, self.jaw, None, None] * self.directions[0, self.jaw]
        for knot, directions in enumerate(self.directions):
            moved = moved + np.tensordot(shares[:, knot, None] * others, directions, axes=1)
        return moved


@dataclass
class Task:
    """The motion to reproduce, and how much each part of it counts.

    `target` `[T, P, 3]` is the motion of points, `importance` `[P]` their weights. `pairs` `[N, 2]`
    are points of the upper and the lower lip: the distance of each pair counts too, with the weight
    `gap`. `lowest` and `highest` `[C]` are the limits of the controls.
    """

    target: np.ndarray
    importance: np.ndarray
    lowest: np.ndarray
    highest: np.ndarray
    pairs: np.ndarray = field(default_factory=lambda: np.empty((0, 2), dtype=np.int64))
    gap: float = 0.0

    def observe(self, moved: np.ndarray) -> np.ndarray:
        """Motions `[N, P, 3]` as weighted rows `[N, M]`, whose squares add up to what counts."""
        shown = moved * np.sqrt(self.importance)[:, None]
        apart = moved[:, self.pairs[:, 0]].astype(np.float64) - moved[:, self.pairs[:, 1]]
        rows = [part.reshape(len(moved), -1) for part in (shown, apart * np.sqrt(self.gap))]
        return np.concatenate(rows, axis=1)


def hats(places: np.ndarray, knots: np.ndarray) -> np.ndarray:
    """The share `[T, K]` of each knot at each place `[T]`: linear in between, held at the ends."""
    return np.stack([np.interp(places, knots, row) for row in np.eye(len(knots))], axis=1)


def solve(
    response: Response, task: Task, start: np.ndarray | None = None, near: float = _NEAR
) -> Generator[None, None, np.ndarray]:
    """Returns values `[T, C]` within the limits; yields between short steps.

    `start` are the values of an earlier, coarser response. The descent ends when no value changes
    the skin by more than the share `near` of the largest motion.
    """
    frames, controls = len(task.target), response.directions.shape[1]
    values = np.zeros((frames, controls)) if start is None else start.copy()
    values = np.clip(values, task.lowest, task.highest)
    products = yield from _Products.of(response, task)
    for _ in range(_TURNS if len(response.knots) > 1 else 1):
        descent = _Descent(response, task, products, values)
        yield from descent.begin()
        for _ in range(_MAX_SWEEPS):
            if (yield from descent.sweep()) < near:
                break
        values = descent.values.T
    return values


@dataclass
class _Products:
    """Products of all rows with each other (`gram`) and with the target (`aim` `[K·C + K, T]`).

    The rows are the directions `[K·C]`, followed by the motions of the jaw `[K]`.
    """

    gram: np.ndarray
    aim: np.ndarray
    scale: float

    @classmethod
    def of(cls, response: Response, task: Task) -> Generator[None, None, "_Products"]:
        """Computes the products; yields after each block of frames."""
        points = task.target.shape[1]
        flat = response.directions.reshape(-1, points, 3)
        rows = task.observe(np.concatenate([flat, response.jaw_motion]))
        aim, largest = np.empty((len(rows), len(task.target))), 0.0
        for first in range(0, len(task.target), _BLOCK):
            target = task.observe(task.target[first : first + _BLOCK])
            aim[:, first : first + _BLOCK] = rows @ target.T
            largest = max(largest, float((target**2).sum(axis=1).max(initial=0.0)))
            yield
        return cls(rows @ rows.T, aim, max(largest**0.5, 1e-12))


class _Descent:
    """Coordinate descent for one linearisation about the jaw."""

    def __init__(self, response: Response, task: Task, products: _Products, values: np.ndarray):
        knots, controls = response.directions.shape[:2]
        self.values, self._task, self._products = values.T.copy(), task, products
        self._rows = [np.arange(knots) * controls + number for number in range(controls)]
        jaw = values[:, response.jaw]
        self._shares = hats(jaw, response.knots).T
        self._mixed = np.zeros((len(products.gram), len(values)))
        self._fixed = np.zeros((knots, len(values)))
        if knots > 1:
            # The jaw's motion is known where the jaw stands; its direction extrapolates from there.
            self._mixed[knots * controls :] = self._shares
            self._fixed = -self._shares * jaw
        self._jaw, self._count = response.jaw, _beside(np.ones(len(values)), slice(None))
        self._squares = np.empty((controls, len(values)))

    def begin(self) -> Generator[None, None, None]:
        """Prepares what every sweep needs; yields after each control."""
        least = 1e-9 * np.diag(self._products.gram).max(initial=1e-12)
        for number, rows in enumerate(self._rows):
            self._mix(number, slice(None))
            self._squares[number] = np.maximum(self._own(rows), least)
            yield

    def _own(self, rows: np.ndarray) -> np.ndarray:
        """The square `[T]` of a control's direction in each frame."""
        block = self._products.gram[np.ix_(rows, rows)]
        return np.einsum("at,ab,bt->t", self._shares, block, self._shares)

    def _mix(self, number: int, frames) -> None:
        rows = self._rows[number]
        mixed = self._shares[:, frames] * self.values[number, frames]
        if number == self._jaw:
            mixed = mixed + self._fixed[:, frames]
        self._mixed[rows, frames] = mixed

    def sweep(self) -> Generator[None, None, float]:
        """Improves every value once; yields after each control.

        Returns the largest change, as a share of the largest motion.
        """
        largest = 0.0
        for number in range(len(self.values)):
            for parity in range(2):
                largest = max(largest, self._step(number, slice(parity, None, 2)))
            yield
        return largest / self._products.scale

    def _step(self, number: int, frames: slice) -> float:
        rows, value = self._rows[number], self.values[number]
        if not value[frames].size:
            return 0.0
        slope = self._products.gram[rows] @ self._mixed[:, frames]
        slope -= self._products.aim[rows, frames]
        slope = (self._shares[:, frames] * slope).sum(axis=0)
        square = self._squares[number, frames]
        around, count = _beside(value, frames), self._count[frames]
        pull = square * (_TO_REST * value[frames] + _TO_NEXT * (count * value[frames] - around))
        step = (slope + pull) / (square * (1.0 + _TO_REST + _TO_NEXT * count))
        low, high = self._task.lowest[number], self._task.highest[number]
        fresh = np.clip(value[frames] - step, low, high)
        moved = np.abs(fresh - value[frames]) * np.sqrt(square)
        value[frames] = fresh
        self._mix(number, frames)
        return float(moved.max())


def _beside(value: np.ndarray, frames: slice) -> np.ndarray:
    """The sum of the values before and after each of `frames`."""
    around = np.zeros(len(value))
    around[1:] = value[:-1]
    around[:-1] += value[1:]
    return around[frames]


def share_shown(target: np.ndarray, shown: np.ndarray) -> float:
    """The share of the energy of the motion `target` `[T, P, 3]` that `shown` reproduces."""
    every = float((target.astype(np.float64) ** 2).sum())
    return 1.0 - float(((target - shown).astype(np.float64) ** 2).sum()) / max(every, 1e-20)


def largest_misses(
    target: np.ndarray, shown: np.ndarray, regions: np.ndarray, names: list[str]
) -> dict[str, float]:
    """The largest miss of each region in any frame, in the unit of the motion `[T, P, 3]`.

    `regions` `[P]` are indices into `names`.
    """
    apart = np.linalg.norm(target - shown, axis=2).max(axis=0, initial=0.0)
    misses = {name: apart[regions == number] for number, name in enumerate(names)}
    return {name: float(some.max()) for name, some in misses.items() if some.size}


def rigid_motions(rest: np.ndarray) -> np.ndarray:
    """An orthonormal basis `[P·3, 6]` of the small turns and shifts of points `[P, 3]`."""
    centred = rest - rest.mean(axis=0)
    turns = [np.cross(axis, centred) for axis in np.eye(3)]
    shifts = [np.broadcast_to(axis, rest.shape) for axis in np.eye(3)]
    columns = np.stack([part.ravel() for part in (*turns, *shifts)], axis=1)
    left, sizes, _ = np.linalg.svd(columns, full_matrices=False)
    return left[:, sizes > 1e-9 * sizes[0]]


def share_in(motions: np.ndarray, moved: np.ndarray) -> float:
    """The share of the energy of a motion `[P, 3]` that lies in an orthonormal basis of motions.

    In the basis of `rigid_motions` the share is 1 for a head that nods.
    """
    flat = moved.ravel().astype(np.float64)
    energy = float(flat @ flat)
    return float(((flat @ motions) ** 2).sum()) / max(energy, 1e-20)
