"""The 52 ARKit shapes, and the visemes if wanted, as shape keys of a mesh."""

import numpy as np

from ..core import shapes
from ..core.errors import AnyfaceError
from . import guard, mesh


def check(ob, visemes: bool) -> None:
    """Raises `AnyfaceError("mesh")` where the artist has keys of these names."""
    if ob.data.shape_keys is None:
        return
    wanted = {*shapes.ARKIT, *(shapes.VISEMES if visemes else ())}
    taken = [name for name in guard.own_keys(ob.data.shape_keys) if name in wanted]
    if taken:
        raise AnyfaceError(
            "mesh",
            f"{ob.name} has a key {taken[0]} of its own: choose Existing Keys, which animates it",
        )


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
            block = ob.shape_key_add(name=names[number], from_mix=False)
            # From 5.0 on a new key has the value 1.
            block.value = 0.0
            moved = np.ascontiguousarray(rest + vectors[number], dtype=np.float32)
            block.points.foreach_set("co", moved.ravel())
        ob.data.update()
