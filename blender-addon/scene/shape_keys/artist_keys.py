"""A take on the artist's existing keys: only their values are animated."""

import numpy as np

from ...core import key_names
from ...core.key_names import Pair
from ..animation import curves, stand_in
from ..face.mesh import read_key
from . import record

# Points to the artist's action while our copy stands in for it, so that the file keeps the
# original.
REPLACED = record.REPLACED_ACTION


def find(ob, mapping: list[Pair]) -> list[Pair]:
    """The pairs whose keys can be animated; an empty `mapping` finds them by name.

    Driven, muted and locked keys are left to the artist.
    """
    shape_keys = ob.data.shape_keys
    if shape_keys is None:
        return []
    free = [block.name for block in _free(shape_keys)]
    if not mapping:
        return key_names.guess(free)[1]
    return [pair for pair in mapping if pair.key in free]


def full(ob, mapping: list[Pair]) -> list[Pair]:
    """As `find`, but it finds no keys that move nothing. It reads all keys, which takes a while.

    Visemes stand in for empty ARKit shapes of the mouth.
    """
    nothing = empty(ob, mapping)
    if not nothing:
        return find(ob, mapping)
    left = [block.name for block in _free(ob.data.shape_keys) if block.name not in nothing]
    preset, pairs = key_names.guess(left)
    lost = [pair.shape for pair in key_names.pairs(key_names.ARKIT, nothing)]
    if preset == key_names.ARKIT and any(shape.startswith(("jaw", "mouth")) for shape in lost):
        pairs = pairs + key_names.pairs(key_names.OCULUS, left)
    return pairs


def empty(ob, mapping: list[Pair]) -> list[str]:
    """Keys that are found by name but move no vertex, as avatars have them to fill a list.

    None with a `mapping`: the artist has chosen these keys.
    """
    if mapping or ob.data.shape_keys is None:
        return []
    blocks = ob.data.shape_keys.key_blocks
    return [name for name in names_of(find(ob, [])) if not _moves(blocks[name])]


def _moves(block) -> bool:
    return bool((read_key(block) != read_key(block.relative_key)).any())


def names_of(pairs: list[Pair]) -> list[str]:
    """The keys of pairs, each once."""
    return list(dict.fromkeys(pair.key for pair in pairs))


def factors(pairs: list[Pair]) -> tuple[list[str], np.ndarray]:
    """The shapes of pairs `[S]`, and how much each moves each key of `names_of`, `[S, K]`."""
    shown, keys = list(dict.fromkeys(pair.shape for pair in pairs)), names_of(pairs)
    matrix = np.zeros((len(shown), len(keys)), dtype=np.float32)
    for pair in pairs:
        matrix[shown.index(pair.shape), keys.index(pair.key)] += pair.factor
    return shown, matrix


def shown_by(pairs: list[Pair]) -> dict[str, str]:
    """The shape that each key shows most."""
    most = sorted(pairs, key=lambda pair: pair.factor)
    return {pair.key: pair.shape for pair in most}


def left_alone(ob, mapping: list[Pair]) -> list[str]:
    """Keys that show a shape but are not animated: driven, muted or locked ones."""
    shape_keys = ob.data.shape_keys
    if shape_keys is None:
        return []
    free = {block.name for block in _free(shape_keys)}
    names = [block.name for block in shape_keys.key_blocks if block.name not in free]
    ours = record.all_keys(shape_keys)
    pairs = mapping or key_names.guess([name for name in names if name not in ours])[1]
    return [key for key in names_of(pairs) if key in names]


def vectors(ob, names) -> np.ndarray:
    """The displacements of each key at value 1, `[S, V, 3]` in object space."""
    blocks = ob.data.shape_keys.key_blocks
    return np.stack(
        [read_key(blocks[name]) - read_key(blocks[name].relative_key) for name in names]
    )


def note_values(shape_keys, take_record: record.Record) -> None:
    """Notes the present values of the artist's keys, and sets the artist's curves on them aside."""
    blocks = shape_keys.key_blocks
    take_record.values = {name: blocks[name].value for name in take_record.values if name in blocks}
    paths = {curves.value_path(name) for name in take_record.values}
    take_record.replaced_print = (
        stand_in.play(shape_keys, REPLACED, shape_keys.animation_data, paths)
        or take_record.replaced_print
    )


def restore(shape_keys, take_record: record.Record) -> None:
    """Restores the artist's curves and key values after our curves were removed."""
    original, animation = shape_keys.pop(REPLACED, None), shape_keys.animation_data
    if original is not None and animation is not None and animation.action is not None:
        paths = {curves.value_path(name) for name in take_record.values}
        stand_in.give_back(original, animation, paths, take_record.replaced_print)
    for name, value in take_record.values.items():
        block = shape_keys.key_blocks.get(name)
        if block is not None:
            block.value = value


def _free(shape_keys) -> list:
    animation = shape_keys.animation_data
    drivers = animation.drivers if animation is not None else ()
    driven = {driver.data_path for driver in drivers}
    ours = record.all_keys(shape_keys)
    return [
        block
        for block in shape_keys.key_blocks
        if block != shape_keys.reference_key
        and block.name not in ours
        and curves.value_path(block.name) not in driven
        and not block.mute
        and not getattr(block, "lock_shape", False)
    ]
