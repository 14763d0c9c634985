"""Writes a take as shape keys: a few basis keys with weights, or one key per frame."""

import numpy as np

from ..core.errors import AnyfaceError
from ..core.take import Take
from . import cache, changes, curves, existing, guard, mesh, record, remove
from .paths import value_path

PREFIX = "Anyface"
# The face comes out of rest before the first frame and goes back after the last.
EASE_S = 0.15


def write(ob, take: Take, start_frame: float, scene_fps: float) -> record.Record:
    """Puts `take` on `ob` with its first frame at `start_frame`; an earlier take goes.

    Frame `t` lies at `start_frame + t · scene_fps / take.fps`. Nothing is written where
    `guard.check_editable` objects or the mesh has changed since it was read.
    """
    guard.check_editable(ob, mode_of(take))
    made = _made(take)
    if made is not None:
        check_size(ob, made.shape[1])
    frames = start_frame + np.arange(take.frame_count) * (scene_fps / take.fps)
    ease = EASE_S * scene_fps
    with guard.object_mode(ob):
        remove_earlier(ob)
        with guard.selection_kept(ob):
            return _write(ob, take, frames, ease)


def check_size(ob, vertices: int) -> None:
    """Raises `AnyfaceError("mesh")` where the mesh has changed since it was read."""
    if vertices != len(ob.data.vertices):
        raise AnyfaceError(
            "mesh",
            f"{ob.name} changed while the take was made: expected {vertices} vertices, "
            f"got {len(ob.data.vertices)}",
        )


def remove_earlier(ob) -> None:
    """Takes away the take that a new one replaces."""
    cache.remove(ob)
    remove.remove(ob)


def mode_of(take: Take) -> str:
    """The output that a take in keys is of."""
    if take.frames is not None:
        return "frames"
    if take.basis is not None:
        return "basis"
    return "arkit" if take.key_motion.vectors is not None else "keys"


def _made(take: Take) -> np.ndarray | None:
    """What becomes keys, `[K, V, 3]`; None where the artist's keys are used."""
    made = take.key_motion if take.basis is None else take.basis
    return take.frames if take.frames is not None else made.vectors


def _write(ob, take, frames, ease) -> record.Record:
    taken = record.Record(mode_of(take))
    guard.make_single_user(ob, taken)
    if ob.data.shape_keys is None:
        ob.shape_key_add(name="Basis", from_mix=False)
        taken.made_keys = True
    record.write(ob.data.shape_keys, taken)
    rest = mesh.read_basis(ob.data)
    if take.frames is not None:
        _write_frames(ob, take, rest, frames, ease, taken)
    elif take.basis is not None:
        _write_basis(ob, take, rest, frames, ease, taken)
    elif taken.mode == "arkit":
        _write_arkit(ob, take.key_motion, rest, frames, ease, taken)
    else:
        existing.write(ob, take.key_motion, frames, ease, taken)
    record.write(ob.data.shape_keys, taken)
    ob.data.update()
    return taken


def _write_basis(ob, take, rest, frames, ease, taken) -> None:
    """Relative keys; Blender clamps their weights, within -1..1, to the slider range."""
    bag = curves.key_channels(ob, taken)
    at = np.concatenate([[frames[0] - ease], frames, [frames[-1] + ease]])
    taken.first_frame = float(frames[0])
    taken.frame_step = float(frames[-1] - frames[0]) / max(len(frames) - 1, 1)
    taken.still = take.basis.still
    changes.write(ob.data.shape_keys, taken, take.basis.packed)
    for number, vector in enumerate(take.basis.vectors):
        block = _add_key(ob, f"{PREFIX}.{number + 1:03d}", rest + vector, taken)
        values = np.concatenate([[0.0], take.basis.weights[:, number], [0.0]])
        if values.min() < 0.0:
            block.slider_min = -1.0
        curves.write(bag, value_path(block.name), at, values)


def _write_arkit(ob, motion, rest, frames, ease, taken) -> None:
    """Keys under the names of the shapes; those that are only asked for stay at 0."""
    for name, vector in zip(motion.keys, motion.vectors, strict=True):
        _add_key(ob, name, rest + vector, taken)
    made = list(taken.keys)
    if motion.still is not None:
        for name, vector in zip(motion.still.names, motion.still.vectors, strict=True):
            _add_key(ob, name, rest + vector, taken)
    bag = curves.key_channels(ob, taken)
    at = np.concatenate([[frames[0] - ease], frames, [frames[-1] + ease]])
    for number, name in enumerate(made):
        values = np.concatenate([[0.0], motion.weights[:, number], [0.0]])
        curves.write(bag, value_path(name), at, values)


def _write_frames(ob, take, rest, frames, ease, taken) -> None:
    """Absolute keys; `eval_time` meets the frame of each key exactly, so nothing drifts."""
    shape_keys = ob.data.shape_keys
    shape_keys.use_relative = False
    first = shape_keys.reference_key
    blocks = [
        _add_key(ob, f"{PREFIX}.{number + 1:05d}", rest + displacement, taken)
        for number, displacement in enumerate(take.frames)
    ]
    last = _add_key(ob, f"{PREFIX}.rest", rest, taken)
    for block in (first, *blocks, last):
        block.interpolation = "KEY_LINEAR"
    times = [block.frame for block in (first, *blocks, last)]
    at = np.concatenate([[frames[0] - ease], frames, [frames[-1] + ease]])
    curves.write(curves.key_channels(ob, taken), "eval_time", at, np.array(times))


def _add_key(ob, name: str, positions: np.ndarray, taken):
    block = ob.shape_key_add(name=name, from_mix=False)
    # From 5.0 on a new key has the value 1.
    block.value = 0.0
    block.points.foreach_set("co", np.ascontiguousarray(positions, dtype=np.float32).ravel())
    taken.keys.append(block.name)
    return block
