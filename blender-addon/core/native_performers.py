"""Library calls about performers: one person's own mouth, learned from that person's face."""

import json
import os
from collections.abc import Sequence
from contextlib import ExitStack

from .arrays import bytes_of, path_of
from .calls import Calls
from .job import Progress

FilePath = str | os.PathLike[str]


class PerformerCalls(Calls):
    """The calls of `native.Engine` for performers."""

    def learn_performer(
        self, takes: Sequence[tuple[FilePath, FilePath]], path: str, progress: Progress
    ) -> dict:
        """Writes a performer, learned from pairs of sound and motion files; returns its card.

        Raises `AnyfaceError`, or `Cancelled`.
        """
        files = [[os.fsdecode(path_of(name)) for name in take] for take in takes]
        text = bytes_of("takes", json.dumps(files))
        with ExitStack() as handles:
            watch = handles.enter_context(self._watch(progress))
            arguments = (self._handle, text, watch.handle, path_of(path))
            self._call("anyface_performer_learn", *arguments)
        return card_of(path)


def card_of(path: str) -> dict:
    """The card of a performer's file, a safetensors file with JSON among its metadata."""
    with open(path, "rb") as file:
        header = json.loads(file.read(int.from_bytes(file.read(8), "little")))
    return json.loads(header["__metadata__"]["card"])
