"""Library calls about events, and about motion in the form of shape weights."""

import json
import re
from contextlib import ExitStack
from ctypes import POINTER, c_char_p, c_float
from dataclasses import asdict

import numpy as np

from .arrays import array_of, bytes_of, path_of
from .calls import Calls
from .events import Event, shortened
from .take import ShapeWeights

_FLOATS = POINTER(c_float)


class EventCalls(Calls):
    """The calls of `native.Engine` for events, and for weights that the system makes itself."""

    def _events_json(self, events: list[Event]) -> str:
        """The events as the library takes them."""
        rows = [asdict(event) for event in events]
        for row in rows:
            del row["name"]
        return json.dumps(rows)

    def _unseen(self, face, motion, events: list[Event], watch) -> list[str]:
        """Sentences that say what this face cannot show of a motion and its named events."""
        said = self._read("anyface_motion_notes", self._handle, face, motion, watch.handle)
        return shortened(list(dict.fromkeys(_named(note, events) for note in said)))

    def _shape_weights(self, motion) -> ShapeWeights | None:
        """The shape weights that the system made for a motion; None if it made none."""
        count = self._library.anyface_motion_weight_count(motion)
        if count == 0:
            return None
        name = self._library.anyface_motion_weight_name
        names = [name(motion, number).decode() for number in range(count)]
        frames = self._library.anyface_motion_frame_count(motion)
        weights = np.empty((frames, count), dtype=np.float32)
        self._copy("anyface_motion_copy_weights", motion, weights)
        return ShapeWeights(names, weights)

    def write_weights(self, names: list[str], weights: np.ndarray, path: str, fps: float) -> None:
        """Writes shape weights `[T, S]` unchanged as .csv or .json; raises `AnyfaceError`."""
        weights = array_of("weights", weights, np.float32, "T", len(names))
        texts = (c_char_p * len(names))(*(bytes_of("name", name) for name in names))
        with ExitStack() as handles:
            values = (weights.ctypes.data_as(_FLOATS), len(names), len(weights))
            weights_handle = self._own(
                handles, "weights", "anyface_weights_new_from_array", texts, *values
            )
            self._call("anyface_weights_write", weights_handle, path_of(path), fps)


def _named(note: str, events: list[Event]) -> str:
    """Puts the event's name for its number, counted from 1, into a sentence of the library."""
    match = re.match(r"event (\d+) \(.*?\)", note)
    if match is None:
        return note
    name = events[int(match[1]) - 1].name
    return f"the event {name}{note[match.end() :]}" if name else note
