"""A few shape keys whose animated weights add up to the motion."""

from ...core import systems, wording
from ...core.estimate import VERTEX, Cost, between
from ...core.plan import PackSliders
from ..animation import curves
from ..face import emotion_mask, mesh
from ..shape_keys import slider_changes
from .output import PREFIX, Output, write_weights

# Number of keys that play a performance to within 0.1 mm: for 5 s and for 50 s. Longer ones need
# few more.
_SHORT_KEYS, _LONG_KEYS = 48, 91
# Seconds to find a basis, per frame with a million vertices: for 5 s and for 50 s.
_SHORT_S, _LONG_S = 0.29, 0.48


class Basis(Output):
    """Relative keys with weights within -1..1, which Blender clamps to the slider range."""

    name = "basis"
    redoes = True
    has_curves = True
    label = "New Keys"
    help = "A few new shape keys that play the performance; small and fast"
    as_basis = True

    def draw(self, layout, ob):
        layout.prop(ob.anyface, "error_mm", text="Precision (mm)")
        layout.prop(ob.anyface, "named_keys")
        if systems.by_name(ob.anyface.system).hears_emotion:
            layout.prop(ob.anyface, "layered")

    def cost(self, workload):
        keys = round(between(workload.seconds, _SHORT_KEYS, _LONG_KEYS))
        # The keyframes of sparse curves are small beside the shapes.
        return Cost(keys * workload.vertices * VERTEX, between(workload.seconds, _SHORT_S, _LONG_S))

    def plan(self, ob, settings, fps, objects):
        return PackSliders()

    def describe(self, take):
        return f"{len(take.motion.vectors)} shape keys"

    def details(self, take, is_human):
        return [f"exact to {wording.length(take.motion.error_mm, is_human, 2)}"]

    def write(self, ob, take, rest, at, take_record):
        basis = take.motion
        first = at[curves.rests_before(at, take.frame_count)]
        take_record.first_frame = float(first)
        take_record.frame_step = float(at[-2] - first) / max(take.frame_count - 1, 1)
        take_record.still = basis.why_missing
        slider_changes.write(ob.data.shape_keys, take_record, basis.packed)
        lowest = basis.weights.min(axis=0, initial=0.0)
        for number, vector in enumerate(basis.vectors):
            name = basis.names[number] if basis.names else f"{number + 1:03d}"
            block = mesh.add_key(ob, f"{PREFIX}.{name}", rest + vector)
            take_record.keys.append(block.name)
            if basis.emotion_first is not None and number >= basis.emotion_first:
                block.vertex_group = emotion_mask.of(ob)
            if lowest[number] < 0.0:
                block.slider_min = -1.0
        write_weights(ob, take_record, take_record.keys, at, basis)
