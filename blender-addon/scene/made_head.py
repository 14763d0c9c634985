"""A head made from numbers, as an object whose face is known."""

import bpy
import numpy as np

from ..core.native_head import MadeHead
from ..core.take import Found
from . import landmarks, sample_head

NAME = "Anyface Head"


def mesh(made: MadeHead, height: float):
    """A new mesh of the head, looking along -Y with +Z up, its box centred on the origin.

    `height` is that of the box, in Blender's units.
    """
    points = sample_head.standing(made.positions.astype(np.float64), height)
    data = bpy.data.meshes.new(NAME)
    data.from_pydata(points.tolist(), [], made.triangles.tolist())
    materials, numbers = sample_head.materials(NAME, len(made.triangles))
    for material in materials:
        data.materials.append(material)
    data.polygons.foreach_set("material_index", numbers)
    data.polygons.foreach_set("use_smooth", np.ones(len(data.polygons), dtype=bool))
    data.update()
    return data


def keep_landmarks(ob, made: MadeHead) -> None:
    """Stores the landmarks on the object: none need be searched."""
    points = np.empty(len(ob.data.vertices) * 3, dtype=np.float32)
    ob.data.vertices.foreach_get("co", points)
    vertices = made.landmark_vertices
    found = Found(
        positions=points.reshape(-1, 3)[vertices],
        vertices=vertices,
        confidence=np.ones(len(vertices)),
        mouth="slit",
        part_roles=np.empty(0),
        part_of_vertex=np.empty(0),
    )
    landmarks.store(ob, found)
