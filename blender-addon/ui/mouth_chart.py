"""*Mouth Chart*: drawn mouths that change with the speech, and which drawing shows each."""

import bpy
from bpy.props import (
    CollectionProperty,
    EnumProperty,
    IntProperty,
    PointerProperty,
    StringProperty,
)
from bpy.types import Operator, Panel, PropertyGroup

from ..core import mouth_chart
from ..core.errors import AnyfaceError
from ..scene.mouth_chart import chart, entry, outputs
from ..scene.mouth_chart.outputs import KEYS, NUMBER, OBJECTS, PENCIL
from . import audio, running, words
from .operators import Acting, InThread
from .panel import OfMorePanel
from .settings import from_object
from .target import is_there, sequencer_scene, target

_KINDS = [
    (mouth_chart.RHUBARB, "Rhubarb", "Nine mouths: A to H and X, as Rhubarb Lip Sync has them", 0),
    (mouth_chart.PRESTON_BLAIR, "Preston Blair", "Ten mouths, as Papagayo has them", 1),
]
_OUTPUTS = [
    (KEYS, "Shape Keys", "A shape key for each mouth", 0),
    (OBJECTS, "Objects", "An object of a collection for each mouth; the others are hidden", 1),
    (NUMBER, "Number", "A custom property, or the data path of a number, has its index", 2),
    (PENCIL, "Grease Pencil", "A frame for each mouth, which a Time Offset modifier shows", 3),
]


def _find(stored, _context=None) -> None:
    """Lists the mouths again, each with the drawing whose name fits."""
    find(stored.id_data)


class AnyfaceDrawing(PropertyGroup):
    """A row of the list: `name` is the mouth, `drawing` names a shape key or an object."""

    drawing: StringProperty(
        name="Drawing", description="Shape key or object that shows this mouth", options=set()
    )
    number: IntProperty(
        name="Number", description="The frame or index that shows this mouth", options=set()
    )


class AnyfaceMouthChart(PropertyGroup):
    """`Object.anyface_mouth_chart`: which mouths are drawn, and what shows them."""

    kind: EnumProperty(name="Mouths", items=_KINDS, options=set(), update=_find)
    output: EnumProperty(name="Shown By", items=_OUTPUTS, options=set(), update=_find)
    on: IntProperty(
        name="Change Every",
        description="Mouths change only on every Nth frame; 2 puts poses on twos",
        default=1,
        min=1,
        soft_max=4,
        max=240,
        options=set(),
    )
    hold: IntProperty(
        name="Shortest Hold",
        description="The fewest frames for which a mouth is shown",
        default=2,
        min=1,
        soft_max=12,
        max=240,
        options=set(),
    )
    hold_closures: IntProperty(
        name="of Closed Lips",
        description="The fewest frames for p, b and m; 0 uses Shortest Hold",
        min=0,
        soft_max=12,
        max=240,
        options=set(),
    )
    hold_vowels: IntProperty(
        name="of Vowels",
        description="The fewest frames for open mouths; 0 uses Shortest Hold",
        min=0,
        soft_max=12,
        max=240,
        options=set(),
    )
    object: PointerProperty(
        name="Object",
        description="Object that has the drawn mouths; empty uses the face itself",
        type=bpy.types.Object,
        update=_find,
    )
    collection: PointerProperty(
        name="Collection",
        description="Collection whose objects are the drawn mouths",
        type=bpy.types.Collection,
        update=_find,
    )
    property: StringProperty(
        name="Property",
        description="Name of a custom property, or the data path of a number",
        default="mouth",
        options=set(),
    )
    drawings: CollectionProperty(type=AnyfaceDrawing, options=set())


GROUPS = (AnyfaceDrawing, AnyfaceMouthChart)


def speaker(context):
    """The object whose sound the chart shows: the face, or else the active object of any kind."""
    return target(context) or context.object


def drawings(ob) -> outputs.Drawings:
    """The settings of `ob` as `Drawings`."""
    stored = ob.anyface_mouth_chart
    rows = {row.name: row for row in stored.drawings}
    mouths = mouth_chart.MOUTHS[stored.kind]
    return outputs.Drawings(
        kind=stored.kind,
        output=stored.output,
        ob=stored.object if is_there(stored.object) else ob,
        collection=stored.collection,
        property=stored.property,
        names={mouth: rows[mouth].drawing for mouth in mouths if mouth in rows},
        numbers={m: rows[m].number if m in rows else n for n, m in enumerate(mouths, 1)},
    )


def find(ob) -> int:
    """Lists all mouths of the chart again, each with the drawing whose name fits.

    Chosen numbers stay. Returns how many mouths have a drawing.
    """
    chosen, stored = drawings(ob), ob.anyface_mouth_chart
    names = outputs.names_of(chosen)
    guessed = mouth_chart.guess(chosen.kind, names)
    if chosen.output == KEYS and names:
        guessed.setdefault(mouth_chart.rest(chosen.kind), names[0])
    stored.drawings.clear()
    for mouth, number in chosen.numbers.items():
        row = stored.drawings.add()
        row.name, row.number, row.drawing = mouth, number, guessed.get(mouth, "")
    return len(guessed)


