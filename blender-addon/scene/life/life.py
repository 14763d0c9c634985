"""Head and eyes of a take: which objects or bones they turn, and how they are let go again.

Nothing of it is in the skin. What was written on an object stands in a custom property of it,
beside the id of the character whose it is; Remove takes exactly that away.
"""

import json
from dataclasses import asdict, dataclass, field, fields

import bpy
import numpy as np

from ...core import turn
from ...core.errors import AnyfaceError
from ...core.job import BEGUN, at_once
from ...core.take import Life, Take
from .. import identity
from ..animation import curves
from ..face import mesh, pieces
from ..outputs.output import times
from ..takes import remove
from . import turning

# On what a character turns: a list of `Entry`.
ENTRIES = "anyface_turned"
# On what waits or stands alone: the action that holds the curves.
_ACTION = "anyface_turned_"
# Controls of the library that *Life* turns off together.
CONTROLS = ("head_motion", "gaze", "breath", "variety", "blinks_per_minute")
# No eye turns farther than this, radians: yaw and pitch.
_MOST = np.radians([45.0, 35.0])
# Eyes of the library, right one first: canonical metres.
_EYES = np.array([[-0.032, 0.046, 0.071], [0.032, 0.046, 0.071]])
# Frames of the scene that are looked at before the interface is asked again.
_FEW = 4
# An object whose middle lies nearer to the face's than this holds both eyes, canonical metres.
_BOTH_M = 0.01


@dataclass
class LifeSettings:
    """Where head and eyes go, by names of objects and bones.

    `head` is "NONE", "OBJECT", "BONE" or "OWN", an action of its own on nobody; `gaze` is "NONE",
    "PARTS" or "BONES". `eyes` and `eye_bones` name the right and the left one; with no eyes named,
    parts with the role gaze turn. The eyes rest on `look_at` where that is named.
    """

    use: bool = True
    head: str = "NONE"
    head_object: str = ""
    head_bone: str = ""
    gaze: str = "NONE"
    eyes: tuple[str, str] = ("", "")
    eye_armature: str = ""
    eye_bones: tuple[str, str] = ("", "")
    look_at: str = ""


@dataclass
class Entry:
    """What a character's take has put on an object.

    `owner` is the character's, `take` the id of a take that waits, empty for the one that plays;
    `before` are values by data path as they were. The `made_*` fields say what must be undone.
    """

    owner: str
    take: str = ""
    before: dict[str, list[float]] = field(default_factory=dict)
    made_action: bool = False
    made_slot: bool = False
    made_animation_data: bool = False
    shared_action_print: str = ""


def names(asked: LifeSettings) -> list[str]:
    """The names of all objects that take part."""
    return [asked.head_object, *asked.eyes, asked.eye_armature, asked.look_at]


def rename(asked: LifeSettings, now: dict[str, str]) -> None:
    """Objects have got other names: `now` by the old one."""
    for name in ("head_object", "eye_armature", "look_at"):
        setattr(asked, name, now.get(getattr(asked, name), getattr(asked, name)))
    asked.eyes = tuple(now.get(name, name) for name in asked.eyes)


def held(settings) -> dict[str, float]:
    """Controls that hold whatever the panel says: all of *Life* off, or no head to turn."""
    asked = settings.life
    names = CONTROLS if not asked.use else ("head_motion",) if asked.head == "NONE" else ()
    return {name: 0.0 for name in names if name in settings.controls}


def check(ob, settings) -> None:
    """Raises `AnyfaceError` in words where head or eyes have nowhere to go."""
    asked = settings.life
    if not asked.use:
        return
    if asked.head in ("OBJECT", "BONE"):
        _object(asked.head_object, "the head turns")
    if asked.head == "BONE":
        _bone(asked.head_object, asked.head_bone)
    if asked.gaze == "BONES":
        for name in asked.eye_bones:
            _bone(asked.eye_armature, name)
    if asked.look_at:
        _object(asked.look_at, "the eyes look at")
    # What cannot be turned says so before anything is made.
    still = Life(np.zeros((1, 3)), np.zeros((1, 2, 2)), np.eye(3, 4))
    _turned(ob, still, settings, np.arange(3.0))


