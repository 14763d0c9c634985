"""Tells a take that an artist has corrected by hand from one that is as it was made."""

import hashlib

from .. import outputs
from ..animation import curves
from ..shape_keys import record
from . import together


def settle(ob) -> None:
    """Remembers the curves of the take of `ob` as they are now, as made by Anyface."""
    shape_keys = ob.data.shape_keys if record.is_generated(ob) else None
    take_record = record.read(shape_keys)
    if take_record is not None:
        take_record.curves_print = _print(shape_keys, take_record)
        record.write(shape_keys, take_record)


def settle_all(ob) -> None:
    """Does what `settle` does for `ob` and the objects beside it."""
    for part in (ob, *together.others_of(ob)):
        settle(part)


def is_corrected(ob) -> bool:
    """Whether someone has changed the curves of the take of `ob` since `settle`."""
    shape_keys = ob.data.shape_keys if record.is_generated(ob) else None
    take_record = record.read(shape_keys)
    if take_record is None or not take_record.curves_print:
        return False
    return take_record.curves_print != _print(shape_keys, take_record)


def can_wait(ob) -> bool:
    """Whether a take of `ob` was corrected, in its keys or those of objects beside it, and can wait
    beside another one."""
    output = outputs.of_object(ob)
    corrected = (is_corrected(part) for part in (ob, *together.others_of(ob)))
    return output is not None and not output.cannot_wait and any(corrected)


def _print(shape_keys, take_record: record.Record) -> str:
    digest = hashlib.blake2b(digest_size=12)
    for name in (*take_record.keys, *take_record.values):
        curve = curves.find(shape_keys.animation_data, curves.value_path(name))
        if curve is not None:
            digest.update(name.encode() + curves.places(curve).tobytes())
    return digest.hexdigest()
