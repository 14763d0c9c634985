"""Writes, finds and removes the actions that play a take on the controls of a rig.

A data-block without an action plays ours. If it already has an action, ours becomes a strip on an
NLA track of its own, and the artist's curves on the same controls are set aside. Our action stores
what must be undone, beside the id of the face.
"""

import json
from contextlib import suppress
from dataclasses import asdict, dataclass, field

import bpy
import numpy as np

from ...core import json_file
from ...core.errors import AnyfaceError
from .. import identity
from ..animation import curves, stand_in
from ..life import turns
from ..takes import nla
from . import control_kinds
from .control_fit import Fitted
from .control_kinds import COLLECTIONS, Control

MARK = "anyface_controls"
# A property of our action. It points to the artist's action while a copy without some of its curves
# plays.
_ASIDE = "anyface_controls_aside"
_TRACK = "Anyface"


@dataclass
class Mark:
    """The record that one of our actions carries.

    `owner` is the id of the face. `block` is the id of the object that plays the action; for any
    other data-block it is the name. `before` holds the earlier values by data path. `paths` are the
    data paths of our curves.
    """

    owner: str
    block: str
    before: list[tuple[str, list[float]]] = field(default_factory=list)
    paths: list[str] = field(default_factory=list)
    made_animation_data: bool = False
    aside_print: str = ""


def check(block) -> None:
    """Raises `AnyfaceError("mesh")` where a data-block cannot get curves."""
    if block.library is not None:
        raise AnyfaceError(
            "mesh",
            f"{block.name} is linked from {block.library.filepath}: make a library override of the "
            "character (Object > Library Override > Make)",
        )
    animation = block.animation_data
    if animation is not None and animation.use_tweak_mode:
        raise AnyfaceError("mesh", f"{block.name}: leave the NLA strip's tweak mode (Tab) first")


def prepare(fitted: Fitted, at: np.ndarray, times: np.ndarray, few=None):
    """Makes an action for each data-block with curves of its controls; yields between controls.

    The curves have values at whole frames. They start from rest and return to it. If the generator
    is closed before its end, it deletes the actions. `times` `[T]` are the scene frames of the
    values. `at` `[2]` are the first and the last scene frame of the curves, where they rest. `few`
    (`core.sparse.Few`) chooses the keys of curves that get few.
    """
    by_block, actions = {}, {}
    for (control, moved), sizes in zip(fitted.moved, fitted.sizes, strict=True):
        by_block.setdefault(control.block, []).append((control, moved, sizes))
    try:
        for block, moved in by_block.items():
            check(block)
            actions[block], bag = curves.new_action(f"{block.name} Anyface", block.id_type)
            for control, rows, sizes in moved:
                yield from _write_curves(bag, control, rows, at, times, few, sizes)
                yield
    except BaseException:
        drop(actions)
        raise
    return actions


def drop(actions: dict) -> None:
    """Deletes prepared actions that were not used; an undo may have deleted them already."""
    for action in actions.values():
        with suppress(ReferenceError):
            curves.delete_action(action)


def write(ob, fitted: Fitted, actions: dict) -> None:
    """Gives each data-block the action that was prepared for it."""
    for block in actions:
        check(block)
    for block, action in actions.items():
        controls = [control for control, _ in fitted.moved if control.block == block]
        _write_on(ob, block, controls, action)


def redo(ob, fitted: Fitted, at: np.ndarray, stretch) -> None:
    """Mixes the curves of a take of `ob` inside a `core.redo.Stretch` with the values in `fitted`.

    `at` `[n]` are the scene frames of these values.
    """
    marked = [(action, mark.block, mark.paths) for action, mark in actions_of(ob)]
    for control, rows in fitted.moved:
        name, path = _id(control.block), control.curve_path
        actions = [action for action, block, paths in marked if block == name and path in paths]
        bags = [bag for action in actions for bag in curves.bags(action)]
        for index, column in control.columns(rows).items():
            for curve in [bag.fcurves.find(path, index=index) for bag in bags]:
                if curve is not None:
                    curves.splice(curve, at[: len(column)], column, stretch)


def actions_of(ob) -> list[tuple]:
    """The actions that a take of `ob` plays, with the `Mark` of each."""
    owner = identity.known(ob)
    marked = [(action, _read(action)) for action in bpy.data.actions if action.library is None]
    return [(a, mark) for a, mark in marked if owner and mark is not None and mark.owner == owner]


def rests(ob) -> dict[tuple, float]:
    """The rest values of the numbers that a take of `ob` animates, by data-block and data path."""
    rest_values = {}
    for action, mark in actions_of(ob):
        for block in _players(action, mark):
            rest_values |= {
                (block, path): values[0] for path, values in mark.before if len(values) == 1
            }
    return rest_values


