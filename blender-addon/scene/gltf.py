"""Keeps weights within 0 and 1 during a glTF export, since importers and engines clamp the rest.

`Σ w v` with `w` from `m` to `M` equals `Σ (w - m)/(M - m) · (M - m) v + Σ m v`. The last sum
becomes one more shape, which stays at 1. In Blender a take keeps weights of both signs, because
then most weights in a frame are 0, which costs nothing. Blender's glTF exporter calls
`before_export` and `after_export` by the names that `__init__` gives them.
"""

import uuid
from dataclasses import dataclass, field

import bpy
import numpy as np

from . import outputs
from .animation import curves
from .face import emotion_mask
from .face.mesh import add_key, read_basis, read_key
from .shape_keys import guard, record
from .takes import nla, take_list

STANDING = "Anyface.standing"
# Marks shape keys that were changed, with the id of the change.
_MARK = "anyface_one_sided"


@dataclass
class _Changed:
    """The state of one mesh before the export.

    It holds positions, slider ranges, values and vertex groups of keys by name, and keyframes of
    curves by take and data path.
    """

    name: str
    mark: str = field(default_factory=lambda: uuid.uuid4().hex)
    keys: dict[str, tuple[np.ndarray, float, float, float, str]] = field(default_factory=dict)
    points: dict[tuple[str, str], dict[str, np.ndarray]] = field(default_factory=dict)
    standing: list[str] = field(default_factory=list)


_changed: list[_Changed] = []


def before_export(_settings) -> None:
    """Rewrites all basis takes that have negative weights; their motion stays the same."""
    after_export(_settings)
    mesh_names = set()
    for ob in bpy.data.objects:
        if ob.type != "MESH" or ob.data.library is not None or ob.data.name in mesh_names:
            continue
        mesh_names.add(ob.data.name)
        records = record.everyone(ob.data.shape_keys)
        basis_records = [one for one in records if outputs.of_record(one).as_basis]
        if basis_records:
            _rewrite(ob, basis_records)


def after_export(_settings) -> None:
    """Undoes the changes of `before_export`, also if the export has failed."""
    while _changed:
        changed = _changed.pop()
        ob = bpy.data.objects.get(changed.name)
        shape_keys = ob.data.shape_keys if ob is not None and ob.type == "MESH" else None
        # Another file may be open by now, with a face of the same name.
        if shape_keys is not None and shape_keys.get(_MARK) == changed.mark:
            _put_back(ob, changed)


def _rewrite(ob, records) -> None:
    changed = _Changed(ob.name)
    _changed.append(changed)
    ob.data.shape_keys[_MARK] = changed.mark
    with guard.object_mode(ob), guard.selection_kept(ob):
        for take_record in records:
            _rewrite_take(ob, take_record, changed)


def _rewrite_take(ob, take_record, changed: _Changed) -> None:
    shape_keys = ob.data.shape_keys
    bag = take_list.channels_of(shape_keys, take_record)
    standing, span = 0.0, None
    for name in take_record.keys if bag is not None else ():
        block, curve = shape_keys.key_blocks.get(name), bag.fcurves.find(curves.value_path(name))
        if block is None or curve is None or block.mute:
            continue
        before = {name: curves.places(curve, name) for name in curves.KEY_VECTORS}
        low = min(0.0, *(values[1::2].min() for values in before.values()))
        # The exporter ignores vertex groups of keys.
        if low == 0.0 and not block.vertex_group:
            continue
        high = max(0.0, *(values[1::2].max() for values in before.values()))
        changed.points[take_record.id, curve.data_path] = before
        curves.put(curve, {name: _within_one(values, low, high) for name, values in before.items()})
        standing = standing + low * _scale(ob, block, high - low, changed)
        span = np.array(curve.range())
    if span is not None:
        name = _add_standing(ob, bag, standing, span)
        changed.standing.append(name)
        if take_record.in_nla:
            nla.hold(nla.rest_channels(shape_keys), [name])


def _within_one(pairs: np.ndarray, low: float, high: float) -> np.ndarray:
    """Scales values from `low`..`high` to 0..1 in coordinates `[2T]` (frame, value, frame, …)."""
    pairs = pairs.copy()
    pairs[1::2] = (pairs[1::2] - low) / (high - low)
    return pairs


def _scale(ob, block, factor: float, changed: _Changed) -> np.ndarray:
    """Multiplies the motion of a key by `factor`, and applies its vertex group to it.

    Returns the displacements `[V, 3]` before the multiplication.
    """
    positions, at_rest = read_key(block), read_key(block.relative_key)
    limits = block.slider_min, block.slider_max, block.value
    changed.keys[block.name] = (positions, *limits, block.vertex_group)
    moved = emotion_mask.weights(ob, block.vertex_group) * (positions - at_rest)
    block.points.foreach_set("co", (at_rest + factor * moved).ravel())
    block.slider_min, block.slider_max, block.vertex_group = 0.0, 1.0, ""
    return moved


def _add_standing(ob, bag, vector: np.ndarray, span: np.ndarray) -> str:
    """Adds a key of the displacements `vector` `[V, 3]`, and returns its name.

    The key stays at 1 through the whole take.
    """
    block = add_key(ob, STANDING, read_basis(ob.data) + vector)
    curves.write(bag, curves.value_path(block.name), span, np.ones(2), constant=True)
    return block.name


def _put_back(ob, changed: _Changed) -> None:
    shape_keys = ob.data.shape_keys
    del shape_keys[_MARK]
    with guard.object_mode(ob), guard.selection_kept(ob):
        for take_record in record.everyone(shape_keys):
            bag = take_list.channels_of(shape_keys, take_record)
            _put_curves_back(bag, take_record.id, changed)
            _forget(bag, changed.standing)
        _forget(nla.rest_channels(shape_keys), changed.standing)
        for name in changed.standing:
            ob.shape_key_remove(shape_keys.key_blocks[name])
        for name, (positions, low, high, value, group) in changed.keys.items():
            block = shape_keys.key_blocks[name]
            block.points.foreach_set("co", positions.ravel())
            block.slider_min, block.slider_max, block.value = low, high, value
            block.vertex_group = group
    ob.data.update()


def _put_curves_back(bag, take_id: str, changed: _Changed) -> None:
    for (owner, path), before in changed.points.items():
        if owner == take_id:
            curves.put(bag.fcurves.find(path), before)


def _forget(bag, names: list[str]) -> None:
    for name in names if bag is not None else ():
        stale = bag.fcurves.find(curves.value_path(name))
        if stale is not None:
            bag.fcurves.remove(stale)
