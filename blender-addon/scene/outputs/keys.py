"""A take on the artist's existing keys: only their values are animated."""

from dataclasses import replace

import bpy
import numpy as np

from ...core import wording
from ...core.errors import AnyfaceError
from ...core.estimate import KEYFRAME, SOLVE_S, Cost
from ...core.plan import SolveKeys, by_key
from ...core.take import HeldKeys, Piece, Take
from ..shape_keys import artist_keys
from .output import Output, draw_list_buttons, write_weights


class Keys(Output):
    """Animates the artist's keys. Earlier curves on them are kept in the artist's action."""

    name = "keys"
    redoes = True
    has_curves = True
    label = "Existing Keys"
    help = "The ARKit or viseme keys that the mesh has already"
    moves_parts = False
    needs_face = False

    def check(self, ob, settings):
        super().check(ob, settings)
        if artist_keys.find(ob, settings.mapping):
            return
        left = artist_keys.left_alone(ob, settings.mapping)
        if left:
            raise AnyfaceError(
                "mesh",
                f"{ob.name}: {_some(left)} are driven, muted or locked: choose Rig "
                "Controls, which move what drives them, or New Keys, which add to them, or free "
                "them",
                ("use_basis",),
            )
        raise AnyfaceError(
            "mesh",
            f"{ob.name} has no free shape key whose name is known: press Find Keys or + and pick "
            "the keys by hand, or choose Make ARKit Keys",
            ("use_arkit", "use_basis"),
        )

    def draw(self, layout, ob):
        stored = ob.anyface_output
        draw_list_buttons(layout, "mapping", "Find Keys")
        if not len(stored.mapping):
            key_names = artist_keys.names_of(artist_keys.find(ob, []))
            layout.label(text=f"{len(key_names)} keys found by name")
        row = layout.row()
        rows = stored, "mapping", stored, "mapping_index"
        row.template_list("ANYFACE_UL_mapping", "", *rows, rows=4)
        buttons = row.column(align=True)
        buttons.operator("anyface.mapping_add", text="", icon="ADD")
        buttons.operator("anyface.mapping_remove", text="", icon="REMOVE")

    def cost(self, workload):
        return Cost(workload.keys * workload.frames * KEYFRAME, SOLVE_S)

    def plan(self, ob, settings, fps, objects):
        pairs = artist_keys.full(ob, settings.mapping)
        keys = artist_keys.names_of(pairs)
        if not keys:
            raise AnyfaceError(
                "mesh",
                f"{ob.name}: {_some(artist_keys.empty(ob, settings.mapping))} move nothing: choose "
                "Make ARKit Keys or New Keys",
                ("use_arkit", "use_basis"),
            )
        shown, factors = artist_keys.factors(pairs)
        vectors = artist_keys.vectors(ob, keys)
        return SolveKeys(shown, keys, factors, vectors, artist_keys.shown_by(pairs))

    def describe(self, take):
        said = describe(take, "driven")
        missing = take.motion.missing
        return f"{said}, no key shows {_some(missing)}" if missing else said

    def notes(self, ob, settings):
        left = artist_keys.left_alone(ob, settings.mapping)
        empty = artist_keys.empty(ob, settings.mapping)
        notes = [f"driven, muted or locked, left alone: {_some(left)}"] if left else []
        return [*notes, f"empty keys, left out: {_some(empty)}"] if empty else notes

    def split(self, take, parts):
        others = [(piece, _of_object(take, piece)) for piece in parts[1:]]
        return [(parts[0], take), *(pair for pair in others if pair[1] is not None)]

    def write(self, ob, take, rest, at, take_record):
        motion, blocks = take.motion, ob.data.shape_keys.key_blocks
        missing = [name for name in motion.keys if name not in blocks]
        if missing:
            raise AnyfaceError("mesh", f"{ob.name} has lost the key {missing[0]} meanwhile")
        take_record.values = dict.fromkeys(motion.keys, 0.0)
        take_record.shown, take_record.factors = motion.shown, motion.factors
        artist_keys.note_values(ob.data.shape_keys, take_record)
        write_weights(ob, take_record, motion.keys, at, motion)


def describe(take: Take, what: str) -> str:
    """Describes named keys: "52 shape keys driven, they show most of …"."""
    motion = take.motion
    return f"{len(motion.keys)} shape keys {what}, they show {wording.share(1.0 - motion.left_out)}"


def _of_object(take: Take, piece: Piece) -> Take | None:
    """The take for those keys of another object that show the same shapes; None without any."""
    other, motion = bpy.data.objects.get(piece.name), take.motion
    theirs = artist_keys.full(other, []) if other is not None else []
    shared = [pair for pair in theirs if pair.shape in motion.shapes]
    if not shared:
        return None
    shown, factors = artist_keys.factors(shared)
    columns = [motion.shapes.index(shape) for shape in shown]
    weights = np.clip(motion.shape_weights[:, columns] @ factors, 0.0, 1.0)
    keys = artist_keys.names_of(shared)
    part_motion = replace(motion, keys=keys, weights=weights, shown=artist_keys.shown_by(shared))
    part_motion.factors = by_key(shown, keys, factors)
    part_motion.keys_of_curves = [_same_curve(motion, column) for column in weights.T]
    return replace(take, motion=part_motion)


def _same_curve(motion, column: np.ndarray):
    """The keyframes of the face's curve that equals `column`; None where there is none.

    Held poses have the same keyframes on all curves.
    """
    held_keys = [keys for keys in motion.keys_of_curves or () if isinstance(keys, HeldKeys)]
    if held_keys:
        return held_keys[0]
    for other, keys in zip(motion.weights.T, motion.keys_of_curves or (), strict=False):
        if np.array_equal(other, column):
            return keys
    return None


def _some(names: list[str]) -> str:
    """The first three names, and how many more there are."""
    more = f" and {len(names) - 3} more" if len(names) > 3 else ""
    return f"{', '.join(names[:3])}{more}"
