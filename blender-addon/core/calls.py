"""Calls the native library, frees its handles and turns its failures into errors."""

import json
from collections.abc import Callable
from contextlib import ExitStack
from ctypes import CDLL, POINTER, byref, c_float, c_void_p, string_at
from typing import Any

import numpy as np

from .errors import AnyfaceError, Cancelled

_CANCELLED = 9
_KINDS = {3: "input", 4: "audio", 5: "mesh", 6: "face", 7: "weights", 8: "file", 13: "memory"}


class Calls:
    """The calls of `self._library` that every part of the binding shares."""

    _library: CDLL
    _handle: Any
    # Parts of the binding call these of one another; `native.Engine` joins them.
    _audio: Callable[..., Any]
    _face: Callable[..., Any]
    _face_request: Callable[..., Any]
    _found_face: Callable[..., Any]
    _life: Callable[..., Any]
    _mesh: Callable[..., Any]
    _motion: Callable[..., Any]
    _shape_weights: Callable[..., Any]
    _sliders_offered: tuple[str, ...]
    _spoken: Callable[..., Any]
    _watch: Callable[..., Any]

    def _own(self, handles: ExitStack, noun: str, function: str, *arguments):
        handle = self._make(function, *arguments)
        handles.callback(getattr(self._library, f"anyface_{noun}_free"), handle)
        return handle

    def _make(self, function: str, *arguments) -> c_void_p:
        out, error = c_void_p(), c_void_p()
        status = getattr(self._library, function)(*arguments, byref(out), byref(error))
        self._check(status, error)
        return out

    def _read(self, function: str, *arguments):
        """What a function of the library writes as JSON."""
        with ExitStack() as handles:
            text = self._own(handles, "text", function, *arguments)
            return json.loads(string_at(text))

    def _copy(self, function: str, handle, array: np.ndarray) -> None:
        self._call(function, handle, array.ctypes.data_as(POINTER(c_float)), array.size)

    def _call(self, function: str, *arguments) -> None:
        error = c_void_p()
        status = getattr(self._library, function)(*arguments, byref(error))
        self._check(status, error)

    def _check(self, status: int, error: c_void_p | None) -> None:
        if status == 0:
            return
        message = f"the library returned status {status}"
        if error:
            message = self._library.anyface_error_message(error).decode()
            self._library.anyface_error_free(error)
        if status == _CANCELLED:
            raise Cancelled
        raise AnyfaceError(_KINDS.get(status, "internal"), message)
