"""Writes a take as shape keys."""

import numpy as np

from ..core.take import Take
from . import guard, mesh, outputs, record, remove
from .outputs.output import times


def write(ob, take: Take, start_frame: float, scene_fps: float) -> record.Record:
    """Puts `take` on `ob` with its first frame at `start_frame`; an earlier take goes.

    Frame `t` lies at `start_frame + t · scene_fps / take.fps`. Nothing is written where its output
    objects or the mesh has changed since it was read.
    """
    output = outputs.of_take(take)
    output.check_object(ob)
    made = output.vectors(take)
    if made is not None:
        guard.check_size(ob, made.shape[1])
    frames = start_frame + np.arange(take.frame_count) * (scene_fps / take.fps)
    at = times(frames, scene_fps)
    with guard.object_mode(ob):
        remove_earlier(ob)
        with guard.selection_kept(ob):
            taken = record.Record(output.name)
            guard.make_single_user(ob, taken)
            record.write(ob.data.shape_keys, taken)
            output.write(ob, take, mesh.read_basis(ob.data), at, taken)
            record.write(ob.data.shape_keys, taken)
            ob.data.update()
            return taken


def remove_earlier(ob) -> None:
    """Takes away the take that a new one replaces."""
    for output in outputs.ALL:
        if output.on_mesh:
            output.remove(ob)
    remove.remove(ob)


def add(ob, names: list[str], vectors: np.ndarray, everything: bool) -> None:
    """Keys that nobody animates yet, from `vectors` `[S, V, 3]` in object space.

    Those that move nothing are left out unless `everything` is wanted.
    """
    wanted = [number for number in range(len(names)) if everything or vectors[number].any()]
    if not wanted:
        return
    with guard.object_mode(ob), guard.selection_kept(ob):
        if ob.data.shape_keys is None:
            ob.shape_key_add(name="Basis", from_mix=False)
        rest = mesh.read_basis(ob.data)
        for number in wanted:
            mesh.add_key(ob, names[number], rest + vectors[number])
        ob.data.update()
