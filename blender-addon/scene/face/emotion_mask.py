"""The vertex group that says where emotion acts; artists paint it with Blender's own brushes."""

import numpy as np

NAME = "Emotion Mask"
# The colour attribute that shows where emotion acts, and its colours from 0 to 1.
HEAT = "Emotion Heat"
_COLOURS = ((0.0, 0.05, 0.35), (0.0, 0.45, 0.45), (0.9, 0.75, 0.1), (0.75, 0.02, 0.02))


def of(ob) -> str:
    """The name of the vertex group on `ob`.

    If there is none yet, adds one with weight 1 everywhere.
    """
    if NAME not in ob.vertex_groups:
        group = ob.vertex_groups.new(name=NAME)
        group.add(range(len(ob.data.vertices)), 1.0, "REPLACE")
    return NAME


def weights(ob, name: str) -> np.ndarray:
    """The weights `[V, 1]` of a vertex group: 0 for vertices outside it, all 1 without a group."""
    group = ob.vertex_groups.get(name)
    if group is None:
        return np.ones((len(ob.data.vertices), 1), dtype=np.float32)
    at = group.index
    sums = (sum(g.weight for g in v.groups if g.group == at) for v in ob.data.vertices)
    return np.fromiter(sums, dtype=np.float32, count=len(ob.data.vertices))[:, None]


def show_heat(ob, shares: np.ndarray) -> None:
    """Shows shares `[V]` as colours on the mesh; the artist's own colours stay the active ones."""
    colours = ob.data.color_attributes
    shown, rendered = colours.active_color_name, colours.render_color_index
    hide_heat(ob)
    heat = colours.new(HEAT, "FLOAT_COLOR", "POINT")
    if shown:
        colours.active_color_name, colours.render_color_index = shown, rendered
    at = np.clip(shares, 0.0, 1.0) * (len(_COLOURS) - 1)
    flat = np.ones((len(at), 4), dtype=np.float32)
    for axis, column in enumerate(np.transpose(_COLOURS)):
        flat[:, axis] = np.interp(at, range(len(column)), column)
    heat.data.foreach_set("color", flat.ravel())
    ob.data.update()


def shows_heat(ob) -> bool:
    """Whether the colours of `show_heat` are on the mesh."""
    return HEAT in ob.data.color_attributes


def hide_heat(ob) -> bool:
    """Removes the colours of `show_heat`; False where there are none."""
    heat = ob.data.color_attributes.get(HEAT)
    if heat is None:
        return False
    ob.data.color_attributes.remove(heat)
    return True


def drop(ob) -> None:
    """Removes the group once no key uses it, unless somebody has painted it."""
    group, shape_keys = ob.vertex_groups.get(NAME), ob.data.shape_keys
    blocks = shape_keys.key_blocks if shape_keys is not None else ()
    if group is None or any(block.vertex_group == NAME for block in blocks):
        return
    if (weights(ob, NAME) == 1.0).all():
        ob.vertex_groups.remove(group)
