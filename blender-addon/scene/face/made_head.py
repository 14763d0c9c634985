"""A head made from a recipe, as an object whose landmarks are known."""

from dataclasses import dataclass

import bpy
import numpy as np
from mathutils import Vector

from ...core import finding
from ...core.job import Progress
from ...core.native_head import MadeHead
from ...core.take import FaceMesh, Found
from . import landmarks, sample_head

NAME = "Anyface Head"


def mesh(head: MadeHead, height: float):
    """A new mesh of the head, looking along -Y with +Z up, its box centred on the origin.

    `height` is that of the box, in Blender's units.
    """
    materials = sample_head.materials(NAME, head.material_names)
    points = sample_head.standing(head.positions.astype(np.float64), height)
    numbers = head.materials.astype(np.int32)
    data = sample_head.smooth_mesh(NAME, points, polygons(head.faces), materials, numbers)
    places = np.zeros((len(data.loops), 2), dtype=np.float32)
    places[: head.uv.size // 2] = head.uv.reshape(-1, 2)
    data.uv_layers.new(name="UVMap").data.foreach_set("uv", places.ravel())
    return data


def polygons(faces: np.ndarray) -> list[list[int]]:
    """Faces `[F, 4]` as lists for Blender; in `faces` a triangle repeats its last corner."""
    return [face[:3] if face[2] == face[3] else face for face in faces.tolist()]


@dataclass
class Likeness:
    """A snapshot for making a head that resembles a face.

    `work` needs no Blender data, so any thread may run it.
    """

    face: FaceMesh
    engine: object

    def work(self, progress: Progress) -> tuple[MadeHead, float, float]:
        """The head, its distance from the mesh in millimetres, and the height of its box in scene
        units.

        Raises `AnyfaceError`.
        """
        face_arrays = self.face.space.to_library(self.face)
        with finding.naming(self.face):
            head, far, metres = self.engine.head_like(*face_arrays, progress)
        return head, far, float(np.ptp(head.positions[:, 1])) / metres


def beside(ob, head: MadeHead, height: float):
    """A new object of the head beside `ob`, at the subject's left; `ob` stays as it is."""
    data = mesh(head, height)
    new = bpy.data.objects.new(NAME, data)
    # Objects cannot be added to collections of a linked file.
    collections = [collection for collection in ob.users_collection if collection.library is None]
    for collection in collections or [bpy.context.scene.collection]:
        collection.objects.link(new)
    points = np.empty(len(data.vertices) * 3, dtype=np.float32)
    data.vertices.foreach_get("co", points)
    corners = np.array([ob.matrix_world @ Vector(corner) for corner in ob.bound_box])
    low, high = corners.min(axis=0), corners.max(axis=0)
    half = float(np.abs(points.reshape(-1, 3)[:, 0]).max())
    new.location = (high[0] + 1.2 * half, (low[1] + high[1]) / 2.0, (low[2] + high[2]) / 2.0)
    keep_landmarks(new, head)
    return new


def keep_landmarks(ob, head: MadeHead) -> None:
    """Stores the landmarks on the object, so that no search is needed."""
    points = np.empty(len(ob.data.vertices) * 3, dtype=np.float32)
    ob.data.vertices.foreach_get("co", points)
    vertices = head.landmark_vertices
    face_points = Found(
        positions=points.reshape(-1, 3)[vertices],
        vertices=vertices,
        confidence=np.ones(len(vertices)),
        mouth="slit",
        part_roles=np.empty(0),
        part_of_vertex=np.empty(0),
    )
    landmarks.store(ob, face_points)
