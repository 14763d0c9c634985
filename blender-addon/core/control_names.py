"""The names that artists' tools give to the bones of a face.

A list for each tool lies in `control_names/*.json`: names, in which `*` stands for anything.
"""

from dataclasses import asdict, dataclass
from fnmatch import fnmatchcase
from functools import lru_cache
from pathlib import Path

from . import json_file
from .errors import AnyfaceError

_FOLDER = Path(__file__).resolve().parent.parent / "control_names"
# A list that names fewer bones than this fits by coincidence.
_FEWEST = 8


@dataclass
class Row:
    """A row of an artist's list: a bone of a data-block, or a number in it by its data path."""

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
    """Reads an artist's list from a file; raises `AnyfaceError` if the file holds none."""
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
    """The `bones` whose names are in a list."""
    names = presets()[preset]
    return [bone for bone in bones if any(fnmatchcase(bone, name) for name in names)]


def guess(bones: list[str]) -> tuple[str, list[str]]:
    """The list that names the most `bones`, and those bones; ("", []) if no list fits."""
    bones_by_preset = {preset: fitting(preset, bones) for preset in presets()}
    best = max(bones_by_preset, key=lambda preset: len(bones_by_preset[preset]))
    return (best, bones_by_preset[best]) if len(bones_by_preset[best]) >= _FEWEST else ("", [])
