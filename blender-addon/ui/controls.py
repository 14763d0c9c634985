"""The rig and the list of its face controls, for the output *Rig Controls*."""

from bpy.props import (
    BoolProperty,
    CollectionProperty,
    EnumProperty,
    IntProperty,
    PointerProperty,
    StringProperty,
)
from bpy.types import Object, PropertyGroup, UIList

from ..scene.outputs.controls import ControlRow
from ..scene.rig_controls import control_sources
from .target import is_there

_KINDS = [(kind, kind.capitalize(), "") for kind in (control_sources.BONE, control_sources.NUMBER)]


class AnyfaceControl(PropertyGroup):
    """A bone or a number that moves the face."""

    use: BoolProperty(
        name="Use", description="Anyface may move this control", default=True, options=set()
    )
    kind: EnumProperty(items=_KINDS, options=set())
    id_type: StringProperty(options=set())
    block: StringProperty(options=set())
    # The bone's name, or the number's data path.
    path: StringProperty(options=set())
    sided: BoolProperty(options=set())


class AnyfaceControls(PropertyGroup):
    """`Object.anyface_controls`: the rig and the controls that move the face."""

    rig: PointerProperty(
        name="Rig",
        description="The armature whose bones move the face; empty uses the armature of the mesh",
        type=Object,
        poll=lambda _self, ob: ob.type == "ARMATURE",
    )
    rows: CollectionProperty(type=AnyfaceControl, options=set())
    index: IntProperty(options=set())


def fill(output, ob) -> None:
    """Copies the rig and its list into plain settings. Bones of head and eyes stay unused."""
    stored, turned = ob.anyface_controls, ob.anyface_life_settings
    output.rig = stored.rig.name if is_there(stored.rig) else ""
    output.controls = [_plain(row) for row in stored.rows if row.use]
    if turned.use and turned.head == "BONE":
        output.left_alone.append(turned.head_bone)
    if turned.use and turned.gaze == "BONES":
        output.left_alone += [turned.eye_bone_right, turned.eye_bone_left]


def _plain(row) -> ControlRow:
    return ControlRow(row.kind, row.id_type, row.block, row.path, row.sided)


class ANYFACE_UL_controls(UIList):
    """A bone or a number, and whether it is used."""

    def draw_item(self, _context, layout, _data, item, _icon, _active, _name):
        """Draws one row."""
        layout.use_property_split = False
        layout.prop(item, "use", text="")
        icon = "BONE_DATA" if item.kind == control_sources.BONE else "DRIVER"
        layout.label(text=item.name, icon=icon)


GROUPS = (AnyfaceControl, AnyfaceControls)
