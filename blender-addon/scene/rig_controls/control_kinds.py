"""Kinds of controls that move a face: the location of a bone, its rotation, and single numbers.

A control reads and sets its values, and knows the data path of its curves. Values are relative to
rest.
"""

import json
from dataclasses import dataclass

import bpy
import numpy as np
from mathutils import Color, Euler, Quaternion, Vector

from ...core import turn

# A bone without limits turns no farther than this, radians; a number changes no more than this.
MAX_TURN, MAX_VALUE = 1.0, 10.0
# The letters that name components in data paths.
_LETTERS = {Vector: "xyzw", Euler: "xyz", Quaternion: "wxyz", Color: "rgb"}
# Kinds of data-blocks that hold controls, by `ID.id_type`.
COLLECTIONS = {"OBJECT": "objects", "ARMATURE": "armatures", "MESH": "meshes"}


@dataclass
class Control:
    """Elements of one property that move together; `indices` are the free ones.

    `block` is the data-block and `path` the data path of the property. `lowest` and `highest` are
    the limits of each free element, from rest.
    """

    block: bpy.types.ID
    path: str
    indices: list[int]
    lowest: list[float]
    highest: list[float]
    # The bone that it moves (empty for a number), and the rest value of a number.
    bone: str = ""
    rest: float = 0.0

    @property
    def label(self) -> str:
        """The name that the artist knows."""
        return self.bone or self.path.rpartition("[")[2].strip("]\"'") or self.path

    @property
    def curve_path(self) -> str:
        """The data path of its curves. The index of an element is not part of it."""
        return self.path

    def read(self) -> list[float]:
        """The present values of the property."""
        raise NotImplementedError

    def write(self, values: list[float]) -> None:
        """Sets the property to values that `read` has returned."""
        raise NotImplementedError

    def set(self, moved) -> None:
        """Moves the free elements by `moved` from rest."""
        raise NotImplementedError

    def columns(self, moved: np.ndarray) -> dict[int, np.ndarray]:
        """The curves `[T]` of the property, by index, for values `[T, N]` of the free elements."""
        raise NotImplementedError


class Location(Control):
    """The location of a pose bone."""

    def read(self):
        return list(getattr(self._bone, self._name))

    def write(self, values):
        setattr(self._bone, self._name, values)

    def set(self, moved):
        values = [0.0, 0.0, 0.0]
        for index, value in zip(self.indices, moved, strict=True):
            values[index] = value
        self.write(values)

    def columns(self, moved):
        return dict(zip(self.indices, moved.T, strict=True))

    @property
    def _bone(self):
        return self.block.pose.bones[self.bone]

    @property
    def _name(self) -> str:
        return self.path.rpartition(".")[2]


class EulerTurn(Location):
    """The rotation of a pose bone with Euler angles; locked angles stay at 0."""


class VectorTurn(Location):
    """The rotation of a pose bone with a quaternion, or with an axis and an angle.

    Values are the components of the rotation vector, radians.
    """

    def set(self, moved):
        row = self.columns(np.array([moved]))
        self.write([float(row[index][0]) for index in range(4)])

    def columns(self, moved):
        vectors = np.zeros((len(moved), 3))
        vectors[:, self.indices] = moved
        if self._name == "rotation_quaternion":
            return dict(enumerate(turn.of_vectors(vectors).T))
        angles = np.linalg.norm(vectors, axis=1)
        # Without a rotation any axis will do.
        axes = np.where(angles[:, None] > 0.0, vectors, [0.0, 1.0, 0.0])
        axes = axes / np.linalg.norm(axes, axis=1, keepdims=True)
        return dict(enumerate([angles, *axes.T]))


class Number(Control):
    """A custom property, or another number, of an object, a bone or their data."""

    @property
    def curve_path(self):
        return self.path if _is_custom(self.path) or self.path[-1] != "]" else _body(self.path)

    def read(self):
        owner, key, index = split(self.block, self.path)
        value = owner[key] if index is None and _is_custom(self.path) else getattr(owner, key)
        return [float(value if index is None else value[index])]

    def write(self, values):
        put(self.block, self.path, values)

    def set(self, moved):
        self.write([self.rest + float(moved[0])])

    def columns(self, moved):
        return {self.indices[0]: self.rest + moved[:, 0]}


def _is_custom(path: str) -> bool:
    return path.endswith(('"]', "']"))


def _body(path: str) -> str:
    """A data path without the index at its end."""
    return path.rpartition("[")[0]


def split(block, path: str) -> tuple:
    """Splits a data path into a property's owner, its name and an index (None for the whole).

    Raises `ValueError` for a path that leads nowhere.
    """
    if _is_custom(path):
        at = path.rindex("[" + path[-2])
        owner = block.path_resolve(path[:at]) if at else block
        inside = path[at + 2 : -2].replace("\\'", "'") if path[-2] == "'" else None
        key = json.loads(path[at + 1 : -1]) if inside is None else inside
        if key not in owner:
            raise ValueError(f"{path}: no such property")
        return owner, key, None
    body, index = path, None
    if path.endswith("]"):
        body, index = _body(path), int(path.rpartition("[")[2][:-1])
    at = body.rfind(".")
    owner = block.path_resolve(body[:at]) if at >= 0 else block
    if not hasattr(owner, body[at + 1 :]):
        raise ValueError(f"{path}: no such property")
    return owner, body[at + 1 :], index


