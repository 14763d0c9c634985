"""Fits the controls of a rig to the motion of a take, in short steps.

It nudges each control and reads the evaluated mesh, so that it sees the effect of constraints,
drivers and correctives. A jaw turns the controls that hang on it, so it tries these again with the
jaw half and fully open.
"""

from dataclasses import dataclass, field, replace

import numpy as np

from ...core import controls_plan, controls_solve
from ...core.controls_solve import Response, Task
from ...core.errors import AnyfaceError
from ...core.take import ControlMotion, Take
from . import control_bench, control_sources
from .control_bench import Bench
from .control_kinds import Control, Location, Number
from .control_sources import Source

# The size of a nudge: mm on a head of human size, radians, and the share of a range.
_NUDGE_MM, _NUDGE_TURN, _NUDGE_SHARE = 2.0, 0.05, 0.1
# A bone without limits moves no farther than this, mm.
_REACH_MM = 40.0
# A nudge that moves every point by less than this, mm, counts as no motion. A nudge whose motion is
# rigid to this share moves the whole head.
_STILL_MM, _RIGID = 0.05, 0.95
# Two opposite directions that differ by less than this share count as one straight line.
_STRAIGHT = 0.2
# The weight of the gap between the lips, as a share of the weight of all mouth points.
_GAP = 0.3
# A jaw that turns less than this, radians, carries nothing along.
_LEAST_TURN = 0.03
# If the rig shows less than this share of the motion, nobody sees that it speaks.
_LEAST_SHOWN = 0.03
# The number of frames at which the result is read from the evaluated mesh.
_READ_FRAMES = 32
# A control hangs on the jaw if more than this share of its motion is at points that the jaw moves.
_ON_JAW = 0.05


@dataclass
class Handle:
    """One free element of a control, for positive values, negative values or both.

    `direction` `[P, 3]` is the motion of the points for a unit of the element.
    """

    source: Source
    control: Control
    element: int
    direction: np.ndarray
    lowest: float
    highest: float
    nudge: float


@dataclass
class Fitted:
    """The motion of the controls: for each, the values `[T, N]` of its free elements.

    `shown` is the share of the motion's energy that the controls show. `missed` is the largest miss
    by region, mm. Both are set once the fit is judged. `sizes` `[N]` say for each control how far a
    unit of an element moves a point at most, mm. `actions` are prepared actions by data-block,
    which nothing plays yet.
    """

    moved: list[tuple[Control, np.ndarray]]
    sizes: list[np.ndarray] = field(default_factory=list)
    shown: float = 0.0
    missed: dict[str, float] = field(default_factory=dict)
    actions: dict = field(default_factory=dict)


def fit(
    ob,
    take: Take,
    sources: list[Source],
    rests: dict[tuple, float],
    judged: bool = True,
):
    """Returns the take with values for the controls of `sources`; yields between its steps.

    `rests` are the rest values of numbers that are animated now, by data-block and data path.
    Whenever it yields, all of the artist's values are as before. Raises
    `AnyfaceError("nothing_moved")` where no control moves the face. With `judged` it also raises
    where all controls together show next to nothing of the motion.
    """
    control_bench.check(ob)
    motion = take.motion
    bench = Bench(ob, rigs_of(sources), motion.vertices)
    handles = yield from try_all(ob, bench, motion, sources, rests)
    if not handles:
        raise AnyfaceError(
            "nothing_moved",
            f"nothing would move: no control moves the face of {ob.name}: pick its rig and press "
            "Find Controls, or choose New Keys",
        )
    task = _task(motion, handles)
    response = Response.linear(np.stack([handle.direction for handle in handles]))
    values = yield from controls_solve.solve(response, task, near=controls_solve.ROUGH)
    jaw = _jaw(handles, values)
    if jaw is not None:
        response = yield from _turned(bench, handles, values, jaw)
    values = yield from controls_solve.solve(response, task, values)
    if motion.pose_frames is not None:
        values = values[motion.pose_frames]
    if not judged:
        fitted = Fitted(_together(handles, values), _sizes(handles, motion.mm))
        return replace(take, motion=replace(motion, fitted=fitted))
    fitted = yield from _judge(bench, motion, handles, values)
    if fitted.shown < _LEAST_SHOWN:
        raise AnyfaceError(
            "nothing_moved",
            f"nothing would move: the controls of {ob.name} show {max(fitted.shown, 0.0):.0%} of "
            "the motion: check the list of controls, or choose New Keys",
        )
    return replace(take, motion=replace(motion, fitted=fitted))


