"""Head and eyes of a take: the objects or bones that it turns. The skin does not move with them."""

import bpy
import numpy as np

from ...core import turn
from ...core.errors import AnyfaceError
from ...core.job import BEGUN, at_once
from ...core.take import Life, Take
from ..animation import curves
from ..face import mesh, pieces
from . import turning, turns

# The largest yaw and pitch of an eye, radians.
_MOST = np.radians([45.0, 35.0])
# Where the library has the eyes, right one first, canonical metres.
_EYES = np.array([[-0.032, 0.046, 0.071], [0.032, 0.046, 0.071]])
# How many scene frames to visit before the interface may react.
_FEW = 4
# An object whose centre is closer than this to the middle of the face contains both eyes, canonical
# metres.
_BOTH_M = 0.01


def check(ob, settings) -> None:
    """Raises `AnyfaceError` with a message if head or eyes have no object to turn."""
    life_settings = settings.life
    if not life_settings.use:
        return
    if life_settings.head in ("OBJECT", "BONE"):
        _object(life_settings.head_object, "the head turns")
    if life_settings.head == "BONE":
        _bone(life_settings.head_object, life_settings.head_bone)
    if life_settings.gaze == "BONES":
        for name in life_settings.eye_bones:
            _bone(life_settings.eye_armature, name)
    if life_settings.look_at:
        _object(life_settings.look_at, "the eyes look at")
    # An object that cannot be turned raises here, before the take is made.
    still = Life(np.zeros((1, 3)), np.zeros((1, 2, 2)), np.eye(3, 4))
    _turned(ob, still, settings, np.arange(3.0))


def look(take: Take, settings, start_frame: float, scene_fps: float):
    """Stores in `take` where the eyes look in each frame; yields between frames of the scene.

    At each yield the scene is back at the artist's frame.
    """
    life_settings = settings.life
    if (
        take.life is None
        or not life_settings.use
        or life_settings.gaze == "NONE"
        or not life_settings.look_at
    ):
        return
    frames = take.scene_frames(start_frame, scene_fps)
    take.life.looked_at = yield from _points(life_settings.look_at, take.life, frames)


def writing(ob, take: Take, settings, start_frame: float, scene_fps: float):
    """Turns the objects that `settings` name with `take`.

    First releases the objects of an earlier take. Yields between objects; returns notes for the
    report.
    """
    turns.release(ob)
    life_settings = settings.life
    if take.life is None or not life_settings.use:
        return []
    frames = take.scene_frames(start_frame, scene_fps)
    at = curves.with_rest(frames, scene_fps, take.earliest)
    turned = _turned(ob, take.life, settings, at)
    for other, channels in turned.items():
        turns.put(ob, other, channels, at)
        yield BEGUN
    notes = [f"{', '.join(other.name for other in turned)} turn"] if turned else []
    if life_settings.head == "OWN":
        notes.append(f"head in the action {_alone(ob, take.life, at).name}")
    return notes


def redo(ob, life: Life, settings, at: np.ndarray, splice) -> None:
    """Gives the curves of head and eyes new values at scene frames `at` `[n]`.

    Calls `splice(curve, at, values)` for each of them. Curves in an action that no object plays
    stay as they are.
    """
    if not settings.life.use:
        return
    padded = np.concatenate([at[:1], at, at[-1:]])
    for other, channels in _turned(ob, life, settings, padded).items():
        bag = curves.channels(other.animation_data)
        for channel in channels if bag is not None else ():
            for index, column in enumerate(channel.values.T):
                curve = bag.fcurves.find(channel.path, index=index)
                if curve is not None:
                    splice(curve, at, column[1:-1])


