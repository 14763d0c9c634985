"""Life: how strongly head, gaze, blinks and breath move, and which objects they turn."""

from bpy.props import BoolProperty, EnumProperty, PointerProperty, StringProperty
from bpy.types import Object, Operator, Panel, PropertyGroup

from ..core import systems
from ..scene.life import turns
from ..scene.life.settings import CONTROLS, LifeSettings
from .operators import Acting
from .panel import OfFacePanel
from .target import is_there, target

_HEADS = [
    ("NONE", "Nothing", "The head does not turn", 0),
    ("OBJECT", "Object", "An empty or another object turns about its origin", 1),
    ("BONE", "Bone", "A bone of an armature turns", 2),
    ("OWN", "Action", "An action of its own that no object plays yet", 3),
]
_GAZES = [
    ("NONE", "Nothing", "The eyes do not turn; lids follow the gaze all the same", 0),
    ("PARTS", "Eyeballs", "Eyeballs that are objects: parts with the role gaze, or those below", 1),
    ("BONES", "Bones", "Two bones of an armature turn", 2),
]


def _of(kind: str):
    return lambda _self, ob: ob.type == kind


class AnyfaceLife(PropertyGroup):
    """`Object.anyface_life_settings`: which objects turn as the head and the eyes."""

    use: BoolProperty(
        name="Life",
        description="Head, gaze, blinks, breath and variety; off leaves out all of them",
        default=True,
        options=set(),
    )
    head: EnumProperty(name="Head Turns", items=_HEADS, default="NONE", options=set())
    head_object: PointerProperty(
        name="Object",
        description="Object that turns with the head, about its own origin",
        type=Object,
    )
    head_armature: PointerProperty(name="Armature", type=Object, poll=_of("ARMATURE"))
    head_bone: StringProperty(name="Bone", description="The bone of the head", options=set())
    gaze: EnumProperty(name="Eyes Turn", items=_GAZES, default="PARTS", options=set())
    eye_right: PointerProperty(
        name="Right Eye", description="Empty uses the parts with the role gaze", type=Object
    )
    eye_left: PointerProperty(
        name="Left Eye", description="Empty uses the parts with the role gaze", type=Object
    )
    eye_armature: PointerProperty(name="Armature", type=Object, poll=_of("ARMATURE"))
    eye_bone_right: StringProperty(name="Right Eye", options=set())
    eye_bone_left: StringProperty(name="Left Eye", options=set())
    look_at: PointerProperty(
        name="Look At",
        description="The eyes follow this object, instead of a partner straight ahead",
        type=Object,
    )


def read(ob) -> LifeSettings:
    """The settings of `ob` as plain data; a deleted object counts as none."""
    stored = ob.anyface_life_settings
    of_bone = stored.head == "BONE"
    return LifeSettings(
        use=stored.use,
        head=stored.head,
        head_object=_name(stored.head_armature if of_bone else stored.head_object),
        head_bone=stored.head_bone,
        gaze=stored.gaze,
        eyes=(_name(stored.eye_right), _name(stored.eye_left)),
        eye_armature=_name(stored.eye_armature),
        eye_bones=(stored.eye_bone_right, stored.eye_bone_left),
        look_at=_name(stored.look_at),
    )


def _name(ob) -> str:
    return ob.name if is_there(ob) else ""


class ANYFACE_PT_life(OfFacePanel, Panel):
    """Motion beside that of the mouth."""

    bl_label = "Life"
    bl_order = 2
    bl_options = {"DEFAULT_CLOSED"}

    def draw_header(self, context):
        """Draws the switch."""
        self.layout.prop(target(context).anyface_life_settings, "use", text="")

    def draw(self, context):
        """Draws the strengths, and the choice of the objects that turn."""
        layout, ob = self.layout, target(context)
        stored = ob.anyface_life_settings
        layout.use_property_split = True
        layout.active = stored.use
        column = layout.column(align=True)
        for control in systems.by_name(getattr(ob.anyface, "system", "")).controls:
            if control.name in CONTROLS:
                row = column.row(align=True)
                row.use_property_decorate = control.is_animatable
                row.prop(ob.anyface, control.name, slider=True)
        layout.use_property_decorate = False
        _draw_head(layout.column(align=True), stored)
        _draw_gaze(layout.column(align=True), stored)
        layout.operator("anyface.life_release", icon="X")


def _draw_head(column, stored) -> None:
    column.prop(stored, "head")
    if stored.head == "OBJECT":
        column.prop(stored, "head_object")
    elif stored.head == "BONE":
        column.prop(stored, "head_armature")
        _draw_bone(column, stored, "head_bone", stored.head_armature)


def _draw_gaze(column, stored) -> None:
    column.prop(stored, "gaze")
    if stored.gaze == "PARTS":
        column.prop(stored, "eye_right")
        column.prop(stored, "eye_left")
    elif stored.gaze == "BONES":
        column.prop(stored, "eye_armature")
        _draw_bone(column, stored, "eye_bone_right", stored.eye_armature)
        _draw_bone(column, stored, "eye_bone_left", stored.eye_armature)
    if stored.gaze != "NONE":
        column.prop(stored, "look_at")


def _draw_bone(column, stored, name: str, armature) -> None:
    if is_there(armature) and armature.type == "ARMATURE":
        column.prop_search(stored, name, armature.data, "bones")


class ANYFACE_OT_life_release(Acting, Operator):
    """Stop turning head and eyes; the take on the face stays"""

    bl_idname = "anyface.life_release"
    bl_label = "Release Head and Eyes"

    def act(self, ob):
        """Removes everything that the playing take has put on other objects."""
        turns.release(ob)


GROUPS = (AnyfaceLife,)