def look(take: Take, settings, start_frame: float, scene_fps: float):
    """Notes where the eyes look in each frame of a take, yielding between frames of the scene.

    At each yield the scene stands at the frame of the artist's again.
    """
    asked = settings.life
    if take.life is None or not asked.use or asked.gaze == "NONE" or not asked.look_at:
        return
    frames = start_frame + np.arange(take.frame_count) * (scene_fps / take.fps)
    take.life.looked_at = yield from _points(asked.look_at, take.life, frames)


def writing(ob, take: Take, settings, start_frame: float, scene_fps: float):
    """Turns what `settings` names with `take`; what an earlier one turns is let go first.

    Yields between objects; returns what was done, in words.
    """
    release(ob)
    asked = settings.life
    if take.life is None or not asked.use:
        return []
    frames = start_frame + np.arange(take.frame_count) * (scene_fps / take.fps)
    at = times(frames, scene_fps)
    turned = _turned(ob, take.life, settings, at)
    for other, channels in turned.items():
        yield from _put(ob, other, channels, at)
    notes = [f"{', '.join(other.name for other in turned)} turn"] if turned else []
    if asked.head == "OWN":
        notes.append(f"head in the action {_alone(ob, take.life, at).name}")
    return notes


def redo(ob, life: Life, settings, at: np.ndarray, splice) -> None:
    """Hands the curves of head and eyes, and what they would be at scene frames `at` `[n]`, to
    `splice(curve, at, values)`; those in an action on nobody stay."""
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


def release(ob) -> None:
    """Lets go of everything that the playing take of `ob` turns, as it was before."""
    owned = _owned(ob)
    for other, entries in owned:
        for entry in _of(ob, entries, ""):
            entries = [kept for kept in entries if kept is not entry]
            _inherit(entries, entry)
            _take_off(other, entry)
        _store(other, entries)
    _delete_alone(ob, "now")
    if owned:
        # Where things stand is read of what was just let go.
        bpy.context.view_layer.update()


def keep(ob, take_id: str) -> None:
    """The playing take waits: its curves lie in an action that a property points to."""
    for other, entries in _owned(ob):
        for entry in _of(ob, entries, ""):
            action, bag = curves.new_action(f"{other.name} {take_id}", "OBJECT")
            curves.copy_paths(other.animation_data.action, bag, set(entry.before))
            _inherit([kept for kept in entries if kept is not entry], entry)
            _take_off(other, entry)
            entry.take = take_id
            other[_ACTION + take_id] = action
            _store(other, entries)
    if _ACTION + "now" in ob:
        ob[_ACTION + "own_" + take_id] = ob[_ACTION + "now"]
        del ob[_ACTION + "now"]


def play(ob, take_id: str) -> None:
    """A take that waits plays again."""
    for other, entries in _owned(ob):
        for entry in _of(ob, entries, take_id):
            action = other.get(_ACTION + take_id)
            del other[_ACTION + take_id]
            entry.take = ""
            if action is not None:
                curves.copy_paths(action, _channels(other, entry), set(entry.before))
                curves.delete_action(action)
            _store(other, entries)
    if _ACTION + "own_" + take_id in ob:
        ob[_ACTION + "now"] = ob[_ACTION + "own_" + take_id]
        del ob[_ACTION + "own_" + take_id]


def follow(copy, copies: dict[str, list]) -> None:
    """What turns on a `copy` belongs to the copy of its character; `copies` are objects by old id.

    Where the character was not copied, the curves are the artist's from now on.
    """
    kept = []
    for entry in _entries(copy):
        faces = copies.get(entry.owner, [])
        found = faces if len(faces) == 1 else [face for face in faces if _names(face, copy)]
        if found:
            entry.owner = identity.known(found[0])
            kept.append(entry)
    if ENTRIES in copy:
        _store(copy, kept)


