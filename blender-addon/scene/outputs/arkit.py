"""The 52 ARKit shapes, and the visemes on request, as animated shape keys of the mesh."""

from ...core import shapes
from ...core.errors import AnyfaceError
from ...core.estimate import KEYFRAME, RIG_S, SOLVE_S, VERTEX, Cost
from ...core.plan import MakeKeys
from ..face import mesh
from ..shape_keys import guard, record
from . import keys
from .output import Output, write_weights


class Arkit(Output):
    """Keys named after the shapes; visemes stay at 0. All takes use the same keys."""

    name = "arkit"
    redoes = True
    has_curves = True
    label = "Make ARKit Keys"
    help = "The 52 ARKit shapes as keys of this mesh, animated"
    options = ("visemes",)

    def check(self, ob, settings):
        super().check(ob, settings)
        shape_names = {*shapes.ARKIT, *(shapes.VISEMES if settings.visemes else ())}
        artist_keys = [name for name in guard.own_keys(ob.data.shape_keys) if name in shape_names]
        if artist_keys:
            raise AnyfaceError(
                "mesh",
                f"{ob.name} has a key {artist_keys[0]} of its own: choose Existing Keys, which "
                "animates it, or where it is driven New Keys, which add to it",
                ("use_keys", "use_basis"),
            )

    def cost(self, workload):
        key_count = len(shapes.ARKIT) + (len(shapes.VISEMES) if workload.visemes else 0)
        size = (
            key_count * workload.vertices * VERTEX + len(shapes.ARKIT) * workload.frames * KEYFRAME
        )
        return Cost(size, SOLVE_S, RIG_S)

    def plan(self, ob, settings, fps, objects):
        return MakeKeys(settings.visemes)

    def describe(self, take):
        return keys.describe(take, "made")

    def write(self, ob, take, rest, at, take_record):
        motion = take.motion
        named_vectors = [*zip(motion.keys, motion.vectors, strict=True)]
        if motion.visemes is not None:
            named_vectors += zip(motion.visemes.names, motion.visemes.vectors, strict=True)
        take_record.keys += [_key(ob, name, rest + vector).name for name, vector in named_vectors]
        animated = take_record.keys[: len(motion.keys)]
        write_weights(ob, take_record, animated, at, motion)


def _key(ob, name: str, positions):
    """The key of a shape: the one that another take of ours has made, or else a new one."""
    shape_keys = ob.data.shape_keys
    if name in record.all_keys(shape_keys) and name in shape_keys.key_blocks:
        return shape_keys.key_blocks[name]
    return mesh.add_key(ob, name, positions)
