"""One absolute shape key for every frame."""

import numpy as np

from ...core.errors import AnyfaceError
from ...core.estimate import KEYFRAME, VERTEX, Cost
from .. import curves, guard, mesh, record
from .output import PREFIX, Output


class Frames(Output):
    """Absolute keys; `eval_time` meets the frame of each key exactly, so nothing drifts."""

    name = "frames"
    label = "Every Frame"
    help = "One absolute shape key per frame; exact and large, needs a mesh without own keys"
    finished = "a key for every frame holds the finished motion: use New Keys"
    cannot_wait = "one key per frame cannot wait beside others: use New Keys"

    def check_object(self, ob):
        guard.check_local(ob)
        if record.read_kept(ob.data.shape_keys):
            raise AnyfaceError(
                "mesh",
                f"{ob.name} has other takes, which one key per frame would stop: choose New "
                "Keys, or delete them",
                ("use_basis",),
            )
        own = guard.own_keys(ob.data.shape_keys)
        if own:
            raise AnyfaceError(
                "mesh",
                f"{ob.name} has {len(own)} shape keys of its own ({own[0]} …), and one key per "
                "frame would take them over: choose New Keys, which leave them alone",
                ("use_basis",),
            )

    def cost(self, asked):
        return Cost((asked.frames + 2) * (asked.vertices * VERTEX + KEYFRAME))

    def holds(self, take):
        return take.frames is not None

    def describe(self, take):
        return "one key per frame"

    def vectors(self, take):
        return take.frames

    def write(self, ob, take, rest, at, taken):
        shape_keys = ob.data.shape_keys
        shape_keys.use_relative = False
        blocks = [
            mesh.add_key(ob, f"{PREFIX}.{number + 1:05d}", rest + moved)
            for number, moved in enumerate(take.frames)
        ]
        blocks.append(mesh.add_key(ob, f"{PREFIX}.rest", rest))
        taken.keys += [block.name for block in blocks]
        blocks.insert(0, shape_keys.reference_key)
        for block in blocks:
            block.interpolation = "KEY_LINEAR"
        times = np.array([block.frame for block in blocks])
        curves.write(curves.key_channels(ob, taken), "eval_time", at, times)

    def paths(self, taken):
        return super().paths(taken) | {"eval_time"}

    def leave(self, shape_keys):
        shape_keys.eval_time = 0.0
        shape_keys.use_relative = True
