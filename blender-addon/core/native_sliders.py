"""The library's calls about what a finished take may still change."""

from ctypes import POINTER, c_float

import numpy as np

from .sliders import ALL, SliderChange

_FLOATS = POINTER(c_float)


class SliderCalls:
    """What `native.Engine` knows of sliders."""

    def _sliders(self, handles, face, motion, clip, basis, shape, watch) -> dict[str, SliderChange]:
        """The sliders that move something; `shape` is `(T, K)` of the basis."""
        given = (self._handle, face, motion, clip, basis, watch.handle)
        sliders = self._own(handles, "sliders", "anyface_sliders_new", *given)
        found = {}
        for number, name in enumerate(ALL):
            count = self._library.anyface_sliders_knot_count(sliders, number)
            if count == 0:
                continue
            knots = np.empty(count, dtype=np.float32)
            changes = np.empty((count, *shape), dtype=np.float32)
            for kind, array in (("knots", knots), ("changes", changes)):
                floats = array.ctypes.data_as(_FLOATS)
                self._call(f"anyface_sliders_copy_{kind}", sliders, number, floats, array.size)
            found[name] = SliderChange(knots, changes)
        return found