def _names(face, other) -> bool:
    """Whether the settings of `face` name another object."""
    stored = face.anyface_life_settings
    kinds = [prop.identifier for prop in stored.bl_rna.properties if prop.type == "POINTER"]
    found = [getattr(stored, kind) for kind in kinds]
    return other in [*found, *(row.object for row in face.anyface_face.parts)]


def _turned(ob, life: Life, settings, at) -> dict:
    """The channels of each object that turns."""
    asked, found = settings.life, {}
    axes = _axes(life)
    if asked.head in ("OBJECT", "BONE"):
        vectors = _eased(life.head) @ axes.T
        other = _object(asked.head_object, "the head turns")
        one = asked.head == "BONE"
        channels = (
            [turning.of_bone(other, asked.head_bone, vectors, _mine(ob, other))]
            if one
            else turning.of_object(other, vectors, _mine(ob, other))
        )
        found.setdefault(other, []).extend(channels)
    for side in range(2) if asked.gaze != "NONE" else ():
        angles = life.gaze[:, side].astype(np.float64)
        if asked.look_at:
            if life.looked_at is None:
                life.looked_at = at_once(_points(asked.look_at, life, at[1:-1]))
            angles = turn.to_object(angles, life.looked_at, _EYES[side])
        angles = np.clip(angles, -_MOST, _MOST)
        vectors = _eased(turn.of_gaze(angles)) @ axes.T
        if asked.gaze == "BONES":
            armature = _object(asked.eye_armature, "the eyes turn")
            bone = turning.of_bone(armature, asked.eye_bones[side], vectors, _mine(ob, armature))
            found.setdefault(armature, []).append(bone)
            continue
        for eye in _eyes(ob, life, settings)[side]:
            middle = mesh.corners(eye).mean(axis=0)
            channels = turning.of_object(eye, vectors, _mine(ob, eye), middle)
            found.setdefault(eye, []).extend(channels)
    return found


def _mine(ob, other) -> set[str]:
    """Data paths on an object that the playing take of `ob` has already."""
    return {path for entry in _of(ob, _entries(other), "") for path in entry.before}


def _eased(vectors: np.ndarray) -> np.ndarray:
    """From rest and back to it, `[T + 2, 3]`."""
    return np.concatenate([np.zeros((1, 3)), vectors, np.zeros((1, 3))])


def _axes(life: Life) -> np.ndarray:
    """The canonical axes in the world, as columns `[3, 3]`."""
    linear = np.asarray(life.way, dtype=np.float64)[:, :3]
    return (linear / np.linalg.norm(linear, axis=1, keepdims=True)).T


def _canonical(life: Life, points: np.ndarray) -> np.ndarray:
    """World points `[N, 3]` in the canonical frame."""
    way = np.asarray(life.way, dtype=np.float64)
    return points @ way[:, :3].T + way[:, 3]


def _points(name: str, life: Life, at: np.ndarray):
    """Where an object is at scene frames `[T]`, canonical frame `[T, 3]`; yields between frames."""
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
    asked = settings.life
    if any(asked.eyes):
        return tuple([_object(name, "an eye")] if name else [] for name in asked.eyes)
    sides: tuple[list, list] = ([], [])
    for part in settings.parts:
        if (part.role or pieces.role_of_name(part.name)) != "gaze":
            continue
        eye = pieces.object_of(part, ob)
        across = _canonical(life, mesh.corners(eye).mean(axis=0)[None])[0, 0]
        if abs(across) > _BOTH_M:
            sides[int(across > 0.0)].append(eye)
    return sides


def _put(ob, other, channels, at):
    identity.of(other)
    entry = Entry(identity.of(ob), before={channel.path: channel.before for channel in channels})
    bag = _channels(other, entry)
    for channel in channels:
        for index, column in enumerate(channel.values.T):
            curves.write(bag, channel.path, at, column, index=index)
    _store(other, [*_entries(other), entry])
    yield BEGUN


