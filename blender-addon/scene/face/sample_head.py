"""The head that comes with Anyface, for somebody who has none at hand.

Its shape is sampled from the USC ICT FaceKit, Copyright (c) 2020 USC Institute for Creative
Technologies, MIT licence; `training/default_head/make_sample.py` packs it.
"""

from pathlib import Path

import bpy
import numpy as np

PACKED = Path(__file__).resolve().parents[2] / "sample_head.npz"
NAME = "Sample Head"
_MICROMETRES = 1e6


def mesh(height: float):
    """A new mesh of the head, looking along -Y with +Z up, its box centred on the origin.

    `height` is that of the box, in Blender's units.
    """
    with np.load(PACKED) as packed:
        data = {name: packed[name] for name in packed.files}
    named = zip(data["names"], data["colours"], strict=True)
    own = [_material(str(name), colour) for name, colour in named]
    points = standing(data["positions"] / _MICROMETRES, height)
    return smooth_mesh(NAME, points, data["triangles"], own, data["materials"].astype(np.int32))


def smooth_mesh(name: str, points: np.ndarray, triangles: np.ndarray, materials, numbers):
    """A new mesh of points `[V, 3]` and triangles `[F, 3]`, whose materials are `numbers`."""
    made = bpy.data.meshes.new(name)
    made.from_pydata(points.tolist(), [], triangles.tolist())
    for material in materials:
        made.materials.append(material)
    made.polygons.foreach_set("material_index", numbers)
    made.polygons.foreach_set("use_smooth", np.ones(len(made.polygons), dtype=bool))
    made.update()
    return made


def standing(points: np.ndarray, height: float) -> np.ndarray:
    """Points `[V, 3]` of the file (+y up, +z out of the face) upright in Blender."""
    turned = points[:, [0, 2, 1]] * [1.0, -1.0, 1.0]
    low, high = turned.min(axis=0), turned.max(axis=0)
    return (turned - (low + high) / 2.0) * (height / (high[2] - low[2]))


def materials(name: str, triangles: int) -> tuple[list, np.ndarray]:
    """Materials for a head with the sample head's eyes, teeth and tongue, and for each of its
    `triangles` the number of its own: all skin but for these parts, which come last."""
    with np.load(PACKED) as packed:
        numbers, names, colours = packed["materials"], packed["names"], packed["colours"]
    of_skin = np.isin(names, ("skin", "lips", "mouth"))[numbers]
    parts = numbers[~of_skin]
    made = [_material(str(word), colour, name) for word, colour in zip(names, colours, strict=True)]
    own = np.full(triangles, int(np.flatnonzero(names == "skin")[0]), dtype=np.int32)
    own[triangles - len(parts) :] = parts
    return made, own


def _material(name: str, colour, head: str = NAME):
    """A material in that colour (linear, `[3]`)."""
    made = bpy.data.materials.new(f"{head} {name.replace('_', ' ')}")
    made.diffuse_color = (*(float(part) for part in colour), 1.0)
    # From 5.0 on every material has nodes.
    if made.node_tree is None:
        made.use_nodes = True
    shader = next((n for n in made.node_tree.nodes if n.type == "BSDF_PRINCIPLED"), None)
    if shader is not None:
        shader.inputs["Base Color"].default_value = made.diffuse_color
    return made
