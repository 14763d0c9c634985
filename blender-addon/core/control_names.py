"""Which bones of a face artists' tools call by which names.

A list for each tool lies in `control_names/*.json`: names, in which `*` stands for anything.
"""

from dataclasses import asdict, dataclass
from fnmatch import fnmatchcase
from functools import lru_cache
from pathlib import Path

from . import json_file
from .errors import AnyfaceError

_FOLDER = Path(__file__).resolve().parent.parent / "control_names"
# Fewer bones than these of a list are a coincidence.
_FEWEST = 8


@dataclass
class Row:
    """A row of an artist's list: a bone, or a number by its data path, of a data-block."""

    kind: str
    id_type: str
    block: str
    path: str
    sided: bool = False
    use: bool = True


def write(rows: list[Row], path: Path) -> None:
    """Writes an artist's list; raises `AnyfaceError("file")`."""
    json_file.write(path, {"controls": [asdict(row) for row in rows]})


def read(path: Path) -> list[Row]:
    """The list of a file; raises `AnyfaceError` where it is none."""
    document = json_file.read(path)
    try:
        rows = [Row(**row) for row in document["controls"]]
    except (TypeError, KeyError) as error:
        raise AnyfaceError("input", f"{path}: not a list of controls: {error}") from None
    for number, row in enumerate(rows):
        texts = (row.kind, row.id_type, row.block, row.path)
        if not all(isinstance(text, str) and text for text in texts):
            expected = "expected kind, id_type, block and path"
            raise AnyfaceError("input", f"{path}: row {number + 1}: {expected}, got {texts}")
    return rows


@lru_cache(maxsize=1)
def presets() -> dict[str, list[str]]:
    """The names of each list, by its label."""
    presets_by_name = {}
    for path in sorted(_FOLDER.glob("*.json")):
        document = json_file.read(path)
        presets_by_name[document["label"]] = document["bones"]
    return presets_by_name


def fitting(preset: str, bones: list[str]) -> list[str]:
    """Those of `bones` that a list names."""
    names = presets()[preset]
    return [bone for bone in bones if any(fnmatchcase(bone, name) for name in names)]


def guess(bones: list[str]) -> tuple[str, list[str]]:
    """The list that names most of `bones`, and these; ("", []) where none fits."""
    bones_by_preset = {preset: fitting(preset, bones) for preset in presets()}
    best = max(bones_by_preset, key=lambda preset: len(bones_by_preset[preset]))
    return (best, bones_by_preset[best]) if len(bones_by_preset[best]) >= _FEWEST else ("", [])