def _turned(ob, life: Life, settings, at) -> dict:
    """The channels of each object that turns, by object."""
    life_settings, by_object = settings.life, {}
    axes = _axes(life)
    if life_settings.head in ("OBJECT", "BONE"):
        vectors = curves.from_rest(life.head, at) @ axes.T
        other = _object(life_settings.head_object, "the head turns")
        one = life_settings.head == "BONE"
        channels = (
            [turning.of_bone(other, life_settings.head_bone, vectors, turns.paths_of(ob, other))]
            if one
            else turning.of_object(other, vectors, turns.paths_of(ob, other))
        )
        by_object.setdefault(other, []).extend(channels)
    for side in range(2) if life_settings.gaze != "NONE" else ():
        angles = life.gaze[:, side].astype(np.float64)
        if life_settings.look_at:
            if life.looked_at is None:
                lead = curves.rests_before(at, len(angles))
                life.looked_at = at_once(_points(life_settings.look_at, life, at[lead:-1]))
            angles = turn.to_object(angles, life.looked_at, _EYES[side])
        angles = np.clip(angles, -_MOST, _MOST)
        vectors = curves.from_rest(turn.of_gaze(angles), at) @ axes.T
        if life_settings.gaze == "BONES":
            armature = _object(life_settings.eye_armature, "the eyes turn")
            bone = turning.of_bone(
                armature, life_settings.eye_bones[side], vectors, turns.paths_of(ob, armature)
            )
            by_object.setdefault(armature, []).append(bone)
            continue
        for eye in _eyes(ob, life, settings)[side]:
            middle = mesh.corners(eye).mean(axis=0)
            channels = turning.of_object(eye, vectors, turns.paths_of(ob, eye), middle)
            by_object.setdefault(eye, []).extend(channels)
    return by_object


def _axes(life: Life) -> np.ndarray:
    """The canonical axes in the world, as columns `[3, 3]`."""
    linear = np.asarray(life.way, dtype=np.float64)[:, :3]
    return (linear / np.linalg.norm(linear, axis=1, keepdims=True)).T


def _canonical(life: Life, points: np.ndarray) -> np.ndarray:
    """World points `[N, 3]` in the canonical frame."""
    way = np.asarray(life.way, dtype=np.float64)
    return points @ way[:, :3].T + way[:, 3]


def _points(name: str, life: Life, at: np.ndarray):
    """Where an object is at scene frames `at` `[T]`: points `[T, 3]` in canonical space.

    Yields between frames.
    """
    other = _object(name, "the eyes look at")
    rests = other.animation_data is None and other.parent is None and not len(other.constraints)
    if rests:
        place = np.array(other.matrix_world.translation)
        return _canonical(life, np.broadcast_to(place, (len(at), 3)))
    places, scene = [], bpy.context.scene
    for few in np.array_split(at, max(1, len(at) // _FEW)):
        now = scene.frame_current_final
        for frame in few:
            _go(scene, frame)
            places.append(np.array(other.matrix_world.translation))
        _go(scene, now)
        yield
    return _canonical(life, np.array(places))


def _go(scene, frame: float) -> None:
    scene.frame_set(int(np.floor(frame)), subframe=float(frame % 1.0))


def _eyes(ob, life: Life, settings) -> tuple[list, list]:
    """The objects that are the right and the left eye."""
    life_settings = settings.life
    if any(life_settings.eyes):
        return tuple([_object(name, "an eye")] if name else [] for name in life_settings.eyes)
    sides: tuple[list, list] = ([], [])
    for part in settings.parts:
        if (part.role or pieces.role_of_name(part.name)) != "gaze":
            continue
        eye = pieces.object_of(part, ob)
        across = _canonical(life, mesh.corners(eye).mean(axis=0)[None])[0, 0]
        if abs(across) > _BOTH_M:
            sides[int(across > 0.0)].append(eye)
    return sides


def _alone(ob, life: Life, at):
    """Writes the head's rotation into an action of its own, which any object can play."""
    action, bag = curves.new_action(f"{ob.name} Head", "OBJECT")
    action.use_fake_user = True
    vectors = curves.from_rest(life.head, at) @ _axes(life).T
    angles = turning.eulers(turn.of_vectors(vectors))
    for index, column in enumerate(angles.T):
        curves.write(bag, "delta_rotation_euler", at, column, index=index)
    turns.put_alone(ob, action)
    return action


def _object(name: str, what: str):
    ob = bpy.data.objects.get(name)
    if ob is None:
        raise AnyfaceError("input", f"Life: pick the object that {what}")
    return ob


def _bone(armature: str, name: str) -> None:
    rig = _object(armature, "holds the bones")
    if rig.type != "ARMATURE" or name not in rig.pose.bones:
        raise AnyfaceError("input", f"Life: expected a bone of {rig.name}, got {name!r}")