def _channels(other, entry: Entry):
    """Where curves on an object go: the artist's action, or one of our own."""
    if other.library is not None:
        raise AnyfaceError("mesh", f"{other.name} is linked: pick an object of this file")
    if other.animation_data is None:
        other.animation_data_create()
        entry.made_animation_data = True
    action = other.animation_data.action
    if _entries(other):
        curves.own_action(other, action)
        action = other.animation_data.action
    if action is not None and not curves.LAYERED and action.users - action.use_fake_user > 1:
        raise AnyfaceError("mesh", f"{other.name} shares its action: make it single-user first")
    return curves.own_channels(other.animation_data, f"{other.name} Anyface", "OBJECT", entry)


def _take_off(other, entry: Entry) -> None:
    animation = other.animation_data
    if animation is not None:
        curves.own_action(other, animation.action)
        curves.remove(animation, set(entry.before))
        remove.release_action(animation, entry)
        idle = animation.action is None and not animation.drivers and not animation.nla_tracks
        if entry.made_animation_data and idle:
            other.animation_data_clear()
    entry.made_action = entry.made_slot = entry.made_animation_data = False
    turning.put_back(other, entry.before)


def _alone(ob, life: Life, at):
    """The head's rotation in an action of its own, which any object may be given."""
    action, bag = curves.new_action(f"{ob.name} Head", "OBJECT")
    action.use_fake_user = True
    vectors = _eased(life.head) @ _axes(life).T
    turns = turning.eulers(turn.of_vectors(vectors))
    for index, column in enumerate(turns.T):
        curves.write(bag, "delta_rotation_euler", at, column, index=index)
    ob[_ACTION + "now"] = action
    return action


def _delete_alone(ob, name: str) -> None:
    action = ob.get(_ACTION + name)
    if action is None:
        return
    del ob[_ACTION + name]
    curves.delete_action(action)


def _of(ob, entries: list[Entry], take_id: str) -> list[Entry]:
    """What one take of `ob` has put on an object."""
    return [e for e in entries if e.owner == identity.known(ob) and e.take == take_id]


def _inherit(others: list[Entry], gone: Entry) -> None:
    """What was made for one and still serves another is undone with that."""
    playing = [entry for entry in others if not entry.take]
    if not playing:
        return
    for name in ("made_action", "made_slot", "made_animation_data"):
        setattr(playing[0], name, getattr(playing[0], name) or getattr(gone, name))
        setattr(gone, name, False)


def _owned(ob) -> list[tuple]:
    """The objects that takes of `ob` turn, and everything that is on them."""
    owner = identity.known(ob)
    if not owner:
        return []
    found = [(other, _entries(other)) for other in bpy.data.objects]
    return [(o, entries) for o, entries in found if any(e.owner == owner for e in entries)]


def _entries(other) -> list[Entry]:
    known = {item.name for item in fields(Entry)}
    try:
        rows = json.loads(other.get(ENTRIES, "[]"))
        return [Entry(**{k: v for k, v in row.items() if k in known}) for row in rows]
    except (ValueError, TypeError, AttributeError):
        return []


def _store(other, entries: list[Entry]) -> None:
    if entries:
        other[ENTRIES] = json.dumps([asdict(entry) for entry in entries])
    elif ENTRIES in other:
        del other[ENTRIES]


def _object(name: str, what: str):
    found = bpy.data.objects.get(name)
    if found is None:
        raise AnyfaceError("input", f"Life: pick the object that {what}")
    return found


def _bone(armature: str, name: str) -> None:
    found = _object(armature, "holds the bones")
    if found.type != "ARMATURE" or name not in found.pose.bones:
        raise AnyfaceError("input", f"Life: expected a bone of {found.name}, got {name!r}")
