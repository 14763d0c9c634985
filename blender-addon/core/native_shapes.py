"""Library calls about shapes: a rig for any face, and shape weights solved from motion."""

import weakref
from contextlib import ExitStack
from ctypes import POINTER, c_char_p, c_float, c_uint32

import numpy as np

from .arrays import array_of, bytes_of, path_of
from .calls import Calls
from .job import Progress
from .take import NETWORK, Rig, ShapesBy, Solved

_FLOATS = POINTER(c_float)


class ShapeCalls(Calls):
    """The calls of `native.Engine` for shapes."""

    def rig(
        self,
        positions,
        triangles,
        landmarks,
        landmark_vertices,
        roles,
        progress: Progress,
        by: ShapesBy = NETWORK,
        path: str = "",
        source: str = "",
    ) -> Rig:
        """The ARKit shapes and visemes of a mesh that faces -Y with +Z up, in any units.

        The arguments are those of `native.Engine.find`. With `path` the rig is also written there,
        as .npz, or as .glb or a .vrm avatar, which keep everything else in `source`, the mesh's
        file.
        Raises `AnyfaceError`, with "input" also if `by` asks for the field of a head and no head
        of the model is like the face; or `Cancelled`.
        """
        with ExitStack() as handles:
            watch = handles.enter_context(self._watch(progress))
            mesh = self._mesh(handles, positions, triangles)
            request = self._face_request(handles, landmarks, landmark_vertices, roles)
            for name, is_on in ((b"by_field", by.field), (b"in_betweens", by.in_betweens)):
                self._call("anyface_request_set_number", request, name, is_on)
            arguments = self._handle, mesh, request, watch.handle
            rig = self._own(handles, "rig", "anyface_rig_new", *arguments)
            count = self._library.anyface_rig_shape_count(rig)
            vectors = np.empty((count, len(positions), 3), dtype=np.float32)
            for number in range(count):
                floats = vectors[number].ctypes.data_as(_FLOATS)
                self._call("anyface_rig_copy_shape", rig, number, floats, vectors[number].size)
            names = [self._library.anyface_rig_shape_name(rig, n).decode() for n in range(count)]
            notes = [self._library.anyface_rig_shape_note(rig, n) for n in range(count)]
            if path:
                self._call("anyface_rig_write", rig, path_of(source) or None, path_of(path))
        pairs = zip(names, notes, strict=True)
        return Rig(names, vectors, {name: text.decode() for name, text in pairs if text})

    def write_take(
        self,
        positions,
        triangles,
        landmarks,
        landmark_vertices,
        roles,
        clip: "Clip",
        path: str,
        progress: Progress,
    ) -> None:
        """Writes a clip as weights of its mesh's ARKit shapes: .glb, .usda, or .vrma for avatars.

        The other arguments and errors are those of `rig`.
        """
        with ExitStack() as handles:
            watch = handles.enter_context(self._watch(progress))
            mesh = self._mesh(handles, positions, triangles)
            request = self._face_request(handles, landmarks, landmark_vertices, roles)
            arguments = self._handle, mesh, request, watch.handle
            rig = self._own(handles, "rig", "anyface_rig_new", *arguments)
            self._call("anyface_clip_write_shapes", clip, rig, path_of(path))

    def solve(
        self,
        names: list[str],
        vectors: np.ndarray,
        lips: np.ndarray,
        moved: np.ndarray,
        progress: Progress,
        path: str = "",
        fps: float = 0.0,
    ) -> Solved:
        """Weights `[T, S]` of the shapes `vectors` `[S, V, 3]` for the motion `moved` `[T, V, 3]`.

        `lips` `[N, 2]` are pairs of vertices of the upper and the lower lip. Where the motion
        brings a pair together, the shapes do so as well as they can. With `path` the weights are
        also written there, as .csv or .json.
        """
        vectors = array_of("vectors", vectors, np.float32, len(names), "V", 3)
        moved = array_of("moved", moved, np.float32, "T", vectors.shape[1], 3)
        shapes = _shapes(names, vectors)
        motion = (moved.ctypes.data_as(_FLOATS), len(moved), moved.shape[1])
        arguments = (
            "anyface_weights_new",
            (*shapes, *motion, *_pairs(lips)),
            (len(moved), len(names)),
        )
        return self._solved(*arguments, progress, path, fps)

    def _solved(
        self, function, arguments, shape, progress: Progress, path: str, fps: float
    ) -> Solved:
        with ExitStack() as handles:
            watch = handles.enter_context(self._watch(progress))
            solved = self._own(handles, "weights", function, *arguments, watch.handle)
            weights = np.empty(shape, dtype=np.float32)
            self._copy("anyface_weights_copy", solved, weights)
            if path:
                self._call("anyface_weights_write", solved, path_of(path), fps)
            return Solved(weights, self._library.anyface_weights_left_out(solved))


class Clip:
    """A clip of `T` frames that stays in the library as long as this object lives. Shape weights
    are solved on it there, without a copy."""

    def __init__(self, engine, handle):
        """Takes over the handle and frees it with this object; `close` frees it earlier."""
        self._engine, self._handle, library = engine, handle, engine._library
        frames, vertices = library.anyface_clip_frame_count, library.anyface_clip_vertex_count
        self.shape = frames(handle), vertices(handle), 3
        self.close = weakref.finalize(self, library.anyface_clip_free, handle)

    @property
    def _as_parameter_(self):
        return self._handle

    def displacements(self) -> np.ndarray:
        """A copy of all displacements `[T, V, 3]`, in the space in which the mesh was given."""
        lent = self._engine._library.anyface_clip_displacements(self)
        return np.ctypeslib.as_array(lent, self.shape).copy()

    def weights(
        self,
        names: list[str],
        vectors: np.ndarray,
        lips: np.ndarray,
        way: np.ndarray,
        progress: Progress,
        path: str = "",
        fps: float = 0.0,
    ) -> Solved:
        """As `ShapeCalls.solve`, for the motion of the clip's first `V` vertices.

        `way` `[3, 3]` takes displacements of the clip into the space of the shapes.
        """
        vectors = array_of("vectors", vectors, np.float32, len(names), "V", 3)
        way = array_of("way", way, np.float32, 3, 3)
        turned = None if np.array_equal(way, np.eye(3)) else way.ctypes.data_as(_FLOATS)
        shapes = _shapes(names, vectors)
        arguments = (self, *shapes, vectors.shape[1], turned, *_pairs(lips))
        shape = self.shape[0], len(names)
        function = "anyface_weights_new_of_clip"
        return self._engine._solved(function, arguments, shape, progress, path, fps)


def _shapes(names: list[str], vectors: np.ndarray):
    """Shapes as the library takes them: names, vectors `[S, V, 3]`, and how many there are."""
    texts = (c_char_p * len(names))(*(bytes_of("name", name) for name in names))
    return texts, vectors.ctypes.data_as(_FLOATS), len(names)


def _pairs(lips: np.ndarray):
    """Pairs of vertices `[N, 2]` as the library takes them, and how many there are."""
    lips = array_of("lips", lips, np.uint32, "N", 2)
    return lips.ctypes.data_as(POINTER(c_uint32)), len(lips)
