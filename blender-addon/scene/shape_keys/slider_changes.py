"""Stores what the sliders of a take change, as a packed custom property of the shape keys."""

from ...core import sliders
from . import record

_PROPERTY = "anyface_sliders_"
# The bytes read last and their content. During a drag they are read many times a second.
_last: tuple[bytes, dict[str, sliders.SliderChange]] = (b"", {})


def write(shape_keys, take_record: record.Record, packed: bytes) -> None:
    """Stores the packed sliders of a take; does nothing if it has none."""
    if packed:
        shape_keys[_PROPERTY + take_record.id] = packed


def read(shape_keys, take_record: record.Record) -> dict[str, sliders.SliderChange]:
    """The sliders of a take by name; empty if nothing valid is stored."""
    global _last
    packed = shape_keys.get(_PROPERTY + take_record.id)
    if not isinstance(packed, bytes):
        return {}
    if packed != _last[0]:
        try:
            _last = packed, sliders.unpack(packed)
        except ValueError:
            return {}
    return _last[1]


def clear(shape_keys, take_record: record.Record) -> None:
    """Removes the sliders of a take."""
    if _PROPERTY + take_record.id in shape_keys:
        del shape_keys[_PROPERTY + take_record.id]
