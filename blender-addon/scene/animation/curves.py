"""F-curves of an ID's action across Blender's versions.

Up to 4.3 an action holds its curves itself; from 4.4 on they lie in the channelbag of a slot,
and 5.0 has no other way.
"""

from contextlib import suppress

import bpy
import numpy as np

from ...core.take import HeldKeys
from . import bezier

LAYERED = hasattr(bpy.types, "ActionSlots")
# Values of the interpolation enum of a keyframe.
_CONSTANT, _LINEAR = 0, 1
_GROUP = "Anyface"
# The attributes of a keyframe besides positions.
_KEY_FIELDS = ("interpolation", "easing", "handle_left_type", "handle_right_type")
_PREPARED = "anyface_{}"
KEY_VECTORS = ("co", "handle_left", "handle_right")
# The face leaves rest this long before the first frame, and returns to it this long after the last,
# seconds.
EASE_S = 0.15
# With less time than this share of `EASE_S`, the face would jump out of rest.
_LEAST_EASE = 0.5


def value_path(name: str) -> str:
    """The data path of the value of a shape key."""
    escaped = name.replace("\\", "\\\\").replace('"', '\\"')
    return f'key_blocks["{escaped}"].value'


def channels(animation_data, create: bool = False):
    """The holder of the curves (`.fcurves`, `.groups`) of this ID in its action, or None.

    With `create` it adds a layer, strip or channelbag of the assigned slot where one is missing.
    """
    action = animation_data.action if animation_data is not None else None
    if action is None:
        return None
    if not LAYERED:
        return action
    slot = animation_data.action_slot
    if slot is None:
        return None
    strip = _keyframe_strip(action, create)
    return strip.channelbag(slot, ensure=create) if strip is not None else None


def action_of(shape_keys):
    """The action assigned to a mesh's shape keys, or None. A mesh without keys passes None."""
    animation = shape_keys.animation_data if shape_keys is not None else None
    return animation.action if animation is not None else None


def _keyframe_strip(action, create: bool):
    for layer in action.layers:
        for strip in layer.strips:
            if strip.type == "KEYFRAME":
                return strip
    if not create:
        return None
    layer = action.layers[0] if len(action.layers) else action.layers.new("Layer")
    return layer.strips.new(type="KEYFRAME")


def find(animation_data, data_path: str):
    """The curve of `data_path`, or None."""
    bag = channels(animation_data)
    return bag.fcurves.find(data_path) if bag is not None else None


def find_any(animation_data, data_path: str):
    """A curve of any element of `data_path`, or None."""
    bag = channels(animation_data)
    every = bag.fcurves if bag is not None else ()
    return next((curve for curve in every if curve.data_path == data_path), None)


def write(
    bag,
    data_path: str,
    frames: np.ndarray,
    values: np.ndarray,
    constant=False,
    index=0,
    group=_GROUP,
) -> None:
    """Adds a curve with keys at `frames` `[T]`, linear or constant in between, to the group
    `group`.

    `index` is the element of a property that has several. An earlier curve of the same element is
    removed.
    """
    stale = bag.fcurves.find(data_path, index=index)
    if stale is not None:
        bag.fcurves.remove(stale)
    curve = bag.fcurves.new(data_path, index=index)
    curve.group = bag.groups.get(group) or bag.groups.new(group)
    points = curve.keyframe_points
    points.add(len(frames))
    pairs = np.column_stack([frames, values]).astype(np.float32)
    points.foreach_set("co", pairs.ravel())
    kind = _CONSTANT if constant else _LINEAR
    points.foreach_set("interpolation", np.full(len(frames), kind, dtype=np.int32))
    curve.update()


def write_take(
    bag, data_path: str, at: np.ndarray, values: np.ndarray, keys, index=0, lead=1
) -> None:
    """Adds the curve of a take: `values` `[lead + T + 1]` at the frames `at` of `with_rest`.

    Without `keys` every frame gets a keyframe, linear in between. `take.CurveKeys` name the frames
    that get one, with Bézier handles. With `take.HeldKeys` each value holds until the next key.
    """
    if keys is None:
        write(bag, data_path, at, values, index=index)
        return
    if isinstance(keys, HeldKeys):
        chosen = np.concatenate([np.arange(lead), keys.rows + lead, [len(at) - 1]])
        write(bag, data_path, at[chosen], values[chosen], constant=True, index=index)
        return
    chosen = np.concatenate([np.arange(lead), keys.rows + lead, [len(at) - 1]])
    step = (at[-2] - at[lead]) / max(len(at) - lead - 2, 1)
    slopes = np.concatenate([np.zeros(lead), keys.slopes / max(step, 1e-9), [0.0]])
    write(bag, data_path, at[chosen], values[chosen], index=index)
    curve = bag.fcurves.find(data_path, index=index)
    bezier.bend(curve, bezier.eased(at[chosen], values[chosen], slopes, lead))


def keys_of(motion) -> list:
    """The curve keys for each column of a motion's weights; None means a key on every frame."""
    return motion.keys_of_curves or [None] * motion.weights.shape[1]


