"""The head that comes with Anyface, for artists who have no head at hand.

Its shape is sampled from the USC ICT FaceKit, Copyright (c) 2020 USC Institute for Creative
Technologies, MIT licence; `training/sample_head.py` packs it.
"""

from dataclasses import replace
from pathlib import Path

import bpy
import numpy as np

from ...core.take import FaceMesh

PACKED = Path(__file__).resolve().parents[2] / "sample_head.npz"
NAME = "Sample Head"
# Of the box about the head, metres.
HEIGHT = 0.38
HAIR = (0.035, 0.02, 0.012)
_MICROMETRES = 1e6


def mesh(height: float):
    """A new mesh of the head, looking along -Y with +Z up, its box centred on the origin.

    `height` is that of the box, in Blender's units.
    """
    with np.load(PACKED) as packed:
        data = {name: packed[name] for name in packed.files}
    named = zip(data["names"], data["colours"], strict=True)
    head_materials = [_material(str(name), colour) for name, colour in named]
    points = standing(_rows(data["positions"]) / _MICROMETRES, height)
    faces = _rows(data["triangles"]).tolist()
    return smooth_mesh(NAME, points, faces, head_materials, data["materials"].astype(np.int32))


def points_and_triangles(height: float) -> tuple[np.ndarray, np.ndarray]:
    """Positions `[V, 3]` float32 and triangles `[F, 3]` uint32 of the same head."""
    with np.load(PACKED) as packed:
        points = standing(_rows(packed["positions"]) / _MICROMETRES, height)
        return points.astype(np.float32), _rows(packed["triangles"]).astype(np.uint32)


def in_place_of(face: FaceMesh) -> FaceMesh:
    """The same head as a face that moves where a mesh has none and only names are animated."""
    points, triangles = points_and_triangles(HEIGHT)
    head = {"positions": points, "triangles": triangles, "matrix_world": np.eye(4)}
    own = {"landmarks": None, "landmark_vertices": None, "roles": None, "hints": []}
    return replace(face, **head, **own, axes="AUTO", stands_in=True)


def _rows(planes: np.ndarray) -> np.ndarray:
    """Whole numbers `[N, 3]` from the bytes `[4, 3 N]` of the differences between their rows."""
    differences = np.ascontiguousarray(planes.T).view("<i4").reshape(3, -1)
    return differences.T.cumsum(axis=0)


def smooth_mesh(name: str, points: np.ndarray, faces: list[list[int]], materials, numbers):
    """A new smooth mesh of points `[V, 3]` and faces; `numbers` are the materials of its faces."""
    data = bpy.data.meshes.new(name)
    data.from_pydata(points.tolist(), [], faces)
    for material in materials:
        data.materials.append(material)
    data.polygons.foreach_set("material_index", numbers)
    data.polygons.foreach_set("use_smooth", np.ones(len(data.polygons), dtype=bool))
    data.update()
    return data


def standing(points: np.ndarray, height: float, head: np.ndarray | None = None) -> np.ndarray:
    """Turns points `[V, 3]` of the file (+y up, +z out of the face) upright for Blender.

    The box of the head is scaled to `height` and centred on the origin. If `points` are only a part
    of the head, `head` `[W, 3]` holds the points of the whole head.
    """
    whole = _turned(points if head is None else head)
    low, high = whole.min(axis=0), whole.max(axis=0)
    return (_turned(points) - (low + high) / 2.0) * (height / (high[2] - low[2]))


def _turned(points: np.ndarray) -> np.ndarray:
    return points[:, [0, 2, 1]] * [1.0, -1.0, 1.0]


def materials(name: str, words: tuple[str, ...]) -> list:
    """A material for each of `words`, in the colour that the sample head has for that word.

    Words that the sample head does not have get the colour of hair.
    """
    with np.load(PACKED) as packed:
        colours = dict(zip(packed["names"].tolist(), packed["colours"], strict=True))
    colours["sockets"] = colours["mouth"]
    return [_material(word, colours.get(word, HAIR), name) for word in words]


def _material(name: str, colour, head: str = NAME):
    """A material in that colour (linear, `[3]`)."""
    material = bpy.data.materials.new(f"{head} {name.replace('_', ' ')}")
    material.diffuse_color = (*(float(part) for part in colour), 1.0)
    # From Blender 5.0 on, every material has nodes.
    if material.node_tree is None:
        material.use_nodes = True
    shader = next((n for n in material.node_tree.nodes if n.type == "BSDF_PRINCIPLED"), None)
    if shader is not None:
        shader.inputs["Base Color"].default_value = material.diffuse_color
    return material
