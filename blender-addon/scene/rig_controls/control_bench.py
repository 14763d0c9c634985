"""Tries out a rig: sets its controls, reads the evaluated mesh, and restores everything."""

from contextlib import contextmanager

import bpy
import numpy as np

from ...core.errors import AnyfaceError
from . import control_kinds

# Modifiers that move vertices without renumbering them. All others are off while a rig is tried.
_DEFORMING = {
    "ARMATURE", "CAST", "CORRECTIVE_SMOOTH", "CURVE", "DISPLACE", "HOOK", "LAPLACIANDEFORM",
    "LAPLACIANSMOOTH", "LATTICE", "MESH_DEFORM", "SHRINKWRAP", "SIMPLE_DEFORM", "SMOOTH",
    "SURFACE_DEFORM", "WARP",
}  # fmt: skip
_POSE = ("location", "rotation_euler", "rotation_quaternion", "rotation_axis_angle", "scale")
_AT_REST = {
    "location": (0.0,) * 3,
    "rotation_euler": (0.0,) * 3,
    "rotation_quaternion": (1.0, 0.0, 0.0, 0.0),
    "rotation_axis_angle": (0.0, 0.0, 1.0, 0.0),
    "scale": (1.0,) * 3,
}


class Bench:
    """A face `ob` on the armatures `rigs`; `vertices` `[P]` are the points to read."""

    def __init__(self, ob, rigs: list, vertices: np.ndarray):
        self._ob, self._rigs, self._vertices = ob, rigs, vertices

    @contextmanager
    def at_rest(self, controls=()):
        """Puts every bone at rest and leaves only deforming modifiers on; restores all afterwards.

        The caller may set `controls` meanwhile; they are restored too.
        """
        before = [(control, control.read()) for control in controls]
        posed = [_posed(bone) for rig in self._rigs for bone in rig.pose.bones
                 if not control_kinds.at_rest(bone)]  # fmt: skip
        shown = [(modifier, "show_viewport", False) for modifier in self._ob.modifiers
                 if modifier.show_viewport and modifier.type not in _DEFORMING]  # fmt: skip
        shown += [(rig.data, "pose_position", "POSE") for rig in self._rigs
                  if rig.data.pose_position != "POSE"]  # fmt: skip
        was = [(block, name, getattr(block, name)) for block, name, _ in shown]
        try:
            for bone, _ in posed:
                _pose(bone, _AT_REST)
            for block, name, value in shown:
                setattr(block, name, value)
            yield self
        finally:
            for control, values in before:
                control.write(values)
            for bone, values in posed:
                _pose(bone, values)
            for block, name, value in was:
                setattr(block, name, value)

    def at_zero(self, controls=()) -> np.ndarray:
        """The points `[P, 3]` with all bones and `controls` at rest."""
        with self.at_rest(controls):
            for control in controls:
                control.set([0.0] * len(control.indices))
            return self.read()

    def read(self) -> np.ndarray:
        """The present positions of the points, `[P, 3]` in object space.

        Raises `AnyfaceError("mesh")` where the evaluated mesh has another number of vertices.
        """
        bpy.context.view_layer.update()
        mesh = self._ob.evaluated_get(bpy.context.evaluated_depsgraph_get()).data
        if len(mesh.vertices) != len(self._ob.data.vertices):
            raise AnyfaceError(
                "mesh",
                f"{self._ob.name} has other vertices once it is evaluated, by geometry of its keys "
                "or of a modifier that is driven: turn that off first",
            )
        flat = np.empty(len(mesh.vertices) * 3, dtype=np.float32)
        mesh.attributes["position"].data.foreach_get("vector", flat)
        return flat.reshape(-1, 3)[self._vertices].astype(np.float64)


def check(ob) -> None:
    """Raises `AnyfaceError("mesh")` where `ob` is in edit mode or hidden.

    In these states the rig does not move the evaluated mesh.
    """
    if ob.mode == "EDIT":
        raise AnyfaceError("mesh", f"{ob.name} is in edit mode: leave it, so that its rig moves it")
    if ob.name not in bpy.context.view_layer.objects or not ob.visible_get():
        raise AnyfaceError("mesh", f"{ob.name} is hidden: show it, so that its rig can be tried")


def _posed(bone) -> tuple:
    return bone, {name: tuple(getattr(bone, name)) for name in _POSE}


def _pose(bone, values: dict) -> None:
    for name, value in values.items():
        setattr(bone, name, value)
