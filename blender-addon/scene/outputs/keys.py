"""A take on the keys that the artist already has: only their values are animated."""

from dataclasses import replace

import bpy

from ...core import shapes
from ...core.errors import AnyfaceError
from ...core.estimate import KEYFRAME, SOLVE_S, Cost
from ...core.plan import SolveKeys
from ...core.take import Piece, Take
from .. import curves, existing
from .output import Output, write_weights


class Keys(Output):
    """Curves that the artist had on the keys wait in his own action."""

    name = "keys"
    label = "Existing Keys"
    help = "The ARKit or viseme keys that the mesh has already"
    moves_parts = False

    def check(self, ob, asked):
        super().check(ob, asked)
        if not existing.find(ob, asked.mapping):
            raise AnyfaceError(
                "mesh",
                f"{ob.name} has no free shape key named after an ARKit shape or a viseme: write "
                "the keys into the list, or choose Make ARKit Keys",
            )

    def draw(self, layout, ob):
        row, stored = layout.row(align=True), ob.anyface_output
        row.operator("anyface.mapping_find", text="Find Keys")
        row.operator("anyface.mapping_load", text="", icon="FILE_FOLDER")
        row.operator("anyface.mapping_save", text="", icon="FILE_TICK")
        row.operator("anyface.mapping_clear", text="", icon="X")
        if not len(stored.mapping):
            layout.label(text=f"{len(existing.find(ob, {}))} keys found by name")
            return
        column = layout.column(align=True)
        for item in stored.mapping:
            row = column.row(align=True)
            row.label(text=item.name)
            if ob.data.shape_keys is not None:
                row.prop_search(item, "key", ob.data.shape_keys, "key_blocks", text="")

    def cost(self, asked):
        return Cost(asked.keys * asked.frames * KEYFRAME, SOLVE_S)

    def plan(self, ob, asked, fps, objects):
        keys = existing.find(ob, asked.mapping)
        return SolveKeys(keys, existing.vectors(ob, keys.values()))

    def holds(self, take):
        return take.key_motion is not None and take.key_motion.vectors is None

    def describe(self, take):
        return describe(take, "driven")

    def notes(self, ob, asked):
        left = existing.left_alone(ob, asked.mapping)
        more = f" and {len(left) - 3} more" if len(left) > 3 else ""
        return [f"driven, muted or locked, left alone: {', '.join(left[:3])}{more}"] if left else []

    def split(self, take, parts):
        others = [(piece, _of_object(take, piece)) for piece in parts[1:]]
        return [(parts[0], take), *(pair for pair in others if pair[1] is not None)]

    def write(self, ob, take, rest, at, taken):
        motion, blocks = take.key_motion, ob.data.shape_keys.key_blocks
        missing = [name for name in motion.keys if name not in blocks]
        if missing:
            raise AnyfaceError("mesh", f"{ob.name} has lost the key {missing[0]} meanwhile")
        taken.values = dict.fromkeys(motion.keys, 0.0)
        existing.note_values(ob.data.shape_keys, taken)
        write_weights(curves.key_channels(ob, taken), motion.keys, at, motion.weights)


def describe(take: Take, what: str) -> str:
    """What was done with named keys: "52 keys driven, 97% of the motion shown"."""
    motion = take.key_motion
    return f"{len(motion.keys)} keys {what}, {1.0 - motion.left_out:.0%} of the motion shown"


def _of_object(take: Take, piece: Piece) -> Take | None:
    """The take on the keys that an object beside the face has of the same shapes, or None."""
    other, motion = bpy.data.objects.get(piece.name), take.key_motion
    theirs = existing.find(other, {}) if other is not None else {}
    shared = [(key, theirs[n]) for n, key in shapes.match(motion.keys).items() if n in theirs]
    if not shared:
        return None
    columns = [motion.keys.index(key) for key, _ in shared]
    names = [name for _, name in shared]
    return replace(take, key_motion=replace(motion, keys=names, weights=motion.weights[:, columns]))
