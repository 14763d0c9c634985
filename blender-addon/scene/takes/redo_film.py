"""Redoes a stretch of a take that is stored frame by frame or animates a rig."""

import numpy as np

from ...core import redo
from ...core.job import BEGUN
from ...core.redo_film import FilmRedo
from ...core.take import Take
from .. import bake, outputs
from ..animation import curves
from ..life import head_and_eyes
from . import together


def read(ob, output, snapshot, bounds: tuple[float, float]) -> FilmRedo:
    """Reads all that a redo of the scene frames between `bounds` needs; raises `AnyfaceError`."""
    stretch, rows, at = _where(ob, output, snapshot, bounds)
    plan = output.redo_plan(ob, snapshot, rows.start, stretch.of_keyframes(at))
    return FilmRedo(snapshot, rows, plan, bounds)


def landing(ob, job: FilmRedo, take: Take):
    """Writes the frames in steps; returns one line about what it did."""
    snapshot = job.snapshot
    bake.follow_names(snapshot, take.motion.files)
    output = outputs.of(snapshot.settings.mode)
    stretch, rows, at = _where(ob, output, snapshot, job.bounds)
    parts = [ob, *together.others_of(ob)]
    yield from output.redo_write(parts, snapshot, take, rows.start, at, stretch)
    if take.life is not None:
        at = at[: len(take.life.head)]
        head_and_eyes.redo(
            ob, take.life, snapshot.settings, at, lambda *c: curves.splice(*c, stretch)
        )
    yield BEGUN
    return f"frames {stretch.first:g} to {stretch.last:g} redone"


def _where(ob, output, snapshot, bounds) -> tuple[redo.Stretch, range, np.ndarray]:
    """The stretch, the numbers of its frames in the take, and their scene frames."""
    start, step, count = output.span(ob, snapshot)
    ends = start + (count - 1) * step
    stretch = redo.Stretch(*bounds, start, ends, snapshot.scene_fps)
    rows = redo.rows_of(stretch, start, step)
    rows = range(rows.start, min(rows.stop, count))
    return stretch, rows, start + step * np.array(rows)