def release(ob, keep: bool = False) -> bool:
    """Removes the take of `ob` from all rigs and restores them; False where there is none.

    With `keep` its actions stay in the file and become the artist's.
    """
    marked = actions_of(ob)
    if marked:
        turns.release(ob)
    for action, mark in marked:
        players = _players(action, mark)
        for block in players:
            _take_off(block, action, mark)
        if players or action.users == action.use_fake_user:
            _part_with(action, keep)
    return bool(marked)


def follow(copy, copies: dict[str, list]) -> None:
    """Assigns the take that a copied rig plays to the copy of its face.

    `copies` maps old ids to the copied objects. Unless the face has exactly one copy, the take
    becomes the artist's.
    """
    for action in _played(copy):
        mark = _read(action)
        if mark is None or mark.block == identity.known(copy):
            continue
        fresh = action.copy()
        _replace(copy, action, fresh)
        del fresh[MARK]
        faces = copies.get(mark.owner, [])
        if len(faces) == 1:
            mark.owner, mark.block = identity.known(faces[0]), identity.known(copy)
            fresh[MARK] = json.dumps(asdict(mark))


def _write_on(ob, block, controls: list[Control], action) -> None:
    if block.id_type == "OBJECT":
        identity.of(block)
    mark = Mark(identity.of(ob), _id(block))
    animation = block.animation_data
    if animation is None:
        animation, mark.made_animation_data = block.animation_data_create(), True
    for control in controls:
        mark.before.append((control.path, control.read()))
        mark.paths.append(control.curve_path)
    mark.aside_print = stand_in.play(action, _ASIDE, animation, set(mark.paths))
    _play(animation, action)
    action[MARK] = json.dumps(asdict(mark))


def _write_curves(bag, control: Control, rows: np.ndarray, at, times, few, sizes):
    whole = np.arange(np.ceil(times[0]), np.floor(times[-1]) + 1.0)
    frames = np.concatenate([at[:1][at[:1] < whole[0]], whole, at[1:]])
    rest = control.columns(np.zeros((1, rows.shape[1])))
    for index, column in control.columns(rows).items():
        values = np.interp(whole, times, column)
        keys = None if few is None else (yield from few.keys(values, sizes.max()))
        lead = curves.rests_before(frames, len(whole))
        values = np.concatenate([rest[index][:lead], values, rest[index]])
        curves.write_take(bag, control.curve_path, frames, values, keys, index, lead)


def _play(animation, action) -> None:
    if animation.action is None:
        curves.assign(animation, action)
        return
    first, last = action.frame_range
    strip = nla.add_strip(animation, _TRACK, action, first)
    strip.action_frame_start, strip.action_frame_end = first, last
    strip.extrapolation = "HOLD"


def _take_off(block, action, mark: Mark) -> None:
    animation = block.animation_data
    nla.remove_strips(animation, action)
    if animation.action == action:
        curves.own_action(block, action)
        action = animation.action
        every = {curve.data_path for bag in curves.bags(action) for curve in bag.fcurves}
        if every <= set(mark.paths):
            animation.action = None
        else:
            # The artist has added curves to our action: they stay there and play.
            curves.remove(animation, set(mark.paths))
    original = action.pop(_ASIDE, None)
    if original is not None:
        stand_in.give_back(original, animation, set(mark.paths), mark.aside_print)
    curves.drop_idle_animation(block, mark.made_animation_data)
    for path, values in mark.before:
        control_kinds.put(block, path, values)


def _part_with(action, keep: bool) -> None:
    if MARK in action:
        del action[MARK]
    if keep:
        action.use_fake_user = True
    elif action.users == action.use_fake_user:
        bpy.data.actions.remove(action)


def _players(action, mark: Mark) -> list:
    """The data-blocks that play an action for its face. Copies of them do not count."""
    every = [block for name in COLLECTIONS.values() for block in getattr(bpy.data, name)]
    players = [block for block in every if action in _played(block)]
    return [block for block in players if _id(block) == mark.block] or (
        players if len(players) == 1 and players[0].id_type != "OBJECT" else []
    )


def _played(block) -> list:
    animation = block.animation_data if block.library is None else None
    if animation is None:
        return []
    strips = [strip.action for track in animation.nla_tracks for strip in track.strips]
    return [action for action in {animation.action, *strips} if action is not None]


def _replace(block, action, fresh) -> None:
    animation = block.animation_data
    if animation.action == action:
        animation.action = fresh
    for strip in [strip for track in animation.nla_tracks for strip in track.strips]:
        if strip.action == action:
            strip.action = fresh


def _id(block) -> str:
    if block.id_type != "OBJECT":
        return block.name
    return identity.known(block)


def _read(action) -> Mark | None:
    return json_file.record(Mark, action.get(MARK))
