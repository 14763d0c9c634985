"""Moves a face in the viewport by its sound or a microphone, before anything is generated.

Each object of the face gets one shape key for this. The key is removed when the face stops
following: when the artist ends it, after an undo, or when a file is saved, opened or rendered.
"""

from dataclasses import dataclass

import bpy
import numpy as np
from bpy.app.handlers import persistent

from ..core import space
from ..core.emotion import mix
from ..core.errors import AnyfaceError, plain
from ..core.take import Piece
from . import identity
from .animation import emotion
from .face import mesh, pieces
from .shape_keys import guard
from .way_back import unharmed

KEY = "Anyface Live"
# Time between two updates of faces that follow a microphone, seconds.
_EVERY_S = 1.0 / 60.0


@dataclass
class Follower:
    """A character that moves live: its objects by number, and the `face` that moves them."""

    number: int
    name: str
    # Number and name of each object, its place in the whole face, and its rest positions.
    parts: list[tuple[int, str, Piece, np.ndarray]]
    face: object
    face_space: space.FaceSpace
    start_frame: float
    # Strengths `[15]` of the emotion that the panel sets; None where the emotion is heard.
    strengths: np.ndarray | None = None
    # The last displacements. `face.at` returns the same array again if it has heard nothing new.
    shown: np.ndarray | None = None


_followers: list[Follower] = []


def is_on(ob) -> bool:
    """Whether `ob` follows its sound."""
    return bool(_of(ob))


def _of(ob) -> list[Follower]:
    return [f for f in _followers if identity.with_number(f.number, f.name) == ob]


def listens(ob) -> bool:
    """Whether `ob` follows a microphone."""
    return listener(ob) is not None


def listener(ob):
    """The `ListeningFace` that moves `ob`, or None."""
    return next((f.face for f in _of(ob) if f.face.listens), None)


def begin(ob, mesh_face, face, start_frame: float = 0.0) -> None:
    """Makes `ob` follow `face`, which is a `LiveFace` or a `ListeningFace`.

    `mesh_face` was read from `ob`. Raises `AnyfaceError` where an object cannot have a key; nothing
    has changed then.
    """
    face_piece, *others = mesh_face.pieces
    objects = [(ob, face_piece)]
    objects += [(pieces.object_of(pieces.Part(piece.name), ob), piece) for piece in others]
    for one, piece in objects:
        guard.check_editable(one)
        guard.check_size(one, piece.count)
    end(ob)
    parts, way = [], mesh_face.space
    try:
        for one, piece in objects:
            rested = mesh.read_basis(one.data)
            with guard.object_mode(one), guard.selection_kept(one):
                _add_key(one, rested)
            parts.append((identity.number(one), one.name, piece, rested))
        _followers.append(Follower(identity.number(ob), ob.name, parts, face, way, start_frame))
    except BaseException:
        _sweep()
        raise
    show(bpy.context.scene)
    if face.listens and not bpy.app.timers.is_registered(listen):
        bpy.app.timers.register(listen)


def _add_key(ob, rested: np.ndarray) -> None:
    if ob.data.shape_keys is None:
        ob.shape_key_add(name="Basis", from_mix=False)
        ob.data.shape_keys.use_relative = True
    block = mesh.add_key(ob, KEY, rested)
    block.value = 1.0


def end(ob) -> bool:
    """Makes `ob` stop following, and restores it and its parts; False where it did not follow."""
    followers = _of(ob)
    for follower in followers:
        _forget(follower)
    _sweep()
    return bool(followers)


def end_all(*_) -> None:
    """Stops every character that follows."""
    for follower in list(_followers):
        _forget(follower)
    _sweep()


def _forget(follower: Follower) -> None:
    _followers.remove(follower)
    with unharmed():
        follower.face.close()


def _sweep() -> None:
    """Removes the live key from every object that follows nothing.

    A face that has stopped, its copies, an undo or a crash may have left the key behind.
    """
    following = [identity.with_number(part[0], part[1]) for f in _followers for part in f.parts]
    meshes = [ob.data for ob in following if ob is not None]
    for ob in bpy.data.objects:
        is_own = ob.type == "MESH" and ob.library is None and ob.data.library is None
        if is_own and ob.data not in meshes:
            _drop_key(ob)


