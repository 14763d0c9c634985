"""Writes a take as shape keys: a few basis keys with weights, or one key per frame."""

import numpy as np

from ..core.errors import AnyfaceError
from ..core.take import Take
from . import curves, guard, mesh, record, remove

PREFIX = "Anyface"
# The face comes out of rest before the first frame and goes back after the last.
EASE_S = 0.15


def write(ob, take: Take, start_frame: float, scene_fps: float) -> record.Record:
    """Puts `take` on `ob` with its first frame at `start_frame`; an earlier take goes.

    Frame `t` lies at `start_frame + t · scene_fps / take.fps`. Nothing is written where
    `guard.check_editable` objects or the mesh has changed since it was read.
    """
    guard.check_editable(ob, "frames" if take.frames is not None else "basis")
    vertices = (take.frames if take.frames is not None else take.basis.vectors).shape[1]
    if vertices != len(ob.data.vertices):
        raise AnyfaceError(
            "mesh",
            f"{ob.name} changed while the take was made: expected {vertices} vertices, "
            f"got {len(ob.data.vertices)}",
        )
    frames = start_frame + np.arange(take.frame_count) * (scene_fps / take.fps)
    ease = EASE_S * scene_fps
    with guard.object_mode(ob):
        remove.remove(ob)
        with guard.selection_kept(ob):
            return _write(ob, take, frames, ease)


def _write(ob, take, frames, ease) -> record.Record:
    taken = record.Record("frames" if take.frames is not None else "basis")
    guard.make_single_user(ob, taken)
    if ob.data.shape_keys is None:
        ob.shape_key_add(name="Basis", from_mix=False)
        taken.made_keys = True
    record.write(ob.data.shape_keys, taken)
    rest = mesh.read_basis(ob.data)
    if take.frames is not None:
        _write_frames(ob, take, rest, frames, ease, taken)
    else:
        _write_basis(ob, take, rest, frames, ease, taken)
    record.write(ob.data.shape_keys, taken)
    ob.data.update()
    return taken


def _write_basis(ob, take, rest, frames, ease, taken) -> None:
    """Relative keys; weights within -1..1 because Blender clamps values to the slider range."""
    bag = _channels(ob, taken)
    at = np.concatenate([[frames[0] - ease], frames, [frames[-1] + ease]])
    for number, vector in enumerate(take.basis.vectors):
        block = _add_key(ob, f"{PREFIX}.{number + 1:03d}", rest + vector, taken)
        block.slider_min, block.slider_max = -1.0, 1.0
        values = np.concatenate([[0.0], take.basis.weights[:, number], [0.0]])
        curves.write(bag, value_path(block.name), at, values)


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
    curves.write(_channels(ob, taken), "eval_time", at, np.array(times))


def value_path(name: str) -> str:
    """The data path of the value of a shape key."""
    escaped = name.replace("\\", "\\\\").replace('"', '\\"')
    return f'key_blocks["{escaped}"].value'


def _add_key(ob, name: str, positions: np.ndarray, taken):
    block = ob.shape_key_add(name=name, from_mix=False)
    block.points.foreach_set("co", np.ascontiguousarray(positions, dtype=np.float32).ravel())
    taken.keys.append(block.name)
    return block


def _channels(ob, taken: record.Record):
    """Where our curves go: the artist's action on these keys, or one of our own."""
    shape_keys = ob.data.shape_keys
    animation = shape_keys.animation_data
    if animation is None:
        animation = shape_keys.animation_data_create()
        taken.made_animation_data = True
    return curves.own_channels(animation, f"{ob.name} {PREFIX}", "KEY", taken)
