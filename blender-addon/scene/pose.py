"""Where a face stands: the mix of its shape keys at a frame."""

import bpy
import numpy as np

from ..core.take import FaceMesh
from . import feeling_mask
from .mesh import read_key


def at(ob, scene, frame: float, face: FaceMesh) -> np.ndarray | None:
    """Displacements `[V, 3]` of the face's own vertices from rest at a scene frame, object space.

    None where nothing moves it. Pieces beside the face rest: landmarks lie on the face.
    """
    shape_keys = ob.data.shape_keys
    if shape_keys is None:
        return None
    kept = scene.frame_current, scene.frame_subframe
    try:
        scene.frame_set(int(np.floor(frame)), subframe=float(frame % 1.0))
        shown = ob.evaluated_get(bpy.context.evaluated_depsgraph_get()).data.shape_keys
        blocks = shape_keys.key_blocks if shown is None else shown.key_blocks
        values = {block.name: 0.0 if block.mute else block.value for block in blocks}
    finally:
        scene.frame_set(kept[0], subframe=kept[1])
    moved = np.zeros((len(ob.data.vertices), 3), dtype=np.float32)
    for block in shape_keys.key_blocks[1:]:
        value = values.get(block.name, 0.0)
        if value != 0.0:
            away = read_key(block) - read_key(block.relative_key)
            moved += value * feeling_mask.weights(ob, block.vertex_group) * away
    if not moved.any():
        return None
    whole = np.zeros((len(face.positions), 3), dtype=np.float32)
    whole[: len(moved)] = moved
    return whole
