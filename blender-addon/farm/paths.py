"""Translates paths of the jobs file into paths of this machine: `--map FROM=TO`."""

import os
import re
from collections.abc import Iterable

from ..core.errors import AnyfaceError

# The separators between the parts of a path: on other systems, and on Windows.
_SEPARATORS = (r"/", r"[\\/]")
_WINDOWS = re.compile(r"[A-Za-z]:($|[\\/])|\\\\")


class PathMap:
    """Pairs of folders: one folder under its names on two machines.

    If one name is a Windows path and the other is not, a path under either name is opened under
    this system's own. If both names are of one kind, the second one is opened.
    """

    def __init__(self, words: Iterable[str] = (), on_windows: bool = os.name == "nt"):
        """Reads `FROM=TO` words; raises `AnyfaceError("input")`."""
        self._pairs = []
        for word in words:
            first, equals, second = word.partition("=")
            if not (first and equals and second):
                text = f"--map: expected FROM=TO, such as /mnt/show=Z:\\show, got {word!r}"
                raise AnyfaceError("input", text)
            pair = (first, second)
            if _is_windows(first) != _is_windows(second) and _is_windows(first) == on_windows:
                pair = (second, first)
            self._pairs.append(pair)

    def here(self, path: str) -> str:
        """`path` under its name on this machine."""
        for source, target in self._pairs:
            rest = _below(path, source)
            if rest is not None:
                parts = [part for part in re.split(_SEPARATORS[_is_windows(source)], rest) if part]
                mark = "\\" if _is_windows(target) else "/"
                return mark.join([target.rstrip("\\/"), *parts]) if parts else target
        return path


def _is_windows(path: str) -> bool:
    return _WINDOWS.match(path) is not None


def _below(path: str, folder: str) -> str | None:
    """The part of `path` after `folder`; None if `path` is not in that folder."""
    start, mark = folder.rstrip("\\/"), _SEPARATORS[_is_windows(folder)]
    first, rest = path[: len(start)], path[len(start) :]
    if _is_windows(folder):
        # Windows ignores case and accepts both slashes.
        start, first = (text.lower().replace("/", "\\") for text in (start, first))
    ends = not rest or re.match(mark, rest)
    return rest if first == start and ends else None