class Prepared:
    """Curves of shape keys, made one by one beforehand in an action that nothing plays yet."""

    def __init__(self, name: str):
        self.action, self._bag = new_action(name)

    def make(self, frames: np.ndarray, motion):
        """Makes a curve for each column of a motion's weights and yields after each.

        The curves start from rest and return to it at the `frames` of `with_rest`.
        """
        for number, (column, keys) in enumerate(
            zip(motion.weights.T, keys_of(motion), strict=True)
        ):
            values, lead = from_rest(column, frames), rests_before(frames, len(column))
            path = _PREPARED.format(number)
            write_take(self._bag, path, frames, values, keys, lead=lead)
            yield

    def play(self, shape_keys, names: list[str]) -> bool:
        """Makes the shape keys play the action: `names` are the keys in the order of the curves.

        Returns False if the shape keys already play an action of the artist.
        """
        animation, self_action = shape_keys.animation_data, self.action
        if animation is None or animation.action is not None or self_action is None:
            return False
        fcurves = [self._bag.fcurves.find(_PREPARED.format(n)) for n in range(len(names))]
        for curve, name in zip(fcurves, names, strict=True):
            curve.data_path = value_path(name)
        assign(animation, self_action)
        self.action = None
        return True

    def drop(self) -> None:
        """Deletes the action if it was not used; an undo may have deleted it already."""
        with suppress(ReferenceError):
            delete_action(self.action)
        self.action = None


def with_rest(frames: np.ndarray, scene_fps: float, earliest: float = -np.inf) -> np.ndarray:
    """The scene frames `[T + 2]` of rest, of each frame of a take `[T]`, and of rest again.

    The face rests at whole frames, where an artist can see and grab the keys, and never before
    `earliest`. If that leaves too little time to move out of rest, the take begins in its first
    pose, and the result is `[T + 1]`.
    """
    ease = EASE_S * scene_fps
    first = max(np.floor(frames[0] - ease), np.ceil(earliest))
    lead = [first] if frames[0] - first >= _LEAST_EASE * ease else []
    return np.concatenate([lead, frames, [np.ceil(frames[-1] + ease)]])


def rests_before(at: np.ndarray, count: int) -> int:
    """How many of the scene frames `at` of `with_rest` lie before the `count` frames of a take."""
    return len(at) - count - 1


def from_rest(values: np.ndarray, at: np.ndarray) -> np.ndarray:
    """A take's values `[T, …]`, with zeros for rest, at the scene frames `at` of `with_rest`."""
    rest = np.zeros((1, *values.shape[1:]))
    return np.concatenate([rest[: rests_before(at, len(values))], values, rest])


def remove(animation_data, data_paths: set[str], group=_GROUP) -> None:
    """Removes the curves of `data_paths`, and our group of that name once it is empty."""
    bag = channels(animation_data)
    if bag is None:
        return
    for curve in [curve for curve in bag.fcurves if curve.data_path in data_paths]:
        bag.fcurves.remove(curve)
    our_group = bag.groups.get(group)
    if our_group is not None and len(our_group.channels) == 0:
        bag.groups.remove(our_group)


def of_group(animation_data) -> list:
    """The curves that we have made in the assigned action."""
    bag = channels(animation_data)
    group = bag.groups.get(_GROUP) if bag is not None else None
    return list(group.channels) if group is not None else []


def assign(holder, action) -> None:
    """Lets animation data, or a strip of the NLA, play an action of ours."""
    if holder.action != action:
        holder.action = action
    if LAYERED and holder.action_slot is None:
        holder.action_slot = action.slots[0]


def is_empty(action) -> bool:
    """True where no slot of the action holds a curve."""
    return all(len(bag.fcurves) == 0 for bag in bags(action))


def bags(action) -> list:
    """All holders of curves of an action."""
    if not LAYERED:
        return [action]
    strips = [strip for layer in action.layers for strip in layer.strips]
    return [bag for strip in strips for bag in strip.channelbags]


def own_channels(animation_data, name: str, id_type: str, record):
    """Where new curves go: the assigned action, or a new one called `name`.

    `record` notes whether an action or a slot was added. An action that the artist assigned keeps
    its slot and its curves.
    """
    if animation_data.action is None:
        action = bpy.data.actions.new(name)
        animation_data.action = action
        record.made_action = True
    if LAYERED and animation_data.action_slot is None:
        slot = animation_data.action.slots.new(id_type=id_type, name=name)
        animation_data.action_slot = slot
        record.made_slot = True
    return channels(animation_data, create=True)


def channels_empty(animation_data) -> bool:
    """True where the assigned slot (or action) holds no curve."""
    bag = channels(animation_data)
    return bag is None or len(bag.fcurves) == 0


def key_channels(ob, record):
    """Where curves of a mesh's shape keys go: the artist's action, or one of ours."""
    shape_keys = ob.data.shape_keys
    animation = shape_keys.animation_data
    if animation is None:
        animation = shape_keys.animation_data_create()
        record.made_animation_data = True
    return own_channels(animation, f"{ob.name} {_GROUP}", "KEY", record)


