"""The settings of a character's output; `Object.anyface_output`."""

from bpy.props import (
    BoolProperty,
    CollectionProperty,
    EnumProperty,
    FloatProperty,
    IntProperty,
    StringProperty,
)
from bpy.types import PropertyGroup

from ..core import shapes
from ..core.key_names import Pair
from ..scene.outputs import OutputSettings
from ..scene.shape_keys import record
from ..scene.takes import adjust
from . import controls

_SHAPES = [(name, name, "", at) for at, name in enumerate((*shapes.ARKIT, *shapes.VISEMES))]


class AnyfaceMapping(PropertyGroup):
    """One row of the mapping list: a shape and a key that shows it."""

    shape: EnumProperty(
        name="Shape", description="An ARKit shape or a viseme", items=_SHAPES, options=set()
    )
    key: StringProperty(name="Key", description="The shape key of this mesh", options=set())
    factor: FloatProperty(
        name="Share",
        description="Value of the key when the shape is at 1; several shapes on one key add up",
        default=1.0,
        min=0.0,
        soft_max=1.0,
        max=4.0,
        options=set(),
    )


# The sliders have no values of their own: they read and change the finished take.
def _slider(name: str, label: str, words: str, unmoved: float = 1.0, **limits):
    def read_take(stored) -> float:
        ob = stored.id_data
        if not record.is_generated(ob):
            return unmoved
        return record.read(ob.data.shape_keys).adjusted.get(name, unmoved)

    def change_take(stored, value: float) -> None:
        adjust.adjust(stored.id_data, **{name: value})

    text = f"{words} of the finished take, at once"
    bounds = limits or {"min": 0.01, "soft_max": 2.0, "max": 5.0}
    return FloatProperty(
        name=label, description=text, get=read_take, set=change_take, options=set(), **bounds
    )


class AnyfaceOutput(PropertyGroup):
    """Settings of the output."""

    cache_folder: StringProperty(
        name="Folder",
        description="Folder of the cache; empty uses anyface_cache beside the .blend",
        subtype="DIR_PATH",
        options=set(),
    )
    csv_file: StringProperty(
        name="Table",
        description="Path of the CSV file; empty uses the object's name, beside the .blend",
        subtype="FILE_PATH",
        options=set(),
    )
    visemes: BoolProperty(
        name="Visemes", description="Make the 15 Oculus visemes as well", options=set()
    )
    new_take: BoolProperty(
        name="As New Take",
        description="Keep the earlier take beside the new one; off replaces it",
        options=set(),
    )
    strength: _slider("strength", "Strength", "Scales all motion")
    shift: _slider("shift", "Shift", "Moves the frames", 0.0, soft_min=-24.0, soft_max=24.0)
    articulation: _slider(
        "articulation", "Articulation", "Scales what speech does to mouth and jaw", min=0.0, max=2.0
    )
    emotion: _slider(
        "emotion", "Emotion", "Scales how strongly the emotion shows", min=0.0, max=1.5
    )
    closing: _slider("blinks", "Blinks", "Scales how far the eyes close", min=0.0, max=1.0)
    mouth: _slider("mouth", "Mouth", "Scales jaw and mouth")
    blinks: _slider("blinks", "Blinks", "Scales the blinks")
    brows: _slider("brows", "Brows", "Scales the brows")
    mapping: CollectionProperty(type=AnyfaceMapping, options=set())
    mapping_index: IntProperty(options=set())


def slider_of(ob, name: str) -> str:
    """The property whose slider changes `name`, one of `adjust.names_of`.

    Blinks of named shapes can be scaled freely. Blinks of basis keys stop at closed eyes.
    """
    return "closing" if name == "blinks" and not adjust.is_named(ob) else name


def read(ob) -> OutputSettings:
    """The settings of `ob` as plain data."""
    stored = ob.anyface_output
    mapping = [Pair(row.shape, row.key, row.factor) for row in stored.mapping if row.key]
    settings = OutputSettings(
        cache_folder=stored.cache_folder,
        csv_file=stored.csv_file,
        visemes=stored.visemes,
        new_take=stored.new_take,
        mapping=mapping,
    )
    controls.fill(settings, ob)
    return settings


GROUPS = (AnyfaceMapping, AnyfaceOutput)