class OfSpeaker(Acting):
    """Works on the object that speaks, a face or a drawing; a base before `Operator`."""

    @classmethod
    def why_not(cls, context):
        """The reason why it cannot work now, or ""."""
        ob = speaker(context)
        if ob is None:
            return "Click the object that speaks"
        if ob.library is not None:
            return "The object is linked: make it local first"
        return (running.is_running() and "Another job is running") or ""

    def face(self, context):
        """The object that speaks."""
        return speaker(context)


class ANYFACE_OT_mouth_chart_find(OfSpeaker, Operator):
    """List the mouths with the shape keys or objects of their names: A, mouth_B, MBP"""

    bl_idname = "anyface.mouth_chart_find"
    bl_label = "Find Drawings"

    def act(self, ob):
        """Fills the list."""
        count = find(ob)
        stored = ob.anyface_mouth_chart
        if stored.output in (NUMBER, PENCIL):
            return f"{len(stored.drawings)} mouths have a number each"
        return f"{count} of {len(stored.drawings)} mouths have a drawing"


class ANYFACE_OT_mouth_chart(OfSpeaker, InThread, Operator):
    """Animate the drawn mouths with the speech: constant keyframes choose the drawing. Keyframes \
of an earlier chart are replaced; yours are not touched"""

    bl_idname = "anyface.mouth_chart"
    bl_label = "Draw Mouth Chart"

    @classmethod
    def why_not(cls, context):
        reason = super().why_not(context)
        return reason or audio.why_not(speaker(context), sequencer_scene(context))

    def read(self, context, ob):
        """Reads the sound, the face, and the list of drawings."""
        scene = sequencer_scene(context)
        settings = from_object(ob, scene)
        if not ob.anyface_mouth_chart.drawings:
            find(ob)
        stored = ob.anyface_mouth_chart
        holds = chart.Holds(stored.on, stored.hold, stored.hold_closures, stored.hold_vowels)
        engine = running.engine(settings.system)
        return chart.read(ob, scene, settings, drawings(ob), holds, engine)

    def finish(self, ob, snapshot, drawn):
        """Writes the keyframes."""
        return chart.write(ob, snapshot, drawn)


class ANYFACE_OT_mouth_chart_remove(OfSpeaker, Operator):
    """Remove the keyframes of the mouth chart; everything that it moved goes back to its place"""

    bl_idname = "anyface.mouth_chart_remove"
    bl_label = "Remove Mouth Chart"

    def act(self, ob):
        """Removes the chart."""
        count = chart.remove(ob)
        if not count:
            raise AnyfaceError("input", f"{ob.name} has no mouth chart")
        return f"mouth chart removed from {count} object{'s' if count > 1 else ''}"


class ANYFACE_PT_mouth_chart(OfMorePanel, Panel):
    """Drawn mouths."""

    bl_label = "Mouth Chart"
    bl_order = 6
    bl_options = {"DEFAULT_CLOSED"}

    @classmethod
    def poll(cls, context):
        """False where nothing speaks, and while *More* is closed."""
        return super().poll(context) and speaker(context) is not None

    def draw(self, context):
        """Draws the choice of mouths, what shows them, and the buttons."""
        layout, ob = self.layout, speaker(context)
        layout.use_property_split, layout.use_property_decorate = True, False
        stored = ob.anyface_mouth_chart
        if target(context) is None:
            text = "The default head speaks for this drawing"
            words.draw(layout.column(align=True), text, context.region.width, "INFO")
            audio.draw(layout.column(), ob, sequencer_scene(context), context.region.width)
        layout.prop(stored, "kind")
        column = layout.column(align=True)
        for name in ("on", "hold", "hold_closures", "hold_vowels"):
            column.prop(stored, name)
        column = layout.column(align=True)
        column.prop(stored, "output")
        column.prop(stored, "collection" if stored.output == OBJECTS else "object")
        if stored.output == NUMBER:
            column.prop(stored, "property")
        _draw_list(layout.column(align=True), ob)
        layout.operator("anyface.mouth_chart_find", icon="VIEWZOOM")
        row = layout.row(align=True)
        row.operator("anyface.mouth_chart", icon="KEYFRAME_HLT")
        if entry.shown_by(ob):
            row.operator("anyface.mouth_chart_remove", text="", icon="X")


def _draw_list(column, ob) -> None:
    stored, chosen = ob.anyface_mouth_chart, drawings(ob)
    has_keys = chosen.output == KEYS and getattr(chosen.ob.data, "shape_keys", None) is not None
    for row in stored.drawings:
        if stored.output in (NUMBER, PENCIL):
            column.prop(row, "number", text=row.name)
        elif has_keys:
            keys = chosen.ob.data.shape_keys
            column.prop_search(row, "drawing", keys, "key_blocks", text=row.name)
        elif stored.output == OBJECTS and stored.collection is not None:
            shown = stored.collection, "all_objects"
            column.prop_search(row, "drawing", *shown, text=row.name)
