"""One absolute shape key for every frame."""

import numpy as np

from ...core import plan
from ...core.errors import AnyfaceError
from ...core.estimate import KEYFRAME, VERTEX, Cost
from ...core.job import BEGUN
from ..animation import curves
from ..face import mesh
from ..shape_keys import guard, record
from .output import PREFIX, Output


class Frames(Output):
    """Absolute keys; `eval_time` hits the frame of each key exactly, so nothing drifts."""

    name = "frames"
    label = "Every Frame"
    help = "One absolute shape key per frame; exact and large, needs a mesh without own keys"
    finished = "a key for every frame holds the finished motion: use New Keys"
    lost_in = {
        name: f"the take has one key per frame, which {name} cannot play: choose Alembic, or "
        "generate New Keys"
        for name in ("glTF", "FBX", "USD")
    }
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
        artist_keys = guard.own_keys(ob.data.shape_keys)
        if artist_keys:
            raise AnyfaceError(
                "mesh",
                f"{ob.name} has {len(artist_keys)} shape keys of its own ({artist_keys[0]} …), and "
                "one key per frame would take them over: choose New Keys, which leave them alone",
                ("use_basis",),
            )

    def cost(self, workload):
        return Cost((workload.frames + 2) * (workload.vertices * VERTEX + KEYFRAME))

    def describe(self, take):
        return "one key per frame"

    def write(self, ob, take, rest, at, take_record):
        shape_keys = ob.data.shape_keys
        shape_keys.use_relative = False
        blocks = [
            mesh.add_key(ob, f"{PREFIX}.{number + 1:05d}", rest + moved)
            for number, moved in enumerate(take.motion.displacements)
        ]
        blocks.append(mesh.add_key(ob, f"{PREFIX}.rest", rest))
        take_record.keys += [block.name for block in blocks]
        if curves.rests_before(at, take.frame_count):
            blocks.insert(0, shape_keys.reference_key)
        for block in blocks:
            block.interpolation = "KEY_LINEAR"
        times = np.array([block.frame for block in blocks])
        curves.write(curves.key_channels(ob, take_record), "eval_time", at, times)

    def span(self, ob, snapshot):
        curve = curves.find(ob.data.shape_keys.animation_data, "eval_time")
        frames = curves.places(curve)[0::2] if curve is not None else ()
        count = len(record.read(ob.data.shape_keys).keys) - 1
        lead = curves.rests_before(frames, count)
        if lead not in (0, 1):
            raise AnyfaceError("mesh", f"{ob.name}: its curve was changed: generate again")
        first, last = float(frames[lead]), float(frames[-2])
        return first, (last - first) / max(count - 1, 1), count

    def redo_write(self, parts, snapshot, take, first, at, stretch):
        shares = stretch.of_keyframes(at)
        for part in parts:
            with guard.object_mode(part):
                guard.unshare(part)
                shape_keys = part.data.shape_keys
                names = record.read(shape_keys).keys[first : first + len(at)]
                rest, moved = plan.of_piece(snapshot.face, take.motion.displacements, part.name)
                for name, share, target in zip(names, shares, rest + moved, strict=False):
                    if share > 0.0 and name in shape_keys.key_blocks:
                        _mix(shape_keys.key_blocks[name], np.float32(share), target)
                part.data.update()
            yield BEGUN

    def paths(self, take_record):
        return super().paths(take_record) | {"eval_time"}

    def leave(self, shape_keys):
        shape_keys.eval_time = 0.0
        shape_keys.use_relative = True


def _mix(block, share: np.float32, target: np.ndarray) -> None:
    """Moves a key by `share` of the way to the positions `target` `[V, 3]`."""
    was = mesh.read_key(block)
    block.points.foreach_set("co", (was + share * (target - was)).astype(np.float32).ravel())