def put(block, path: str, values: list[float]) -> None:
    """Restores a property after its control is gone; `values` are what its `read` returned."""
    try:
        owner, key, index = split(block, path)
    except (ValueError, AttributeError):
        return
    if _is_custom(path):
        owner[key] = values[0]
    elif index is not None:
        getattr(owner, key)[index] = values[0]
    else:
        setattr(owner, key, values if len(values) > 1 else values[0])
    block.update_tag()


def number(block, path: str) -> Number | None:
    """The control of a number by its data path; None for a number that cannot move smoothly."""
    path = _indexed(block, path)
    try:
        owner, key, index = split(block, path)
        custom = _is_custom(path)
        value = owner[key] if custom else getattr(owner, key)
        value = value if index is None else value[index]
    except (ValueError, KeyError, IndexError, AttributeError, TypeError):
        return None
    if not isinstance(value, float) or _driven(block, path, index):
        return None
    try:
        low, high = _limits(owner, key, custom)
    except (AttributeError, KeyError):
        return None
    low, high = max(low, value - MAX_VALUE), min(high, value + MAX_VALUE)
    control = Number(block, path, [index or 0], [low - value], [high - value])
    control.rest = value
    return control


def _indexed(block, path: str) -> str:
    """Replaces the letter of a component by its index: `scale.y` becomes `scale[1]`."""
    owner, _, letter = path.rpartition(".")
    try:
        letters = _LETTERS.get(type(block.path_resolve(owner)), "")
    except ValueError:
        return path
    is_component = len(letter) == 1 and letter in letters
    return f"{owner}[{letters.index(letter)}]" if is_component else path


def _limits(owner, key: str, custom: bool) -> tuple[float, float]:
    if custom:
        ui = owner.id_properties_ui(key).as_dict()
        return (max(ui.get("min", -MAX_VALUE), ui.get("soft_min", -MAX_VALUE)),
                min(ui.get("max", MAX_VALUE), ui.get("soft_max", MAX_VALUE)))  # fmt: skip
    rna = owner.bl_rna.properties[key]
    return rna.soft_min, rna.soft_max


def location(rig, bone, reach: float) -> Location | None:
    """The control of the location of a pose bone, or None.

    A bone without limits moves up to `reach` from rest.
    """
    if bone.bone.use_connect and bone.parent is not None:
        return None
    path = f"{bone.path_from_id()}.location"
    free = [i for i in range(3) if not bone.lock_location[i] and not _driven(rig, path, i)]
    low, high = _constrained(bone, "LIMIT_LOCATION", reach)
    return Location(rig, path, free, [low[i] for i in free], [high[i] for i in free], bone.name)


def rotation(rig, bone) -> Control | None:
    """The control of the rotation of a pose bone; None where it is driven."""
    mode = bone.rotation_mode
    name = {"QUATERNION": "rotation_quaternion", "AXIS_ANGLE": "rotation_axis_angle"}.get(
        mode, "rotation_euler"
    )
    path = f"{bone.path_from_id()}.{name}"
    euler = name == "rotation_euler"
    if not euler and any(_driven(rig, path, index) for index in range(4)):
        return None
    free = [i for i in range(3) if not bone.lock_rotation[i]]
    free = [i for i in free if not (euler and _driven(rig, path, i))]
    low, high = _constrained(bone, "LIMIT_ROTATION", MAX_TURN)
    kind = EulerTurn if euler else VectorTurn
    return kind(rig, path, free, [low[i] for i in free], [high[i] for i in free], bone.name)


def _driven(block, path: str, index: int | None) -> bool:
    path, index = (path, 0) if index is None else (_body(path) if path[-1] == "]" else path, index)
    animation = block.animation_data
    drivers = animation.drivers if animation is not None else ()
    return any(d.data_path == path and d.array_index == index for d in drivers)


def _constrained(bone, kind: str, reach: float) -> tuple[list[float], list[float]]:
    """The limits around rest that constraints in a bone's own space set."""
    low, high = [-reach] * 3, [reach] * 3
    for constraint in bone.constraints:
        if constraint.type != kind or constraint.mute or constraint.owner_space != "LOCAL":
            continue
        for i, axis in enumerate("xyz"):
            below, above = _limits_of(constraint, kind, axis)
            low[i], high[i] = max(low[i], min(below, 0.0)), min(high[i], max(above, 0.0))
    return low, high


def _limits_of(constraint, kind: str, axis: str) -> tuple[float, float]:
    below, above = getattr(constraint, f"min_{axis}"), getattr(constraint, f"max_{axis}")
    if kind == "LIMIT_ROTATION":
        used = getattr(constraint, f"use_limit_{axis}")
        return (below, above) if used else (-np.inf, np.inf)
    used = getattr(constraint, f"use_min_{axis}"), getattr(constraint, f"use_max_{axis}")
    return (below if used[0] else -np.inf), (above if used[1] else np.inf)


def at_rest(bone) -> bool:
    """True for a pose bone that nobody has moved."""
    _, basis_turn, scale = bone.matrix_basis.decompose()
    still = bone.location.length_squared == 0.0 and basis_turn == Quaternion()
    return still and scale == Vector((1.0, 1.0, 1.0))
