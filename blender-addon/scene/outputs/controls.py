"""A take on the controls of a rig: bones, custom properties and other driver inputs."""

from dataclasses import dataclass

import bpy

from ...core import wording
from ...core.controls_plan import FollowPoints
from ...core.errors import AnyfaceError
from ...core.estimate import KEYFRAME, Cost
from ...core.job import BEGUN
from ..animation import curves
from ..rig_controls import control_actions, control_bench, control_fit, control_sources
from ..shape_keys import guard
from .output import Output, draw_list_buttons

# The number of curves on a typical rig.
_CURVES = 100


@dataclass
class ControlRow:
    """A row of the artist's list; its fields are those of `ui.controls.AnyfaceControl`."""

    kind: str
    id_type: str
    block: str
    name: str
    sided: bool = False


class Controls(Output):
    """Animates the rig, which moves the mesh. The mesh and earlier actions of the rig stay."""

    name = "controls"
    label = "Rig Controls"
    help = "The face controls of the rig: bones, custom properties, what drives keys"
    finished = "its curves lie on the rig: change them there, or generate again"
    moves_parts = False
    in_files = True
    has_curves = True

    def check_object(self, ob):
        guard.check_mesh(ob)
        if ob.library is not None:
            raise AnyfaceError(
                "mesh",
                f"{ob.name} is linked: make a library override of the character first "
                "(Object > Library Override > Make)",
            )

    def check(self, ob, settings):
        super().check(ob, settings)
        control_bench.check(ob)
        if not settings.controls and not settings.rig and not control_sources.has_any(ob):
            raise AnyfaceError(
                "mesh",
                f"{ob.name} has no rig: pick the armature or the object that moves its face, or "
                "choose New Keys",
            )

    def draw(self, layout, ob):
        stored = ob.anyface_controls
        layout.prop(stored, "rig", placeholder=_name_of(control_sources.rig_of(ob)))
        draw_list_buttons(layout, "controls", "Find Controls")
        if not len(stored.rows):
            layout.label(text="Controls are found when you generate")
            return
        layout.template_list("ANYFACE_UL_controls", "", stored, "rows", stored, "index", rows=4)

    def cost(self, workload):
        return Cost(_CURVES * workload.frames * KEYFRAME)

    def plan(self, ob, settings, fps, objects):
        return FollowPoints()

    def describe(self, take):
        fitted = take.motion.fitted
        return f"{len(fitted.moved)} controls of the rig show {fitted.shown:.0%} of the motion"

    def details(self, take, is_human):
        worst = sorted(take.motion.fitted.missed.items(), key=lambda pair: -pair[1])
        missed = [f"{name} {wording.length(mm, is_human)}" for name, mm in worst]
        return [f"farthest off: {', '.join(missed)}"] if missed else []

    def sources(self, ob, settings) -> list[control_sources.Source]:
        """The bones and numbers to try: the artist's list, or if it is empty, those found."""
        if settings.controls:
            return [control_sources.find(**vars(row)) for row in settings.controls]
        picked = bpy.data.objects.get(settings.rig) if settings.rig else control_sources.rig_of(ob)
        is_rig = picked is not None and picked.type == "ARMATURE"
        return control_sources.propose(ob, picked if is_rig else None, settings.left_alone)

    def settle(self, ob, take, settings):
        sources = self.sources(ob, settings)
        for source in sources:
            control_actions.check(source.block)
        return (yield from control_fit.fit(ob, take, sources, control_actions.rests(ob)))

    def prepare_files(self, take, start_frame, scene_fps):
        frames = take.scene_frames(start_frame, scene_fps)
        ends = curves.with_rest(frames, scene_fps, take.earliest)[[0, -1]]
        fitted = take.motion.fitted
        fitted.actions = yield from control_actions.prepare(fitted, ends, frames, take.few)

    def drop_files(self, take):
        control_actions.drop(take.motion.fitted.actions)

    def write_files(self, ob, take, start_frame, scene_fps):
        fitted = take.motion.fitted
        control_actions.write(ob, fitted, fitted.actions)
        fitted.actions = {}

    def redo_plan(self, ob, snapshot, first, shares):
        return FollowPoints()

    def redo_write(self, parts, snapshot, take, first, at, stretch):
        ob, settings = parts[0], snapshot.settings.output
        sources, rests = self.sources(ob, settings), control_actions.rests(ob)
        # In a stretch, such as a pause, little may move. So the share shown is not judged.
        take = yield from control_fit.fit(ob, take, sources, rests, judged=False)
        control_actions.redo(ob, take.motion.fitted, at, stretch)
        yield BEGUN

    def find(self, ob):
        if ob is None or ob.type != "MESH":
            return None
        return control_actions.actions_of(ob) or None

    def keep(self, ob):
        """Leaves the actions of the earlier take in the file."""
        control_actions.release(ob, keep=True)

    def remove(self, ob):
        """Removes only the curves, and restores bones and properties."""
        control_actions.release(ob)


def _name_of(block) -> str:
    return block.name if block is not None else "No rig found"
