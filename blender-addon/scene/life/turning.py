"""Rotation over time of an object or a bone, relative to its present rotation.

An object turns by its delta rotation, so the artist keeps its own rotation and its keyframes. A
bone has no delta rotation, so its rotation itself is animated, if nothing else animates it yet.
"""

from dataclasses import dataclass, field

import numpy as np
from mathutils import Matrix, Quaternion

from ...core import turn
from ...core.errors import AnyfaceError
from ..animation import curves

_EULER, _QUATERNION = "euler", "quaternion"


@dataclass
class Channel:
    """The data path of an object's property, its new values `[T, N]`, and those `before` `[N]`."""

    path: str
    values: np.ndarray
    before: list[float] = field(default_factory=list)


def of_object(ob, vectors: np.ndarray, mine: set[str], centre=None) -> list[Channel]:
    """The channels that turn `ob` by rotation vectors `[T, 3]` about the world's axes.

    Curves on the data paths `mine` may exist already. `ob` turns about its origin, or about
    `centre` `[3]` in the world if that is set. Raises `AnyfaceError("mesh")` if `ob` cannot be
    turned in this way.
    """
    parent = np.array(ob.matrix_world) @ _inverse(ob.matrix_basis, ob.name)
    turns = turn.of_vectors(vectors @ _rotation(parent, ob.name))
    kind = _kind(ob.rotation_mode, ob.name)
    rotation = getattr(ob, f"delta_rotation_{kind}")
    rest = rotation.to_quaternion() if kind == _EULER else rotation
    path = f"delta_rotation_{kind}"
    channels = [Channel(path, _values(turns, rest, ob.rotation_mode), list(rotation))]
    if centre is not None:
        origin = np.array(ob.matrix_basis.translation)
        away = origin - (np.linalg.inv(parent) @ [*centre, 1.0])[:3]
        shift = (turn.matrices(turns) - np.eye(3)) @ away
        if np.abs(shift).max(initial=0.0) > 1e-6:
            before = list(ob.delta_location)
            channels.append(Channel("delta_location", shift + before, before))
    return [_free(ob, channel, mine, ob.name) for channel in channels]


def of_bone(armature, name: str, vectors: np.ndarray, mine: set[str]) -> Channel:
    """The channel that turns a pose bone by rotation vectors `[T, 3]` about the world's axes.

    Raises `AnyfaceError("mesh")` for a bone that does not exist, or whose rotation has keyframes.
    """
    bone = armature.pose.bones.get(name) if armature.type == "ARMATURE" else None
    what = f"the bone {name} of {armature.name}"
    if bone is None:
        raise AnyfaceError("mesh", f"{what} is not there: pick another one under Life")
    at_rest = np.array(bone.matrix) @ _inverse(bone.matrix_basis, what)
    turns = turn.of_vectors(vectors @ _rotation(np.array(armature.matrix_world) @ at_rest, what))
    kind = _kind(bone.rotation_mode, what)
    rotation = getattr(bone, f"rotation_{kind}")
    rest = rotation.to_quaternion() if kind == _EULER else rotation
    path = bone.path_from_id(f"rotation_{kind}")
    channel = Channel(path, _values(turns, rest, bone.rotation_mode), list(rotation))
    return _free(armature, channel, mine, what)


def eulers(turns: np.ndarray) -> np.ndarray:
    """XYZ angles `[T, 3]` of quaternions `[T, 4]`, without jumps."""
    return _values(turns, Quaternion(), "XYZ")


def put_back(ob, channels: dict[str, list[float]]) -> None:
    """Sets the values of data paths; bones that are gone are skipped."""
    for path, values in channels.items():
        holder, _, name = path.rpartition(".")
        try:
            owner = ob.path_resolve(holder) if holder else ob
        except ValueError:
            continue
        setattr(owner, name, values)


def _values(turns: np.ndarray, rest, mode: str) -> np.ndarray:
    """The rotations `turns` on top of `rest` in a rotation mode, without jumps.

    The shape is `[T, 4]` for quaternions, otherwise `[T, 3]`.
    """
    every = turn.times(turns, np.tile(np.array(rest)[None], (len(turns), 1)))
    if mode == "QUATERNION":
        return every
    rows, last = [], Quaternion(rest).to_euler(mode)
    for row in every:
        last = Quaternion(row).to_euler(mode, last)
        rows.append(tuple(last))
    return np.array(rows)


def _kind(mode: str, what: str) -> str:
    if mode == "AXIS_ANGLE":
        raise AnyfaceError(
            "mesh", f"{what} rotates by axis and angle: set its rotation mode to XYZ or quaternion"
        )
    return _QUATERNION if mode == "QUATERNION" else _EULER


def _free(ob, channel: Channel, mine: set[str], what: str) -> Channel:
    """Returns the channel.

    Raises `AnyfaceError("mesh")` if the artist has keyframes or a driver on it.
    """
    animation = ob.animation_data
    bag = curves.channels(animation)
    animated = [*(bag.fcurves if bag is not None else ())]
    animated += animation.drivers if animation is not None else ()
    if channel.path not in mine and any(curve.data_path == channel.path for curve in animated):
        raise AnyfaceError(
            "mesh",
            f"{what} has keyframes or drivers on {channel.path}: pick an empty or a bone that has "
            "none there",
        )
    return channel


def _rotation(matrix: np.ndarray, what: str) -> np.ndarray:
    """The rotation `[3, 3]` nearest to the linear part of `matrix` (polar decomposition)."""
    linear = matrix[:3, :3] / max(np.abs(matrix[:3, :3]).max(), 1e-20)
    if not np.isfinite(linear).all() or np.linalg.cond(linear) > 1e6:
        raise AnyfaceError("mesh", f"{what} is scaled to zero along an axis: give it a scale first")
    left, _, right = np.linalg.svd(linear)
    # In a mirrored frame a rotation goes the other way about every axis.
    return left @ right * np.sign(np.linalg.det(linear))


def _inverse(matrix: Matrix, what: str) -> np.ndarray:
    try:
        return np.array(matrix.inverted())
    except ValueError as error:
        raise AnyfaceError(
            "mesh", f"{what} is scaled to zero along an axis: give it a scale first"
        ) from error