def try_all(ob, bench: Bench, motion: ControlMotion, sources: list[Source], rests: dict):
    """The handles that move the face, but not the whole head; yields between the sources."""
    rest = bench.at_zero()
    centre, size = rest.mean(axis=0), np.ptp(rest, axis=0).max()
    handles, turns = [], controls_solve.rigid_motions(rest)
    for source in sources:
        scale = _scale(ob, source.block) / motion.mm
        if source.sided or _is_near(ob, source, centre, size):
            controls = source.controls(_REACH_MM * scale)
            with bench.at_rest(controls):
                for control in controls:
                    control.rest = rests.get((control.block, control.path), control.rest)
                    nudge = _nudge(control, _NUDGE_MM * scale)
                    tried = _try(bench, rest, source, control, nudge, motion.mm)
                    handles += [h for h in tried if _stays(turns, h.direction)]
        yield
    return handles


def rigs_of(sources: list[Source]) -> list:
    """The armatures whose bones are among `sources`."""
    return list({s.block.name: s.block for s in sources if s.kind == control_sources.BONE}.values())


def _scale(ob, block) -> float:
    """The length of a unit of `ob` in units of another object."""
    if getattr(block, "matrix_world", None) is None:
        return 1.0
    return max(ob.matrix_world.median_scale, 1e-9) / max(block.matrix_world.median_scale, 1e-9)


def _is_near(ob, source: Source, centre: np.ndarray, size: float) -> bool:
    """Whether a bone begins near the face. Bones farther away are not tried."""
    if source.kind != control_sources.BONE or source.name not in source.block.data.bones:
        return True
    head = source.block.data.bones[source.name].head_local
    place = ob.matrix_world.inverted_safe() @ source.block.matrix_world @ head
    return float(np.linalg.norm(np.array(place) - centre)) < size


def _nudge(control: Control, distance: float) -> float:
    if isinstance(control, Number):
        return min(_NUDGE_SHARE * (control.highest[0] - control.lowest[0]), _NUDGE_SHARE)
    return distance if type(control) is Location else _NUDGE_TURN


def _try(bench, rest, source: Source, control: Control, nudge: float, mm: float) -> list[Handle]:
    """The handles of one control, which is at rest before and after."""
    count, sided = len(control.indices), source.sided
    control.set([nudge] * count)
    moves = np.abs(bench.read() - rest).max() * mm >= _STILL_MM
    handles = []
    for element in range(count) if moves or sided else ():
        handles += _try_element(bench, rest, source, control, element, nudge, mm)
    control.set([0.0] * count)
    return handles


def _stays(turns: np.ndarray, direction: np.ndarray) -> bool:
    """Whether a motion leaves the head as a whole in place."""
    return controls_solve.share_in(turns, direction) < _RIGID


def _try_element(bench, rest, source, control, element, nudge, mm) -> list[Handle]:
    sided = source.sided
    low, high = control.lowest[element], control.highest[element]
    ends = {1.0: high} if not sided and high > 0.0 else {1.0: high, -1.0: low}
    sides = {}
    for sign, end in ends.items():
        if sign * end > 1e-6:
            moved = _direction(bench, rest, control, element, sign * min(nudge, sign * end))
            if np.abs(moved).max() * nudge * mm >= _STILL_MM:
                sides[sign] = moved
    both = list(sides.values())
    if not sides:
        return []
    if not sided or (len(both) == 2 and _apart(*both) < _STRAIGHT):
        return [Handle(source, control, element, np.mean(both, axis=0), low, high, nudge)]
    return [
        Handle(source, control, element, moved, min(low, 0.0) if sign < 0.0 else 0.0,
               max(high, 0.0) if sign > 0.0 else 0.0, sign * nudge)
        for sign, moved in sides.items()
    ]  # fmt: skip


def _direction(bench, rest, control, element: int, step: float, base=0.0) -> np.ndarray:
    """The motion `[P, 3]` for a unit of an element, measured from `base`."""
    values = [0.0] * len(control.indices)
    values[element] = base + step
    control.set(values)
    return (bench.read() - rest) / step


def _apart(first: np.ndarray, second: np.ndarray) -> float:
    return float(np.linalg.norm(first - second) / max(np.linalg.norm(first), 1e-20))


def _task(motion: ControlMotion, handles: list[Handle]) -> Task:
    importance = np.array(controls_plan.IMPORTANCE)[motion.regions]
    mouth = importance[motion.regions == 0].sum()
    return Task(
        motion.frames,
        importance,
        np.array([handle.lowest for handle in handles]),
        np.array([handle.highest for handle in handles]),
        motion.pairs,
        _GAP * mouth / max(len(motion.pairs), 1),
    )


