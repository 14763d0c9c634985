"""What was generated on a mesh, written down beside it, so that Remove removes exactly that.

The record lies in a custom property of the shape keys' data-block and goes when they go.
"""

import json
import uuid
from dataclasses import asdict, dataclass, field, fields

PROPERTY = "anyface"


@dataclass
class Record:
    """One generated take.

    `keys` are the names of our shape keys in order; `made_keys` says that the mesh had none
    before. The `made_*` and `shared_*` fields say what else must be undone: an action, a slot or
    animation data of ours, copies made because mesh or action were shared (`*_print` is their
    digest at that time). On an object beside a face, `belongs_to` is the id of the face's take.
    """

    mode: str
    id: str = field(default_factory=lambda: uuid.uuid4().hex[:12])
    keys: list[str] = field(default_factory=list)
    made_keys: bool = False
    made_animation_data: bool = False
    made_action: bool = False
    made_slot: bool = False
    shared_action: str = ""
    shared_action_print: str = ""
    shared_mesh: str = ""
    shared_mesh_print: str = ""
    belongs_to: str = ""


def read(shape_keys) -> Record | None:
    """The record of a mesh's shape keys (None for none), or None."""
    text = shape_keys.get(PROPERTY) if shape_keys is not None else None
    if not isinstance(text, str):
        return None
    try:
        values = json.loads(text)
        known = {item.name for item in fields(Record)}
        return Record(**{name: value for name, value in values.items() if name in known})
    except (ValueError, TypeError, AttributeError):
        return None


def write(shape_keys, record: Record) -> None:
    """Stores the record."""
    shape_keys[PROPERTY] = json.dumps(asdict(record))


def clear(shape_keys) -> None:
    """Takes the record away."""
    if PROPERTY in shape_keys:
        del shape_keys[PROPERTY]


def is_generated(ob) -> bool:
    """True where `ob` (or None) carries a generated take."""
    if ob is None or ob.type != "MESH" or ob.data is None:
        return False
    return read(ob.data.shape_keys) is not None
