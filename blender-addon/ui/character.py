"""Character: the landmarks of the face, and the objects that belong to it."""

import bpy
from bpy.props import (
    BoolProperty,
    CollectionProperty,
    EnumProperty,
    IntProperty,
    PointerProperty,
    StringProperty,
)
from bpy.types import Object, Operator, Panel, PropertyGroup, UIList

from ..core import wording
from ..core.errors import AnyfaceError
from ..core.take import ROLES
from ..scene import identity
from ..scene.face import landmarks, opening, pieces
from . import words
from .operators import Acting
from .panel import OfFacePanel
from .target import is_there, target

_ROLE_TEXTS = {
    "skin": "The face itself",
    "jaw": "Follows the lower jaw: lower teeth, tongue",
    "skull": "Follows the skull: upper teeth, glasses, hair",
    "mouth": "Holds both jaws: gums with a tongue, the mouth's lining",
    "nearest": "Follows the skin nearest to it: lashes, brows, beards",
    "gaze": "An eyeball; rests and never deforms",
    "still": "Nothing of the face; rests",
}
_ROLE_ITEMS = [("AUTO", "By Shape", "Guessed from shape and place", 0)]
_ROLE_ITEMS += [(n, n.capitalize(), _ROLE_TEXTS[n], k + 1) for k, n in enumerate(ROLES)]


class AnyfacePart(PropertyGroup):
    """An object beside the face."""

    object: PointerProperty(type=Object)
    role: EnumProperty(name="Role", items=_ROLE_ITEMS, default="AUTO", options=set())


class AnyfaceLoose(PropertyGroup):
    """A connected part of the face mesh; `found` is the role that the library gave it."""

    number: IntProperty()
    vertices: IntProperty()
    found: StringProperty()
    role: EnumProperty(name="Role", items=_ROLE_ITEMS, default="AUTO", options=set())


class AnyfaceFace(PropertyGroup):
    """`Object.anyface_face`: the objects and connected parts that belong to the face."""

    parts: CollectionProperty(type=AnyfacePart)
    part_index: IntProperty(options=set())
    # True once parts were searched for or chosen. From then on only the artist changes the list.
    looked: BoolProperty(options={"HIDDEN"})
    loose: CollectionProperty(type=AnyfaceLoose)
    loose_index: IntProperty(options=set())


def fill(settings, ob) -> None:
    """Copies the parts of `ob` into plain settings, except parts whose object was deleted."""
    chosen = [part for part in ob.anyface_face.parts if is_there(part.object)]
    settings.parts = [pieces.Part(part.object.name, _role(part)) for part in chosen]
    with_role = [part for part in ob.anyface_face.loose if part.role != "AUTO"]
    settings.loose = {part.number: part.role for part in with_role}


def _role(part) -> str:
    return "" if part.role == "AUTO" else part.role


def list_loose(ob, face_points) -> None:
    """Lists the connected parts of the face mesh; chosen roles stay."""
    chosen = {part.number: part.role for part in ob.anyface_face.loose if part.role != "AUTO"}
    part_of_vertex = face_points.part_of_vertex[: len(ob.data.vertices)]
    ob.anyface_face.loose.clear()
    for number, role in enumerate(face_points.part_roles):
        count = int((part_of_vertex == number).sum())
        if count == 0:
            continue
        row = ob.anyface_face.loose.add()
        row.name, row.number, row.vertices = f"Part {number}", number, count
        row.found, row.role = ROLES[role], chosen.get(number, "AUTO")


class ANYFACE_UL_parts(UIList):
    """Objects beside the face."""

    def draw_item(self, _context, layout, _data, item, _icon, _active, _name):
        """Draws one object and its role."""
        name = item.object.name if is_there(item.object) else f"{item.name} (deleted)"
        split = layout.split(factor=0.6)
        split.label(text=name, icon="MESH_DATA")
        split.prop(item, "role", text="")


class ANYFACE_UL_loose(UIList):
    """Connected parts of the face mesh."""

    def draw_item(self, _context, layout, _data, item, _icon, _active, _name):
        """Draws one part and its role."""
        layout.label(text=f"{item.number}: {item.found}, {item.vertices:,} vertices")
        layout.prop(item, "role", text="")


class ANYFACE_OT_find_parts(Acting, Operator):
    """Look for teeth, eyes and lashes that are objects beside the face"""

    bl_idname = "anyface.find_parts"
    bl_label = "Find Parts"

    def act(self, ob):
        """Adds meshes near the head that belong to the same collections or parent."""
        fresh = _add_new(ob, suggestions(ob))
        return f"parts found: {', '.join(fresh) or 'none'}"


class ANYFACE_OT_add_parts(Acting, Operator):
    """Add the selected meshes to the face as parts"""

    bl_idname = "anyface.add_parts"
    bl_label = "Add Selected"

    def act(self, ob):
        """Adds every selected mesh that is not in the list."""
        known = {part.object for part in ob.anyface_face.parts} | {ob}
        picked = [other for other in bpy.context.selected_objects if other.type == "MESH"]
        fresh = [other for other in picked if other not in known and other.data != ob.data]
        if not fresh:
            raise AnyfaceError("input", "select the meshes of teeth, eyes or lashes first")
        for other in fresh:
            _add(ob, other, pieces.role_of_name(other.name))


