"""Open Mouth and Open Eyes: cut lips apart, or lids from eyes, where they are one surface."""

from bpy.types import Operator

from ..scene.face import landmarks, mesh, opening
from ..scene.shape_keys import guard
from . import running
from .operators import InThread
from .settings import from_object
from .target import target


class Open(InThread):
    """Cuts a face open.

    `feature` names the part to cut, and `is_closed` tells whether there is anything to cut.
    """

    feature = ""
    refusal = ""
    cancelled = ""

    @staticmethod
    def is_closed(ob) -> bool:
        """Whether the feature of `ob` is one surface."""
        raise NotImplementedError

    @classmethod
    def why_not(cls, context):
        reason = super().why_not(context)
        if reason or cls.is_closed(target(context)):
            return reason
        return cls.refusal

    def read(self, context, ob):
        """Reads the mesh and its landmarks."""
        guard.check_local(ob)
        settings = from_object(ob)
        face = mesh.read_face(ob, settings.landmark_file)
        face.axes = settings.axes
        engine = running.engine(settings.system)
        return opening.Opening(face, engine, landmarks.load(ob), self.feature)

    def finish(self, ob, opened_of, opened):
        """Changes the mesh."""
        return opening.write(ob, opened_of, opened)


class ANYFACE_OT_open_mouth(Open, Operator):
    """Part lips that are one surface and sew the inside of a mouth behind them"""

    bl_idname = "anyface.open_mouth"
    bl_label = "Open Mouth"

    feature = "mouth"
    is_closed = staticmethod(opening.is_welded)
    refusal = "This parts lips that are one surface; Find Face and Generate see whether they are"


class ANYFACE_OT_open_eyes(Open, Operator):
    """Cut free eyes that are one surface with their lids, so that they can blink"""

    bl_idname = "anyface.open_eyes"
    bl_label = "Open Eyes"

    feature = "eyes"
    is_closed = staticmethod(opening.has_joined_eyes)
    refusal = (
        "This cuts free eyes that are one surface with their lids; Find Face and Generate see "
        "whether they are"
    )
