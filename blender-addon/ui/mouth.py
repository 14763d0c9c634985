"""Open Mouth: lips that are one surface, parted."""

from bpy.types import Operator

from ..scene.face import landmarks, mesh, mouth
from ..scene.shape_keys import guard
from . import running
from .operators import InThread
from .settings import from_object
from .target import target


class ANYFACE_OT_open_mouth(InThread, Operator):
    """Part lips that are one surface and sew the inside of a mouth behind them"""

    bl_idname = "anyface.open_mouth"
    bl_label = "Open Mouth"

    cancelled = ""

    @classmethod
    def why_not(cls, context):
        reason = super().why_not(context)
        if reason or mouth.is_welded(target(context)):
            return reason
        return "This parts lips that are one surface; Find Face and Generate see whether they are"

    def read(self, context, ob):
        """The mesh and its landmarks."""
        guard.check_local(ob)
        settings = from_object(ob)
        face = mesh.read_face(ob, settings.landmark_file)
        face.axes = settings.axes
        return mouth.Opening(face, running.engine(settings.system), landmarks.load(ob))

    def finish(self, ob, opening, opened):
        """Changes the mesh."""
        return mouth.write(ob, opening, opened)
