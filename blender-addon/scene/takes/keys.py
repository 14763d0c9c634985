"""Writes a take as shape keys."""

import numpy as np

from ...core.job import BEGUN, at_once
from ...core.take import Take
from .. import outputs
from ..animation import curves
from ..face import mesh
from ..outputs.output import play
from ..shape_keys import guard, record
from . import remove


def check(ob, take: Take) -> None:
    """Raises `AnyfaceError` if the output refuses `ob` or if its mesh changed after the read."""
    outputs.of_take(take).check_object(ob)
    if take.motion.vectors is not None:
        guard.check_size(ob, take.motion.vectors.shape[1])


def prepare(ob, take: Take, start_frame: float, scene_fps: float):
    """Makes the curves of a take in advance and yields after each; returns `curves.Prepared`.

    If the generator is closed before its end, it leaves nothing behind.
    """
    if take.motion.weights is None:
        return None
    prepared = curves.Prepared(f"{ob.name} Anyface")
    try:
        yield from prepared.make(_times(take, start_frame, scene_fps), take.motion)
    except BaseException:
        prepared.drop()
        raise
    return prepared


def _times(take: Take, start_frame: float, scene_fps: float) -> np.ndarray:
    """The scene frames of rest, of each frame of a take, and of rest again.

    Frame `t` lies at `start_frame + t · scene_fps / take.fps`.
    """
    return curves.with_rest(take.scene_frames(start_frame, scene_fps), scene_fps, take.earliest)


def write(ob, take: Take, start_frame: float, scene_fps: float) -> record.Record:
    """Puts `take` on `ob` with its first frame at `start_frame`; removes an earlier take.

    Nothing is written if `check` raises.
    """
    return at_once(writing(ob, take, start_frame, scene_fps, None))


def writing(ob, take: Take, start_frame: float, scene_fps: float, prepared: curves.Prepared | None):
    """Does what `write` does in steps: first keys, then curves. Yields `BEGUN` between the steps.

    The curves may be `prepared`. Blender evaluates the scene between the steps, since keys and
    curves at once would take too long.
    """
    check(ob, take)
    output, at = outputs.of_take(take), _times(take, start_frame, scene_fps)
    with guard.object_mode(ob):
        remove_earlier(ob)
        with guard.selection_kept(ob):
            take_record = record.Record(output.name)
            take_record.prepared = prepared
            guard.make_single_user(ob, take_record)
            record.write(ob.data.shape_keys, take_record)
            output.write(ob, take, mesh.read_basis(ob.data), at, take_record)
            record.write(ob.data.shape_keys, take_record)
            ob.data.update()
    if take_record.waiting is not None:
        yield BEGUN
        for _ in play(ob, take_record):
            yield BEGUN
        record.write(ob.data.shape_keys, take_record)
    return take_record


def remove_earlier(ob) -> None:
    """Removes the take that a new one replaces."""
    for output in outputs.ALL:
        if output.on_mesh:
            output.remove(ob)
    remove.remove(ob)