class ANYFACE_OT_drop_part(Acting, Operator):
    """Remove the part from the face; the object itself stays"""

    bl_idname = "anyface.drop_part"
    bl_label = "Remove Part"

    def act(self, ob):
        """Removes the active row of the list."""
        face = ob.anyface_face
        if not 0 <= face.part_index < len(face.parts):
            raise AnyfaceError("input", "choose a part in the list first")
        face.parts.remove(face.part_index)
        face.looked = True
        face.part_index = max(0, min(face.part_index, len(face.parts) - 1))


def take_along(ob) -> list[str]:
    """Adds teeth, tongue and lashes if nobody has chosen parts yet; returns their names."""
    if ob.anyface_face.looked or len(ob.anyface_face.parts) or ob.library is not None:
        return []
    return _add_new(ob, [part for part in suggestions(ob) if _moves(part, ob)])


def told(along: list[str]) -> list[str]:
    """What a report says of the parts that `take_along` has added."""
    return [f"together with {wording.listed(along)}"] if along else []


def _add_new(ob, parts: list[pieces.Part]) -> list[str]:
    known = {part.object for part in ob.anyface_face.parts}
    fresh = [part for part in parts if bpy.data.objects[part.name] not in known]
    for part in fresh:
        _add(ob, bpy.data.objects[part.name], part.role)
    ob.anyface_face.looked = True
    return [part.name for part in fresh]


def _add(ob, other, role: str) -> None:
    ob.anyface_face.looked = True
    part = ob.anyface_face.parts.add()
    part.object, part.name, part.role = other, other.name, role or "AUTO"


def suggestions(ob) -> list:
    """Meshes near the head that are its children or have the same parent or collection."""
    near = set(ob.children_recursive)
    near |= set(ob.parent.children_recursive) if ob.parent is not None else set()
    for collection in ob.users_collection:
        near |= set(collection.objects)
    centre, radius = landmarks.head(ob)
    parts = pieces.suggest(ob, sorted(near, key=lambda other: other.name), centre, radius)
    owners = [identity.face_of(bpy.data.objects[part.name]) for part in parts]
    return [part for part, owner in zip(parts, owners, strict=True) if owner in (None, ob)]


def left_behind(ob) -> str:
    """Names the teeth, tongues and lashes that did not move as the face has no parts; or ""."""
    if len(ob.anyface_face.parts):
        return ""
    names = [part.name for part in suggestions(ob) if _moves(part, ob)]
    if not names:
        return ""
    return f"{', '.join(names)} did not move along: Find Parts adds them"


def _moves(part, ob) -> bool:
    """Whether a part moves with the lips or lids, as far as its name tells, or else its place."""
    if part.role or "teeth" in part.name.lower():
        return part.role in ("jaw", "nearest", "")
    return pieces.is_inside(bpy.data.objects[part.name], ob)


class ANYFACE_PT_character(OfFacePanel, Panel):
    """The face, its landmarks, its parts."""

    bl_label = "Character"
    bl_order = 0

    def draw(self, context):
        """Draws status, buttons and lists."""
        layout, ob = self.layout, target(context)
        layout.use_property_split, layout.use_property_decorate = True, False
        _draw_status(layout, ob, context.region.width)
        column = layout.column(align=True)
        column.operator("anyface.find_face", icon="VIEWZOOM")
        column.operator("anyface.place_points", icon="PIVOT_CURSOR")
        if opening.is_welded(ob):
            layout.operator("anyface.open_mouth", icon="MOD_BOOLEAN")
        if opening.has_joined_eyes(ob):
            layout.operator("anyface.open_eyes", icon="HIDE_OFF")
        layout.operator("anyface.head_like", icon="USER")
        layout.operator_menu_enum("anyface.expression_keys", "by", icon="SHAPEKEY_DATA")
        row = layout.row(align=True)
        row.operator("anyface.edit_landmarks", icon="EDITMODE_HLT")
        row.operator("anyface.reset_landmarks", text="", icon="LOOP_BACK")
        layout.prop(context.window_manager, "anyface_show_landmarks")
        _draw_parts(layout, ob)


def status(ob) -> tuple[str, str]:
    """The state of the face in words, and an icon."""
    try:
        stored = landmarks.load(ob)
    except AnyfaceError as error:
        return str(error), "ERROR"
    if stored is None:
        return "The face is found when needed", "INFO"
    return landmarks.describe(stored), "ERROR" if stored.doubtful else "CHECKMARK"


def _draw_status(layout, ob, width: int) -> None:
    text, icon = status(ob)
    column = layout.column(align=True)
    column.scale_y = 0.8
    words.draw(column, text, width, icon)


def _draw_parts(layout, ob) -> None:
    face = ob.anyface_face
    header, body = layout.panel("anyface_parts", default_closed=True)
    header.label(text=f"Parts ({len(face.parts)} objects)")
    if body is None:
        return
    row = body.row()
    row.template_list("ANYFACE_UL_parts", "", face, "parts", face, "part_index", rows=3)
    buttons = row.column(align=True)
    buttons.operator("anyface.add_parts", text="", icon="ADD")
    buttons.operator("anyface.drop_part", text="", icon="REMOVE")
    body.operator("anyface.find_parts", icon="VIEWZOOM")
    if len(face.loose) > 1:
        body.label(text="Loose parts of the mesh itself:")
        body.template_list("ANYFACE_UL_loose", "", face, "loose", face, "loose_index", rows=3)


GROUPS = (AnyfacePart, AnyfaceLoose, AnyfaceFace)
