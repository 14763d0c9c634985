"""Which bones of a face artists' tools call by which names.

A list for each tool lies in `control_names/*.json`: names, in which `*` stands for anything.
"""

import json
from fnmatch import fnmatchcase
from functools import lru_cache
from pathlib import Path

_FOLDER = Path(__file__).resolve().parent.parent / "control_names"
# Fewer bones than these of a list are a coincidence.
_FEWEST = 8


@lru_cache(maxsize=1)
def presets() -> dict[str, list[str]]:
    """The names of each list, by its label."""
    found = {}
    for path in sorted(_FOLDER.glob("*.json")):
        document = json.loads(path.read_text(encoding="utf-8"))
        found[document["label"]] = document["bones"]
    return found


def fitting(preset: str, bones: list[str]) -> list[str]:
    """Those of `bones` that a list names."""
    names = presets()[preset]
    return [bone for bone in bones if any(fnmatchcase(bone, name) for name in names)]


def guess(bones: list[str]) -> tuple[str, list[str]]:
    """The list that names most of `bones`, and these; ("", []) where none fits."""
    found = {preset: fitting(preset, bones) for preset in presets()}
    best = max(found, key=lambda preset: len(found[preset]))
    return (best, found[best]) if len(found[best]) >= _FEWEST else ("", [])