def _jaw(handles: list[Handle], values: np.ndarray) -> int | None:
    """The index of the handle that turns most of the face; None where no handle turns far."""
    far = np.abs(values).max(axis=0)
    energy = np.array([(h.direction**2).sum() for h in handles]) * (values**2).sum(axis=0)
    turns = np.array([not isinstance(h.control, Number) and type(h.control) is not Location
                      for h in handles])  # fmt: skip
    energy[~turns | (far < _LEAST_TURN)] = 0.0
    return int(energy.argmax()) if energy.any() else None


def _turned(bench: Bench, handles: list[Handle], values: np.ndarray, jaw: int):
    """The response with the jaw at rest, half open, and open as far as `values` ever open it."""
    angles = values[:, jaw]
    most = float(angles[np.abs(angles).argmax()])
    knots = np.sort([0.0, 0.5 * most, most])
    rest_directions = np.stack([handle.direction for handle in handles])
    directions = np.stack([rest_directions] * 3)
    jaw_motion = np.zeros((3, *rest_directions.shape[1:]))
    others, rest = np.flatnonzero(_on_jaw(rest_directions, jaw)), bench.at_zero()
    for knot in np.flatnonzero(knots):
        opened = _with_jaw(bench, handles[jaw], float(knots[knot]))
        jaw_motion[knot] = opened - rest
        for number in [jaw, *others]:
            nudged = _with_jaw(bench, handles[jaw], float(knots[knot]), handles[number])
            directions[knot, number] = (nudged - opened) / handles[number].nudge
            yield
    return Response(directions, jaw_motion, knots, jaw)


def _on_jaw(directions: np.ndarray, jaw: int) -> np.ndarray:
    """Which handles `[C]` move the points that the jaw moves; the jaw itself does not count."""
    size = np.linalg.norm(directions[jaw], axis=1)
    moved = size > 0.02 * size.max()
    energy = (directions**2).sum(axis=2)
    follows = energy[:, moved].sum(axis=1) > _ON_JAW * energy.sum(axis=1)
    follows[jaw] = False
    return follows


def _with_jaw(bench: Bench, jaw: Handle, angle: float, other: Handle | None = None) -> np.ndarray:
    """The points `[P, 3]` with the jaw at `angle`, and if `other` is given, with it nudged."""
    steps = [(jaw, angle)] + ([(other, other.nudge)] if other is not None else [])
    values = {}
    for handle, step in steps:
        empty = np.zeros(len(handle.control.indices))
        _, moved = values.setdefault(id(handle.control), (handle.control, empty))
        moved[handle.element] += step
    with bench.at_rest([control for control, _ in values.values()]):
        for control, moved in values.values():
            control.set(moved)
        return bench.read()


def _judge(bench: Bench, motion: ControlMotion, handles: list[Handle], values: np.ndarray):
    """Judges the fit: reads how far the evaluated mesh really moves, at some of the frames."""
    moved = _together(handles, values)
    controls = [control for control, _ in moved]
    some = np.unique(np.linspace(0, len(values) - 1, _READ_FRAMES).round().astype(int))
    shown, rest = [], bench.at_zero(controls)
    for frame in some:
        with bench.at_rest(controls):
            for control, rows in moved:
                control.set(rows[frame])
            shown.append(bench.read())
        yield
    target, shown = motion.frames[some].astype(np.float64), np.stack(shown) - rest
    missed = controls_solve.largest_misses(
        target * motion.mm, shown * motion.mm, motion.regions, controls_plan.REGIONS
    )
    sizes = _sizes(handles, motion.mm)
    return Fitted(moved, sizes, controls_solve.share_shown(target, shown), missed)


def _together(handles: list[Handle], values: np.ndarray) -> list[tuple[Control, np.ndarray]]:
    """The values `[T, N]` of the free elements of each control that has a handle."""
    by_control = {}
    for handle, column in zip(handles, values.T, strict=True):
        control = handle.control
        empty = np.zeros((len(values), len(control.indices)))
        _, rows = by_control.setdefault(id(control), (control, empty))
        rows[:, handle.element] += column
    return list(by_control.values())


def _sizes(handles: list[Handle], mm: float) -> list[np.ndarray]:
    """The farthest that a unit of each control's elements `[N]` moves any point, mm.

    The controls are in the order of `_together`.
    """
    by_control = {}
    for handle in handles:
        sizes = by_control.setdefault(id(handle.control), np.zeros(len(handle.control.indices)))
        farthest = np.linalg.norm(handle.direction, axis=1).max() * mm
        sizes[handle.element] = max(sizes[handle.element], farthest)
    return list(by_control.values())
