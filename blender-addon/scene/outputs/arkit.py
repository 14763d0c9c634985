"""The 52 ARKit shapes, and the visemes if wanted, as animated shape keys of the mesh."""

from ...core import shapes
from ...core.errors import AnyfaceError
from ...core.estimate import KEYFRAME, RIG_S, SOLVE_S, VERTEX, Cost
from ...core.plan import MakeKeys
from ..face import mesh
from ..shape_keys import guard, record
from . import keys
from .output import Output, write_weights


class Arkit(Output):
    """Keys under the names of the shapes; visemes stay at 0. All takes play on the same keys."""

    name = "arkit"
    redoes = True
    has_curves = True
    label = "Make ARKit Keys"
    help = "The 52 ARKit shapes as keys of this mesh, animated"
    options = ("visemes",)

    def check(self, ob, asked):
        super().check(ob, asked)
        wanted = {*shapes.ARKIT, *(shapes.VISEMES if asked.visemes else ())}
        own = [name for name in guard.own_keys(ob.data.shape_keys) if name in wanted]
        if own:
            raise AnyfaceError(
                "mesh",
                f"{ob.name} has a key {own[0]} of its own: choose Existing Keys, which animates "
                "it, or where it is driven New Keys, which add to it",
                ("use_keys", "use_basis"),
            )

    def cost(self, asked):
        made = len(shapes.ARKIT) + (len(shapes.VISEMES) if asked.visemes else 0)
        size = made * asked.vertices * VERTEX + len(shapes.ARKIT) * asked.frames * KEYFRAME
        return Cost(size, SOLVE_S, RIG_S)

    def plan(self, ob, asked, fps, objects):
        return MakeKeys(asked.visemes)

    def describe(self, take):
        return keys.describe(take, "made")

    def write(self, ob, take, rest, at, taken):
        motion = take.motion
        made = [*zip(motion.keys, motion.vectors, strict=True)]
        if motion.visemes is not None:
            made += zip(motion.visemes.names, motion.visemes.vectors, strict=True)
        taken.keys += [_key(ob, name, rest + vector).name for name, vector in made]
        animated = taken.keys[: len(motion.keys)]
        write_weights(ob, taken, animated, at, motion)


def _key(ob, name: str, positions):
    """The key of a shape: that of another take of ours, as it is, or a new one."""
    shape_keys = ob.data.shape_keys
    if name in record.all_keys(shape_keys) and name in shape_keys.key_blocks:
        return shape_keys.key_blocks[name]
    return mesh.add_key(ob, name, positions)
