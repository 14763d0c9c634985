"""The record of what a take has added to its mesh, so that Remove removes exactly that.

It is stored in a custom property of the shape keys' data-block and disappears with them.
"""

import json
import uuid
from dataclasses import asdict, dataclass, field

from ...core import json_file

PROPERTY = "anyface"
# Takes that wait beside the current one, as a list of records.
KEPT = "anyface_takes"
# Pointers to the artist's data while something of ours stands in for it.
SHARED_MESH, SHARED_ACTION = "anyface_shared_mesh", "anyface_shared_action"
REPLACED_ACTION = "anyface_replaced"
ORIGINALS = (SHARED_MESH, SHARED_ACTION, REPLACED_ACTION)


@dataclass
class Record:
    """One generated take.

    `mode` is the name of its output, and `keys` are the names of our shape keys in order.
    `made_keys` says that the mesh had no keys before. The other `made_*` fields say that we added
    animation data, an action or a slot, which must be removed again. The `shared_*` fields are set
    where a mesh or an action was shared, so that we made a copy; they are the digests of the copies
    at that time.

    On an object beside a face, `belongs_to` is the id of the face's take. `values` holds the
    earlier values of the artist's keys that are animated. `replaced_print` is the digest of the
    action that stands in for the artist's. `name` is the name of the take in the panel. `adjusted`
    holds the changes made by `adjust`.

    The first frame lies at scene frame `first_frame`, and the others follow every `frame_step`.
    `still` is `why_missing` of its basis. `asked` holds the panel's settings and its report.
    `shown` gives, for each of the artist's keys, the shape that it shows most. `factors` gives, for
    each key, its value at weight 1 of each shape that it shows. `heard_emotion` is the emotion
    heard in the voice, as plain values of `core.heard_emotion`. `curves_print` is the digest of the
    curves as Anyface made them.
    """

    mode: str
    id: str = field(default_factory=lambda: uuid.uuid4().hex[:12])
    keys: list[str] = field(default_factory=list)
    made_keys: bool = False
    made_animation_data: bool = False
    made_action: bool = False
    made_slot: bool = False
    shared_action_print: str = ""
    shared_mesh_print: str = ""
    belongs_to: str = ""
    values: dict[str, float] = field(default_factory=dict)
    replaced_print: str = ""
    name: str = ""
    in_nla: bool = False
    adjusted: dict[str, float] = field(default_factory=dict)
    first_frame: float = 0.0
    frame_step: float = 1.0
    still: dict[str, str] = field(default_factory=dict)
    asked: dict = field(default_factory=dict)
    shown: dict[str, str] = field(default_factory=dict)
    factors: dict[str, dict[str, float]] = field(default_factory=dict)
    heard_emotion: dict = field(default_factory=dict)
    curves_print: str = ""
    # Prepared curves, and the values that become curves. Neither is stored in the record.
    prepared = None
    waiting = None


def read(shape_keys) -> Record | None:
    """The record of the current take, or None. `shape_keys` may be None."""
    text = shape_keys.get(PROPERTY) if shape_keys is not None else None
    return json_file.record(Record, text)


def write(shape_keys, record: Record) -> None:
    """Stores the record of the current take."""
    shape_keys[PROPERTY] = json.dumps(asdict(record))


def clear(shape_keys) -> None:
    """Removes the record of the current take."""
    if PROPERTY in shape_keys:
        del shape_keys[PROPERTY]


def read_kept(shape_keys) -> list[Record]:
    """The takes that wait beside the current one."""
    text = shape_keys.get(KEPT) if shape_keys is not None else None
    return json_file.records(Record, text)


def write_kept(shape_keys, records: list[Record]) -> None:
    """Stores the takes that wait."""
    if records:
        shape_keys[KEPT] = json.dumps([asdict(record) for record in records])
    elif KEPT in shape_keys:
        del shape_keys[KEPT]


def everyone(shape_keys) -> list[Record]:
    """The current take and all takes that wait."""
    current = read(shape_keys)
    return ([current] if current is not None else []) + read_kept(shape_keys)


def all_keys(shape_keys) -> set[str]:
    """The names of all our keys."""
    return {name for record in everyone(shape_keys) for name in record.keys}


def is_generated(ob) -> bool:
    """True where `ob` (or None) carries a generated take in its shape keys."""
    if ob is None or ob.type != "MESH" or ob.data is None:
        return False
    return read(ob.data.shape_keys) is not None