def _drop_key(ob) -> None:
    shape_keys = ob.data.shape_keys
    block = shape_keys.key_blocks.get(KEY) if shape_keys is not None else None
    if block is None:
        return
    with guard.object_mode(ob), guard.selection_kept(ob):
        ob.shape_key_remove(block)
        blocks = ob.data.shape_keys.key_blocks
        # If only the Basis is left, it was added for our key or has no effect: remove it too.
        if len(blocks) == 1 and ob.data.shape_keys.animation_data is None:
            ob.shape_key_clear()


def feel(_group=None, _context=None) -> None:
    """Shows a new emotion from the panel at once, even while nothing plays."""
    with unharmed():
        if any(map(_shows_another, _followers)):
            show(bpy.context.scene)


def listen() -> float | None:
    """Moves the faces that follow a microphone. A timer of Blender calls it every `_EVERY_S`."""
    heard = [follower for follower in _followers if follower.face.listens]
    if not heard:
        return None
    show(bpy.context.scene, heard)
    return _EVERY_S


def show(scene, followers: list[Follower] | None = None) -> None:
    """Moves `followers` (None for all of them) to their pose at the current frame."""
    for follower in list(_followers if followers is None else followers):
        ob = None
        try:
            ob = identity.with_number(follower.number, follower.name)
            if ob is None:
                raise AnyfaceError("mesh", f"{follower.name} is gone")
            _show(ob, scene, follower)
        except BaseException as error:
            # Blender calls this at every frame, so the error would come up again each time: stop
            # all faces.
            _say(ob, str(plain(error)))
            end_all()
            return


def _show(ob, scene, follower: Follower) -> None:
    scene_fps = scene.render.fps / scene.render.fps_base
    seconds = (scene.frame_current_final - follower.start_frame) / scene_fps
    follower.strengths = _feels(ob)
    if follower.strengths is not None:
        follower.face.feel(follower.strengths)
    displacements = follower.face.at(seconds)
    if displacements is follower.shown:
        return
    follower.shown = displacements
    moved = follower.face_space.to_object(displacements)
    for number, name, piece, rested in follower.parts:
        one = identity.with_number(number, name)
        if one is None or one.mode == "EDIT":
            continue
        guard.check_size(one, len(rested))
        block = one.data.shape_keys.key_blocks.get(KEY) if one.data.shape_keys else None
        if block is None:
            raise AnyfaceError("mesh", f"{name}: its key {KEY!r} is gone")
        at = rested + piece.vectors(moved[None])[0]
        block.points.foreach_set("co", np.ascontiguousarray(at, dtype=np.float32).ravel())
        one.data.shape_keys.update_tag()
        one.data.update_tag()


def _feels(ob) -> np.ndarray | None:
    settings = ob.anyface
    return mix(emotion.shares(settings)) if settings.emotion_source == "GIVEN" else None


def _shows_another(follower: Follower) -> bool:
    """Whether the emotion in the panel differs from the one on display."""
    ob = identity.with_number(follower.number, follower.name)
    return ob is not None and not np.array_equal(_feels(ob), follower.strengths)


def _say(ob, text: str) -> None:
    if ob is not None and ob.library is None:
        ob.anyface.report, ob.anyface.report_is_error = f"live: {text}", True


@persistent
def _on_frame(scene, *_) -> None:
    show(scene)


@persistent
def _on_end(*_) -> None:
    end_all()


_ENDINGS = ("load_pre", "load_post", "save_pre", "undo_post", "redo_post", "render_init")


def register() -> None:
    """Adds handlers that move faces at each frame and stop them before a file stores the key."""
    bpy.app.handlers.frame_change_post.append(_on_frame)
    for name in _ENDINGS:
        getattr(bpy.app.handlers, name).append(_on_end)


def unregister() -> None:
    """Stops all faces and removes the handlers."""
    end_all()
    bpy.app.handlers.frame_change_post.remove(_on_frame)
    if bpy.app.timers.is_registered(listen):
        bpy.app.timers.unregister(listen)
    for name in _ENDINGS:
        getattr(bpy.app.handlers, name).remove(_on_end)
