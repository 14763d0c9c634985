"""Library calls that cut lips apart, or eyes from their lids, where they are one surface."""

from contextlib import ExitStack
from ctypes import POINTER, c_float, c_uint32

import numpy as np

from .calls import Calls
from .job import Progress
from .take import OpenedFace

_FLOATS, _INDICES = POINTER(c_float), POINTER(c_uint32)


class OpeningCalls(Calls):
    """The calls of `native.Engine` that cut faces open."""

    def open_mouth(self, positions, triangles, *marks_and_progress) -> OpenedFace:
        """Parts the lips of a mesh and sews the inside of a mouth behind them; opens it as a test.

        The arguments are those of `native.Engine.find`. Raises `AnyfaceError`, or `Cancelled`.
        """
        return self._open("anyface_open_mouth", positions, triangles, *marks_and_progress)

    def open_eyes(self, positions, triangles, *marks_and_progress) -> OpenedFace:
        """Cuts free eyes that are one surface with their lids; lets them blink as a test.

        The arguments are those of `native.Engine.find`. Raises `AnyfaceError`, or `Cancelled`.
        """
        return self._open("anyface_open_eyes", positions, triangles, *marks_and_progress)

    def _open(
        self, call, positions, triangles, landmarks, landmark_vertices, progress: Progress
    ) -> OpenedFace:
        with ExitStack() as handles:
            watch = handles.enter_context(self._watch(progress))
            marks = landmarks, landmark_vertices
            face = self._found_face(handles, positions, triangles, marks, watch)
            parts = self._handle, face, watch.handle
            opened = self._own(handles, "opened_face", call, *parts)
            new = self._own(handles, "mesh", "anyface_opened_face_mesh", opened)
            return self._opened(opened, new)

    def _opened(self, opened, mesh) -> OpenedFace:
        vertices = self._library.anyface_mesh_vertex_count(mesh)
        faces = self._library.anyface_mesh_triangle_count(mesh)
        first_of_lips = self._library.anyface_opened_face_first_lining_triangle(opened)
        out = OpenedFace(
            positions=np.empty((vertices, 3), dtype=np.float32),
            triangles=np.empty((faces, 3), dtype=np.uint32),
            landmarks=np.empty((68, 3), dtype=np.float32),
            landmark_vertices=np.empty(68, dtype=np.uint32),
            vertex_sources=np.empty((vertices, 3), dtype=np.uint32),
            vertex_shares=np.empty((vertices, 3), dtype=np.float32),
            triangle_sources=np.empty(faces, dtype=np.uint32),
            corner_shares=np.empty((faces, 3, 3), dtype=np.float32),
            first_lining_triangle=first_of_lips,
            first_inside_triangle=self._library.anyface_opened_face_first_inside_triangle(opened),
        )
        self._copy("anyface_mesh_copy_positions", mesh, out.positions)
        self._call("anyface_mesh_copy_triangles", mesh, *_sized(out.triangles, _INDICES))
        places = out.landmarks.ctypes.data_as(_FLOATS)
        nearest = out.landmark_vertices.ctypes.data_as(_INDICES)
        self._call("anyface_opened_face_copy_landmarks", opened, places, nearest)
        numbers = out.vertex_sources.ctypes.data_as(_INDICES)
        shares = _sized(out.vertex_shares, _FLOATS)
        self._call("anyface_opened_face_copy_vertex_sources", opened, numbers, *shares)
        pair = (*_sized(out.triangle_sources, _INDICES), *_sized(out.corner_shares, _FLOATS))
        self._call("anyface_opened_face_copy_triangle_sources", opened, *pair)
        return out


def _sized(array: np.ndarray, kind) -> tuple:
    return array.ctypes.data_as(kind), array.size
