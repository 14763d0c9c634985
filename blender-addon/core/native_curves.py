"""Library calls that reduce curves to few keys."""

from contextlib import ExitStack
from ctypes import POINTER, c_float, c_uint32, c_void_p

import numpy as np

from .arrays import array_of
from .calls import Calls
from .job import Progress
from .take import CurveKeys

_FLOATS, _ROWS = POINTER(c_float), POINTER(c_uint32)


class CurveCalls(Calls):
    """The calls of `native.Engine` for curves."""

    def few_keys(
        self,
        weights: np.ndarray,
        vectors: np.ndarray,
        tolerance: float,
        touching: np.ndarray | None,
        progress: Progress,
    ) -> list[CurveKeys]:
        """Few keys for the curves of `weights` `[T, K]` of the shapes `vectors` `[K, V, 3]`.

        In every frame each vertex stays within `tolerance` of its place, in the unit of the shapes.
        In frames that are `touching` `[T]` only a tenth of that is allowed. Raises `AnyfaceError`,
        or `Cancelled`.
        """
        weights = array_of("weights", weights, np.float32, "T", "K")
        vectors = array_of("vectors", vectors, np.float32, weights.shape[1], "V", 3)
        marks = touching
        if touching is not None:
            marks = array_of("touching", touching, np.uint8, len(weights))
        shapes = vectors.ctypes.data_as(_FLOATS), vectors.shape[1], tolerance
        arguments = weights.ctypes.data_as(_FLOATS), *weights.shape, *shapes, _bytes(marks)
        with ExitStack() as handles:
            watch = handles.enter_context(self._watch(progress))
            curves = self._own(handles, "curves", "anyface_curves_new", *arguments, watch.handle)
            return self._keys(curves, weights.shape[1])

    def few_keys_each(self, values: np.ndarray, limits: np.ndarray) -> list[CurveKeys]:
        """Few keys for curves `values` `[T, K]`; each curve has its own limit in `limits` `[K]`."""
        values = array_of("values", values, np.float32, "T", "K")
        limits = array_of("limits", limits, np.float32, values.shape[1])
        arguments = (
            values.ctypes.data_as(_FLOATS),
            *values.shape,
            limits.ctypes.data_as(_FLOATS),
            None,
        )
        with ExitStack() as handles:
            curves = self._own(handles, "curves", "anyface_curves_new_each", *arguments)
            return self._keys(curves, values.shape[1])

    def _keys(self, curves, count: int) -> list[CurveKeys]:
        rows_and_slopes = []
        for number in range(count):
            keys = self._library.anyface_curves_key_count(curves, number)
            rows, slopes = np.empty(keys, dtype=np.uint32), np.empty(keys, dtype=np.float32)
            places = rows.ctypes.data_as(_ROWS), slopes.ctypes.data_as(_FLOATS)
            self._call("anyface_curves_copy_keys", curves, number, *places, keys)
            rows_and_slopes.append(CurveKeys(rows.astype(np.int64), slopes))
        return rows_and_slopes


def _bytes(marks: np.ndarray | None):
    return None if marks is None else marks.ctypes.data_as(c_void_p)
