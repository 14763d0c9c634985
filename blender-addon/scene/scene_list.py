"""Animates a whole scene in one go: several characters, each with its own sound strip."""

from dataclasses import dataclass

from ..core.errors import AnyfaceError, Cancelled, plain
from ..core.job import Progress
from . import bake, identity
from .way_back import WayBack, unharmed


@dataclass
class Part:
    """One character of the scene; `error` says why it was left out."""

    object_name: str
    number: int
    snapshot: bake.Snapshot | None = None
    error: AnyfaceError | None = None


@dataclass
class SceneSnapshot:
    """Everything that `work` needs for a scene."""

    parts: list[Part]

    def work(self, progress: Progress) -> list:
        """A take or an `AnyfaceError` for each part; raises `Cancelled`."""
        return [_work(part, progress) for part in self.parts]


def read(scene, rows) -> SceneSnapshot:
    """Reads every character; each of `rows` holds an object, its `bake.Settings` and an engine.

    If a character cannot be read, its part stores the error. The others are still animated.
    """
    parts = []
    for ob, settings, engine in rows:
        part = Part(ob.name, identity.number(ob))
        try:
            part.snapshot = bake.read(ob, scene, settings, engine)
        except BaseException as error:
            part.error = plain(error)
        parts.append(part)
    return SceneSnapshot(parts)


def write(snapshot: SceneSnapshot, takes: list) -> list[tuple[str, bool, str]]:
    """Writes the takes that can be written.

    Returns name, success, and a message for each part.
    """
    return [_write(part, take) for part, take in zip(snapshot.parts, takes, strict=True)]


def in_one_line(outcomes: list[tuple[str, bool, str]]) -> str:
    """ "2 of 3 animated; Bob: no sound strip …"."""
    done = sum(ok for _, ok, _ in outcomes)
    failed = [f"{name}: {text}" for name, ok, text in outcomes if not ok]
    return "; ".join([f"{done} of {len(outcomes)} animated", *failed])


def _work(part: Part, progress: Progress):
    if part.error is not None:
        return part.error
    try:
        return part.snapshot.work(progress)
    except Cancelled:
        raise
    except BaseException as error:
        return plain(error)


def _write(part: Part, take) -> tuple[str, bool, str]:
    way_back, ok = None, False
    try:
        if isinstance(take, AnyfaceError):
            raise take
        ob = identity.with_number(part.number, part.object_name)
        if ob is None:
            raise AnyfaceError("mesh", f"{part.object_name} is gone")
        way_back = WayBack(ob, part.object_name)
        text, ok = bake.write(ob, part.snapshot, take), True
        way_back.close()
    except BaseException as raised:
        error = plain(raised)
        with unharmed():
            if not ok:
                bake.discard(take)
        with unharmed():
            if way_back is not None and not ok:
                error = way_back.go(error, isinstance(raised, AnyfaceError))
        text = str(error)
    with unharmed():
        if ok:
            bake.settle(take)
    with unharmed():
        # An undo may have replaced the objects, so look this one up again.
        ob = identity.with_number(part.number, part.object_name)
        if ob is not None and ob.library is None:
            ob.anyface.report, ob.anyface.report_is_error = text, not ok
    return part.object_name, ok, text
