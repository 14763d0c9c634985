"""The vertex group that says where feeling acts; artists paint it with Blender's own brushes."""

import numpy as np

NAME = "Feeling Mask"


def of(ob) -> str:
    """The name of the group on `ob`; a new one is full everywhere, one that is there stays."""
    if NAME not in ob.vertex_groups:
        group = ob.vertex_groups.new(name=NAME)
        group.add(range(len(ob.data.vertices)), 1.0, "REPLACE")
    return NAME


def weights(ob, name: str) -> np.ndarray:
    """The weights `[V, 1]` of a vertex group, 0 where a vertex is not in it; 1 of no group."""
    group = ob.vertex_groups.get(name)
    if group is None:
        return np.ones((len(ob.data.vertices), 1), dtype=np.float32)
    at = group.index
    found = (sum(g.weight for g in v.groups if g.group == at) for v in ob.data.vertices)
    return np.fromiter(found, dtype=np.float32, count=len(ob.data.vertices))[:, None]


def drop(ob) -> None:
    """Takes the group away where no key follows it any more and nobody has painted it."""
    group, shape_keys = ob.vertex_groups.get(NAME), ob.data.shape_keys
    blocks = shape_keys.key_blocks if shape_keys is not None else ()
    if group is None or any(block.vertex_group == NAME for block in blocks):
        return
    if (weights(ob, NAME) == 1.0).all():
        ob.vertex_groups.remove(group)
