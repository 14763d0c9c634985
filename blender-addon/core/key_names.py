"""The names of shape keys in the tools that artists use, and the shape that each of them shows.

A list for each tool lies in `key_names/*.json`. It maps each of our shapes to the names that stand
for it, the best one first. A name stands alone or with the key's `factor` (see `Pair`). "a + b" are
keys that move together.
"""

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

from . import json_file, shapes
from .errors import AnyfaceError

_FOLDER = Path(__file__).resolve().parent.parent / "key_names"
# A list that names fewer keys than this fits by coincidence, unless it says otherwise.
_FEWEST = 3
# Names shorter than this match only a whole key name, not the end of a longer one.
_SHORT = 4
ARKIT, OCULUS = "ARKit", "Oculus"


@dataclass
class Pair:
    """A shape and a key that shows it: at weight 1 of the shape the key stands at `factor`.

    A key may show several shapes, whose shares add up, and a shape may move several keys.
    """

    shape: str
    key: str
    factor: float = 1.0


def presets() -> list[str]:
    """The names of all lists, ARKit and Oculus first."""
    return [ARKIT, OCULUS, *_lists()]


def pairs(preset: str, keys: list[str]) -> list[Pair]:
    """The pairs of a list for the `keys` that a mesh has."""
    if preset in (ARKIT, OCULUS):
        kind = shapes.ARKIT if preset == ARKIT else shapes.VISEMES
        return [Pair(n, key) for n, key in shapes.match(keys).items() if n in kind]
    known = _spellings(keys)
    matches = []
    for shape, names in _lists()[preset].items():
        fitting = ([Pair(shape, known[_plain(n)], factor) for n in every if _plain(n) in known]
                   for every, factor in names)  # fmt: skip
        matches += next((some for some in fitting if some), [])
    return matches


def guess(keys: list[str]) -> tuple[str, list[Pair]]:
    """The list that names the most `keys`, and its pairs; ("", []) if no list fits."""
    best: tuple[str, list[Pair]] = "", []
    for preset in presets():
        matches = pairs(preset, keys)
        fewest = 1 if preset in (ARKIT, OCULUS) else _documents()[preset].get("fewest", _FEWEST)
        count = len({pair.key for pair in matches})
        if count >= fewest and count > len({pair.key for pair in best[1]}):
            best = preset, matches
    return best


def write(pairs: list[Pair], path) -> None:
    """Writes a list of keys; raises `AnyfaceError("file")`."""
    rows = [[pair.shape, pair.key, pair.factor] for pair in pairs]
    json_file.write(path, {"version": 2, "keys": rows})


def read(path) -> list[Pair]:
    """Reads files of `write`, old ones too; raises `AnyfaceError`, "file" or "input"."""
    document = json_file.read(path)
    try:
        rows = document["keys"]
        rows = [(*row, 1.0) for row in rows.items()] if isinstance(rows, dict) else rows
        pairs_read = [Pair(str(shape), str(key), float(factor)) for shape, key, factor in rows]
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise AnyfaceError("input", f"not a mapping file: {error}") from None
    every = {*shapes.ARKIT, *shapes.VISEMES}
    unknown = [pair.shape for pair in pairs_read if pair.shape not in every]
    if unknown:
        raise AnyfaceError(
            "input", f"mapping: expected ARKit shapes or visemes, got {', '.join(unknown[:3])}"
        )
    return pairs_read


@lru_cache(maxsize=1)
def _lists() -> dict[str, dict[str, list[tuple[list[str], float]]]]:
    return {
        label: {
            shape: [_alternative(*([name] if isinstance(name, str) else name)) for name in names]
            for shape, names in document["keys"].items()
        }
        for label, document in _documents().items()
    }


@lru_cache(maxsize=1)
def _documents() -> dict[str, dict]:
    """The files of the lists by their labels."""
    documents = [json_file.read(path) for path in sorted(_FOLDER.glob("*.json"))]
    return {document["label"]: document for document in documents}


def _alternative(name: str, factor: float = 1.0) -> tuple[list[str], float]:
    """The keys that a name of a list stands for: "a + b" are two that move together."""
    return name.split(" + "), factor


def _spellings(keys: list[str]) -> dict[str, str]:
    """Keys by the texts that stand for them: the whole name, or its end after a separator."""
    keys_by_spelling = {_plain(key): key for key in reversed(keys)}
    for key in keys:
        for text in shapes.suffixes(key)[1:]:
            if len(text) >= _SHORT:
                keys_by_spelling.setdefault(text, key)
    return keys_by_spelling


def _plain(name: str) -> str:
    """A name without case and separators."""
    return "".join(letter for letter in name.lower() if letter.isalnum())