def new_action(name: str, id_type: str = "KEY"):
    """A new action for shape keys or another kind of ID, and the holder of its curves."""
    action = bpy.data.actions.new(name)
    if not LAYERED:
        return action, action
    slot = action.slots.new(id_type=id_type, name=name)
    strip = action.layers.new("Layer").strips.new(type="KEYFRAME")
    return action, strip.channelbag(slot, ensure=True)


def places(curve, name: str = "co") -> np.ndarray:
    """The coordinates `[2T]` of one of `KEY_VECTORS` of all keyframes: frame, value, frame, …"""
    coordinates = np.empty(len(curve.keyframe_points) * 2, dtype=np.float32)
    curve.keyframe_points.foreach_get(name, coordinates)
    return coordinates


def put(curve, named: dict[str, np.ndarray]) -> None:
    """Sets the coordinates `[2T]` of all keyframes, by the names of `KEY_VECTORS`."""
    for name, values in named.items():
        curve.keyframe_points.foreach_set(name, values)
    curve.update()


def splice(curve, at: np.ndarray, new: np.ndarray, stretch, few_keys=None) -> bool:
    """Mixes the keyframes of a curve inside a `core.redo.Stretch` with values `new` `[n]` at frames
    `at` `[n]`.

    Keyframes outside the stretch stay. A curve with few keys gets new ones at the frames that
    `few_keys(values)` (`take.CurveKeys`) names, or at all frames where it names none. Returns False
    where no keyframe lies inside.
    """
    if bezier.is_sparse(curve):
        return bezier.splice(curve, at, new, stretch, few_keys or (lambda values: None))
    points = places(curve)
    frames, values = points[0::2], points[1::2]
    shares = stretch.of_keyframes(frames)
    if not stretch.shares(frames.astype(np.float64)).any():
        return False
    added = np.where(shares > 0.0, shares * (np.interp(frames, at, new) - values), 0.0)
    moved = {name: places(curve, name) for name in KEY_VECTORS}
    for vectors in moved.values():
        vectors[1::2] += added.astype(np.float32)
    put(curve, moved)
    return True


def copy(source, bag) -> None:
    """Copies the curve `source` into `bag`; an earlier curve of the same property is removed."""
    place = {"data_path": source.data_path, "index": source.array_index}
    stale = bag.fcurves.find(**place)
    if stale is not None:
        bag.fcurves.remove(stale)
    curve = bag.fcurves.new(**place)
    curve.extrapolation, curve.mute, curve.lock = source.extrapolation, source.mute, source.lock
    if source.group is not None:
        name = source.group.name
        curve.group = bag.groups.get(name) or bag.groups.new(name)
    count = len(source.keyframe_points)
    curve.keyframe_points.add(count)
    for name in KEY_VECTORS:
        curve.keyframe_points.foreach_set(name, places(source, name))
    for name in _KEY_FIELDS:
        values = np.empty(count, dtype=np.int32)
        source.keyframe_points.foreach_get(name, values)
        curve.keyframe_points.foreach_set(name, values)
    curve.update()


def copy_paths(source, bag, data_paths: set[str]) -> None:
    """Copies the curves of `data_paths` from an action into `bag`."""
    for curve in [curve for other in bags(source) for curve in other.fcurves]:
        if curve.data_path in data_paths:
            copy(curve, bag)


def own_action(block, action) -> None:
    """If others use `action` too, gives `block` its own copy wherever it plays or stores it."""
    if action is None:
        return
    animation = block.animation_data
    tracks = animation.nla_tracks if animation is not None else ()
    strips = [strip for track in tracks for strip in track.strips if strip.action == action]
    names = [name for name, value in block.items() if value == action]
    plays = animation is not None and animation.action == action
    if action.users - action.use_fake_user <= len(strips) + len(names) + plays:
        return
    copy = action.copy()
    for name in names:
        block[name] = copy
    if plays:
        animation.action = copy
    for strip in strips:
        handle = strip.action_slot_handle if LAYERED else 0
        strip.action = copy
        if LAYERED:
            strip.action_slot = next(slot for slot in copy.slots if slot.handle == handle)


def delete_action(action) -> None:
    """Deletes an action that nobody else uses."""
    if action is not None and action.users - action.use_fake_user == 0:
        bpy.data.actions.remove(action)


def drop_empty_action(animation, record) -> None:
    """Removes the action or slot that was added for the take `record`, if it is empty."""
    action = animation.action
    if action is None:
        return
    if record.made_action and is_empty(action):
        animation.action = None
        delete_action(action)
    elif record.made_slot and channels_empty(animation):
        slot = animation.action_slot
        animation.action_slot = None
        action.slots.remove(slot)


def drop_idle_animation(block, is_ours: bool) -> None:
    """Removes animation data that we added, if nothing is left in it."""
    animation = block.animation_data
    if is_ours and animation.action is None and not animation.drivers and not animation.nla_tracks:
        block.animation_data_clear()
