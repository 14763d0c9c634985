"""Sliders that change a finished take without a new run.

A slider at 1 leaves the take as it was made. The library makes the take again at some positions of
each slider, its knots. Between neighbouring knots, or a knot and 1, the change is linear.
"""

import json
import struct
import zlib
from dataclasses import dataclass

import numpy as np

NAMES = ("articulation", "emotion", "blinks")
# What emotion and blinks change together beyond the sum of both; the artist gets no slider for it.
TOGETHER = "emotion_and_blinks"
# In the order of `AnyfaceSlider`.
ALL = (*NAMES, TOGETHER)
_MAGIC = b"AFS1"
_LENGTH = struct.Struct("<I")
# A take of an hour needs less when it is unpacked.
_LARGEST_BYTES = 512 << 20
# Steps of 1/2047 of a column's largest change: some thousandths of a millimetre.
_STEPS = 2047
_OVER_TIME = "its sliders changed over time: change the curves and generate again"
NONE = "this system has no such slider: change Performance and generate again"
_EMOTION_OFF = "the take was made with the emotion off, which keeps brows and lids still"
# Why a slider would move nothing.
_NO_EFFECT = {
    "articulation": "the take was made with an articulation of 0",
    "emotion": "the take was made without an emotion",
    "blinks": "nobody blinks in this take",
}


# What Python raises for JSON of another shape.
_MALFORMED = (AttributeError, KeyError, OverflowError, RecursionError, TypeError)


@dataclass
class SliderChange:
    """What a slider adds to the weights `[T, K]` of a take.

    `knots` `[N]` are in rising order; 1 is not among them, because nothing is added there.
    `changes` `[N, T, K]` are the additions at the knots.
    """

    knots: np.ndarray
    changes: np.ndarray

    @property
    def limits(self) -> tuple[float, float]:
        """Where the slider begins and ends."""
        return min(1.0, float(self.knots[0])), max(1.0, float(self.knots[-1]))

    def at(self, position: float) -> np.ndarray:
        """What is added at `position`, `[T, K]`; beyond the limits the same as at them."""
        above = int(np.searchsorted(self.knots, 1.0))
        knots = np.insert(self.knots, above, 1.0)
        place = float(np.clip(position, knots[0], knots[-1]))
        shares = [float(np.interp(place, knots, row)) for row in np.eye(len(knots))]
        del shares[above]
        return np.tensordot(np.array(shares, dtype=np.float32), self.changes, axes=1)


def place(name: str, placed: dict[str, float]) -> float:
    """The position of slider `name` of `ALL`; `placed` has those of `NAMES`, by default 1."""
    if name != TOGETHER:
        return placed.get(name, 1.0)
    return 1.0 - (1.0 - placed.get("emotion", 1.0)) * (1.0 - placed.get("blinks", 1.0))


def why_missing(request, sliders, offered: tuple[str, ...] = NAMES) -> dict[str, str]:
    """For each of `NAMES` that is not in `sliders`: a sentence why the take lacks this slider.

    `offered` are the sliders that the take's system has at all.
    """
    missing = {name: _NO_EFFECT[name] for name in NAMES if name not in sliders}
    if request.control_keys:
        missing = dict.fromkeys(missing, _OVER_TIME)
    elif request.fields.get("emotion") == "off":
        missing |= {name: _EMOTION_OFF for name in missing if name != "articulation"}
    return missing | {name: NONE for name in missing if name not in offered}


def pack(sliders: dict[str, SliderChange]) -> bytes:
    """Packs all sliders of a take into few bytes.

    Every column is rounded to steps and stored as differences from frame to frame; all low bytes
    stand before all high ones, which makes them easier to compress.
    """
    knots = {name: [float(knot) for knot in change.knots] for name, change in sliders.items()}
    changes = np.concatenate([change.changes for change in sliders.values()])
    head = json.dumps({"knots": knots, "shape": changes.shape}).encode()
    scale = np.abs(changes).max(axis=1, initial=1e-30, keepdims=True).astype("<f4")
    steps = np.rint(changes / scale * _STEPS).astype("<i2")
    steps[:, 1:] -= steps[:, :-1].copy()
    halves = np.ascontiguousarray(steps.swapaxes(1, 2)).view(np.uint8).reshape(-1, 2)
    body = scale.tobytes() + halves[:, 0].tobytes() + halves[:, 1].tobytes()
    return _MAGIC + _LENGTH.pack(len(head)) + head + zlib.compress(body, 6)


def unpack(packed: bytes) -> dict[str, SliderChange]:
    """Reverses `pack`, up to a rounding error; raises `ValueError` for other bytes."""
    start = len(_MAGIC) + _LENGTH.size
    if packed[: len(_MAGIC)] != _MAGIC or len(packed) < start:
        raise ValueError("sliders: expected what Anyface has packed")
    (length,) = _LENGTH.unpack(packed[len(_MAGIC) : start])
    try:
        head = json.loads(packed[start : start + length])
        (count, frames, columns), knots = head["shape"], head["knots"]
        ends = np.cumsum([len(places) for places in knots.values()])[:-1]
        # A few bytes could unpack into more than the memory holds.
        size = min(2 * count * columns * (2 + frames), _LARGEST_BYTES)
        unpacker = zlib.decompressobj()
        body = unpacker.decompress(packed[start + length :], size + 1)
    except (*_MALFORMED, zlib.error) as error:
        raise ValueError(f"sliders: expected what Anyface has packed: {error}") from error
    if len(body) != size or not unpacker.eof:
        raise ValueError(f"sliders: expected {size} bytes, got more or fewer")
    scale = np.frombuffer(body, "<f4", count * columns).reshape(count, 1, columns)
    halves = np.frombuffer(body, np.uint8, offset=scale.nbytes).reshape(2, -1)
    steps = np.ascontiguousarray(halves.T).view("<i2").reshape(count, columns, frames)
    changes = np.cumsum(steps, axis=2, dtype=np.int16).swapaxes(1, 2) * (scale / _STEPS)
    parts = np.split(changes.astype(np.float32), ends)
    pairs = zip(knots.items(), parts, strict=True)
    return {name: SliderChange(np.array(places), part) for (name, places), part in pairs}
