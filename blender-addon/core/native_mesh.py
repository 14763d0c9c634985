"""Library calls about meshes: from arrays, from polygons, from files."""

from contextlib import ExitStack
from ctypes import POINTER, c_float, c_uint32

import numpy as np

from .arrays import array_of, path_of
from .calls import Calls

_FLOATS, _INDICES = POINTER(c_float), POINTER(c_uint32)


class MeshCalls(Calls):
    """The calls of `native.Engine` for meshes."""

    def read_mesh(self, path: str) -> tuple[np.ndarray, np.ndarray]:
        """Positions `[V, 3]` float32 and triangles `[F, 3]` uint32 of an OBJ, PLY or GLB file.

        Raises `AnyfaceError`.
        """
        with ExitStack() as handles:
            mesh = self._own(handles, "mesh", "anyface_mesh_read", path_of(path))
            return self._arrays(mesh)

    def triangulate(self, positions, sizes, corners) -> tuple[np.ndarray, np.ndarray]:
        """Positions and triangles, as of `read_mesh`, of a mesh that is made of polygons.

        `sizes` `[P]` counts the corners of each; `corners` lists those of all in a row.
        Raises `AnyfaceError("mesh")`.
        """
        positions = array_of("positions", positions, np.float32, "V", 3)
        sizes = array_of("sizes", sizes, np.uint32, "P")
        corners = array_of("corners", corners, np.uint32, "C")
        points = (_pointer(positions, _FLOATS), len(positions))
        ends = (_pointer(sizes, _INDICES), len(sizes), _pointer(corners, _INDICES), len(corners))
        with ExitStack() as handles:
            arguments = ("mesh", "anyface_mesh_new_polygons", *points, *ends)
            return self._arrays(self._own(handles, *arguments))

    def _mesh(self, handles, positions, triangles):
        positions = array_of("positions", positions, np.float32, "V", 3)
        triangles = array_of("triangles", triangles, np.uint32, "F", 3)
        points = (_pointer(positions, _FLOATS), len(positions))
        corners = (_pointer(triangles, _INDICES), len(triangles))
        return self._own(handles, "mesh", "anyface_mesh_new", *points, *corners)

    def _arrays(self, mesh) -> tuple[np.ndarray, np.ndarray]:
        positions = np.empty((self._library.anyface_mesh_vertex_count(mesh), 3), dtype=np.float32)
        triangles = np.empty((self._library.anyface_mesh_triangle_count(mesh), 3), dtype=np.uint32)
        self._copy("anyface_mesh_copy_positions", mesh, positions)
        corners = _pointer(triangles, _INDICES)
        self._call("anyface_mesh_copy_triangles", mesh, corners, triangles.size)
        return positions, triangles


def _pointer(array: np.ndarray, kind):
    return array.ctypes.data_as(kind)
