"""Undoes a result that failed half-way, with Blender's own undo.

Writing changes meshes, keys, actions and rigs. Whatever stops it half-way, undo restores the whole
scene as it was before.
"""

import contextlib
import sys
import traceback
import uuid

import bpy

from ..core.errors import AnyfaceError
from . import identity
from .shape_keys import guard, record

# The scene has this property while a result is written. The undo step before lacks it.
_MARK = "anyface_writing_"
# The most undo steps that Blender keeps.
_MAX_STEPS = 256
NO_UNDO = (
    "Global Undo is off in the preferences, so what was written until then stays: press Remove"
)


class WayBack:
    """Marks the scene before a result is written, so that it can be undone.

    `ob` is the object that gets the result, or None for several objects. `close` or `go` ends it.
    """

    def __init__(self, ob, label: str):
        self._name, self._number = (ob.name, identity.number(ob)) if ob is not None else ("", 0)
        self._open, self._mark = False, _MARK + uuid.uuid4().hex[:12]
        self._was = _looks()
        if not bpy.context.preferences.edit.use_global_undo or not _can_mark():
            return
        with _object_mode(ob):
            bpy.ops.ed.undo_push(message=f"Before {label}")
        bpy.context.scene[self._mark] = True
        self._open = True

    def close(self) -> None:
        """Removes the mark, once the whole result has been written or none of it."""
        if self._open:
            self._rub_out()
        self._open = False

    def go(self, error: AnyfaceError, said: bool = False) -> AnyfaceError:
        """Undoes everything; returns the error, with a hint for the artist if that fails.

        If the error was `said` by a check and nothing has changed, no undo is needed. After an
        undo, objects that the caller holds are invalid.
        """
        if said and _looks() == self._was:
            self.close()
            return error
        ob = identity.with_number(self._number, self._name) if self._name else None
        if not self._open:
            return _more(error, NO_UNDO)
        self._open = False
        with _object_mode(ob):
            bpy.ops.ed.undo_push(message="Failed")
        modes = _modes()
        _leave_modes()
        for _ in range(_MAX_STEPS):
            if self._mark not in bpy.context.scene or bpy.ops.ed.undo() != {"FINISHED"}:
                break
        _enter_modes(modes)
        if self._rub_out():
            return _more(error, "undo it to go back")
        return error

    def _rub_out(self) -> bool:
        """Removes the mark; False if there is none."""
        marked = self._mark in bpy.context.scene
        if marked:
            del bpy.context.scene[self._mark]
        return marked


def _more(error: AnyfaceError, text: str) -> AnyfaceError:
    longer = AnyfaceError(error.kind, f"{error} ({text})", error.mends)
    longer.__cause__ = error.__cause__
    return longer


def _can_mark() -> bool:
    scene = bpy.context.scene
    return scene is not None and scene.library is None


def _looks() -> tuple:
    """A fingerprint of the scene, which any writing changes with its first step."""
    kinds = ("objects", "meshes", "shape_keys", "actions", "materials", "texts")
    counts = [len(getattr(bpy.data, kind)) for kind in kinds]
    return counts, [_look_of(ob) for ob in bpy.data.objects if ob.type == "MESH" and ob.data]


def _look_of(ob) -> tuple:
    keys = ob.data.shape_keys
    keys_state = (len(keys.key_blocks), keys.get(record.PROPERTY)) if keys is not None else None
    caches = [(m.name, getattr(m, "filepath", "")) for m in ob.modifiers]
    return ob.name, ob.data.name, len(ob.data.vertices), keys_state, caches, sorted(ob.keys())


@contextlib.contextmanager
def _object_mode(ob):
    """Leaves edit mode, since an undo step holds the whole scene only in object mode."""
    with contextlib.ExitStack() as stack:
        for one in {bpy.context.view_layer.objects.active, ob} - {None}:
            stack.enter_context(guard.object_mode(one))
        yield


def _modes() -> list[tuple[int, str, str]]:
    objects = {bpy.context.view_layer.objects.active} - {None}
    return [(identity.number(ob), ob.name, ob.mode) for ob in objects if ob.mode != "OBJECT"]


def _leave_modes() -> None:
    for number, name, _ in _modes():
        _set_mode(identity.with_number(number, name), "OBJECT")


def _enter_modes(modes: list[tuple[int, str, str]]) -> None:
    for number, name, mode in modes:
        _set_mode(identity.with_number(number, name), mode)


def _set_mode(ob, mode: str) -> None:
    if ob is not None and ob.mode != mode:
        with bpy.context.temp_override(active_object=ob, object=ob):
            bpy.ops.object.mode_set(mode=mode)


@contextlib.contextmanager
def unharmed():
    """Prints errors on the console and goes on, so that the next clean-up step runs too."""
    try:
        yield
    except BaseException:
        with contextlib.suppress(Exception):
            traceback.print_exc()
            sys.stderr.flush()
