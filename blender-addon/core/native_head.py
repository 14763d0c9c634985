"""Heads made from numbers: the library's parametric head."""

from contextlib import ExitStack
from ctypes import POINTER, byref, c_float, c_uint32, c_void_p
from dataclasses import dataclass
from functools import cache

import numpy as np

from .calls import Calls
from .job import Progress
from .library import library_path, load

_FLOATS, _INDICES = POINTER(c_float), POINTER(c_uint32)
FARTHEST = 4.0
"""Largest value of a slider; the smallest is its negative."""


@dataclass
class Recipe:
    """The head of `seed`, moved by `share` (0 to 1) towards the head of `other`. Then
    `changes` are added to its coordinates along the directions."""

    seed: int = 0
    other: int = 0
    share: float = 0.0
    changes: tuple[float, ...] = ()


@dataclass
class MadeHead:
    """`positions` `[V, 3]` metres (+x subject's left, +y up, +z forward); `faces` `[F, 4]`, skin
    first, where a triangle repeats its last corner; `uv` `[S, 4, 2]` of the skin's faces;
    `materials` `[F]`, indices into `material_names`; `landmark_vertices` `[68]`."""

    positions: np.ndarray
    faces: np.ndarray
    uv: np.ndarray
    materials: np.ndarray
    material_names: tuple[str, ...]
    landmark_vertices: np.ndarray


class HeadCalls(Calls):
    """The calls of `native.Engine` for heads."""

    def head_like(
        self, positions, triangles, landmarks, landmark_vertices, progress: Progress
    ) -> tuple[MadeHead, float, float]:
        """The head most like a mesh at rest, the mean distance between both (millimetres on a
        head of human size), and metres per unit of the mesh.

        The arguments are those of `native.Engine.find`. Raises `AnyfaceError`, also if no head is
        like the mesh, or `Cancelled`.
        """
        with ExitStack() as handles:
            watch = handles.enter_context(self._watch(progress))
            marks = landmarks, landmark_vertices
            face = self._found_face(handles, positions, triangles, marks, watch)
            head = self._own(handles, "head", "anyface_head_fit", None, face, watch.handle)
            result = self._made_head(handles, head)
            far = self._library.anyface_head_fit_mm(head)
            return result, far, self._library.anyface_face_metres_per_unit(face)

    def _made_head(self, handles: ExitStack, head) -> MadeHead:
        library, marks = self._library, np.empty(68, dtype=np.uint32)
        mesh, error = c_void_p(), c_void_p()
        status = library.anyface_head_mesh(
            head, 0, 1, None, byref(mesh), None, marks.ctypes.data_as(_INDICES), byref(error)
        )
        self._check(status, error)
        handles.callback(library.anyface_mesh_free, mesh)
        faces, skin = (
            library.anyface_head_face_count(head),
            library.anyface_head_skin_face_count(head),
        )
        names = (
            library.anyface_head_material_name(head, n)
            for n in range(library.anyface_head_material_count(head))
        )
        head_made = MadeHead(
            positions=np.empty((library.anyface_mesh_vertex_count(mesh), 3), np.float32),
            faces=np.empty((faces, 4), np.uint32),
            uv=np.empty((skin, 4, 2), np.float32),
            materials=np.empty(faces, np.uint32),
            material_names=tuple(name.decode() for name in names),
            landmark_vertices=marks,
        )
        self._copy("anyface_mesh_copy_positions", mesh, head_made.positions)
        self._copy("anyface_head_copy_uv", head, head_made.uv)
        faces, kinds = (
            array.ctypes.data_as(_INDICES) for array in (head_made.faces, head_made.materials)
        )
        self._call("anyface_head_copy_faces", head, faces, head_made.faces.size)
        self._call("anyface_head_copy_face_materials", head, kinds, head_made.materials.size)
        return head_made


class Heads(HeadCalls):
    """The model of heads. It loads no model of speech."""

    def __init__(self):
        """Raises `AnyfaceError` where there is no library."""
        self._library = load(library_path())

    @cache  # noqa: B019 - one object lives as long as Blender
    def directions(self) -> tuple[str, ...]:
        """What each slider changes most. Traits such as age come first, then the directions in
        which heads differ, in the order of how far they move the surface."""
        with ExitStack() as handles:
            head = self._of_seed(handles, 0)
            count = self._library.anyface_head_direction_count(head)
            names = (self._library.anyface_head_direction_name(head, n) for n in range(count))
            return tuple(name.decode() for name in names)

    def make(self, recipe: Recipe) -> MadeHead:
        """The mesh of a head at rest. Raises `AnyfaceError`."""
        with ExitStack() as handles:
            head = self._of_seed(handles, recipe.seed)
            if recipe.share > 0.0:
                other = self._of_seed(handles, recipe.other)
                mixed = (head, other, recipe.share)
                head = self._own(handles, "head", "anyface_head_new_mixed", *mixed)
            head = self._changed(handles, head, recipe.changes)
            return self._made_head(handles, head)

    def _of_seed(self, handles: ExitStack, seed: int):
        return self._own(handles, "head", "anyface_head_new", None, None, 0, seed)

    def _changed(self, handles: ExitStack, head, changes):
        count = self._library.anyface_head_direction_count(head)
        for number, change in enumerate(changes[:count]):
            if change == 0.0:
                continue
            along = np.empty(count, dtype=np.float32)
            self._copy("anyface_head_copy_directions", head, along)
            value = float(np.clip(along[number] + change, -FARTHEST, FARTHEST))
            moved = (head, number, value)
            head = self._own(handles, "head", "anyface_head_new_along", *moved)
        return head
