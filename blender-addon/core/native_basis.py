"""Library calls that turn a clip into a few vectors and make sliders for their weights."""

from ctypes import POINTER, c_float

import numpy as np

from . import layers
from .calls import Calls
from .sliders import ALL, SliderChange
from .take import Basis

# A take of 50 s needs about 120. More would make a frame slow to play.
MAX_VECTORS = 256
_FLOATS = POINTER(c_float)


class BasisCalls(Calls):
    """The calls of `native.Engine` for bases and their sliders."""

    def _layers(self, handles, results, limit: float, watch) -> Basis:
        """One basis of speech and of what emotion adds to it; each may err by half of `limit`."""
        face, motion, clip = results
        speech = (self._handle, motion, watch.handle)
        content = self._own(handles, "motion", "anyface_motion_new_content", *speech)
        arguments = (self._handle, face, content, watch.handle)
        spoken = self._own(handles, "clip", "anyface_clip_new", *arguments)
        said = self._basis(handles, (face, content, spoken), 0.5 * limit, watch)
        more = self._own(handles, "clip", "anyface_clip_new_difference", clip, spoken)
        emotion, _ = self._vectors(handles, more, 0.5 * limit, watch)
        return layers.joined(said, emotion)

    def _basis(self, handles, results, limit: float, watch) -> Basis:
        """A face, its motion and its clip as a basis with sliders.

        `limit` and the basis' error are in mesh units here.
        """
        face, motion, clip = results
        basis, handle = self._vectors(handles, clip, limit, watch)
        shape = basis.weights.shape
        basis.sliders = self._sliders(handles, face, motion, clip, handle, shape, watch)
        basis.offered = self._sliders_offered
        return basis

    def _vectors(self, handles, clip, limit: float, watch):
        """A clip as a basis, and the library's handle of it."""
        arguments = (self._handle, clip, limit, MAX_VECTORS, watch.handle)
        basis = self._own(handles, "basis", "anyface_basis_new", *arguments)
        count = self._library.anyface_basis_shape_count(basis)
        frames = self._library.anyface_clip_frame_count(clip)
        vertices = self._library.anyface_clip_vertex_count(clip)
        vectors = np.empty((count, vertices, 3), dtype=np.float32)
        weights = np.empty((frames, count), dtype=np.float32)
        self._copy("anyface_basis_copy_shapes", basis, vectors)
        self._copy("anyface_basis_copy_weights", basis, weights)
        return Basis(vectors, weights, self._library.anyface_basis_max_error(basis)), basis

    def _sliders(self, handles, face, motion, clip, basis, shape, watch) -> dict[str, SliderChange]:
        """The sliders that move something; `shape` is `(T, K)` of the basis."""
        arguments = (self._handle, face, motion, clip, basis, watch.handle)
        sliders = self._own(handles, "sliders", "anyface_sliders_new", *arguments)
        slider_changes = {}
        for number, name in enumerate(ALL):
            count = self._library.anyface_sliders_knot_count(sliders, number)
            if count == 0:
                continue
            knots = np.empty(count, dtype=np.float32)
            changes = np.empty((count, *shape), dtype=np.float32)
            for function, array in (
                ("anyface_sliders_copy_knots", knots),
                ("anyface_sliders_copy_changes", changes),
            ):
                floats = array.ctypes.data_as(_FLOATS)
                self._call(function, sliders, number, floats, array.size)
            slider_changes[name] = SliderChange(knots, changes)
        return slider_changes
