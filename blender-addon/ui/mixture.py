"""Several emotions at once: the rows after the first one, and named mixtures."""

from bpy.props import EnumProperty, FloatProperty, IntProperty, StringProperty
from bpy.types import Menu, Operator, PropertyGroup

from ..core import emotion
from ..core.emotion import EMOTIONS, MAX_INTENSITY, MIXTURES
from ..core.errors import AnyfaceError
from ..scene import live
from ..scene.animation import curves, sliders
from ..scene.animation.emotion import WEIGHT_PATH, shares
from .operators import OnList

ITEMS = [(name, name.capitalize(), "", number) for number, name in enumerate(EMOTIONS)]
# The emotion takes this share of a line, its strength takes the rest.
_EMOTION_SHARE = 0.62
# A newly added emotion starts with this strength.
_ADDED = 0.5


class AnyfaceEmotion(PropertyGroup):
    """One emotion of a mixture, other than the first one."""

    emotion: EnumProperty(
        name="Emotion", items=ITEMS, default="happy", options=set(), update=live.feel
    )
    weight: FloatProperty(
        name="Weight",
        description="How strongly this emotion shows; 1 is a full expression, and all of them "
        f"together are at most {MAX_INTENSITY:g}. Can be animated",
        default=_ADDED,
        min=0.0,
        max=MAX_INTENSITY,
        subtype="FACTOR",
        update=live.feel,
    )


def text(settings) -> str:
    """The rows after the first emotion as text, such as "sad:0.6,upset:0.2"."""
    return emotion.write_shares(settings.mixture)


def fill(settings, text: str) -> None:
    """Replaces the rows after the first emotion by those in a text. Raises `AnyfaceError`."""
    _fill(settings, emotion.read_shares(text))


def _fill(settings, emotions: list[emotion.Share]) -> None:
    settings.mixture.clear()
    for share in emotions:
        row = settings.mixture.add()
        row.emotion, row.weight = share.emotion, share.weight


class ANYFACE_OT_emotion_add(OnList, Operator):
    """Let the face show one more emotion at the same time"""

    bl_idname = "anyface.emotion_add"
    bl_label = "Add Emotion"

    def act(self, ob):
        """Adds a row with an emotion that is not there yet."""
        stored = ob.anyface
        there = {share.emotion for share in shares(stored)}
        row = stored.mixture.add()
        row.emotion = next((name for name in EMOTIONS[1:] if name not in there), EMOTIONS[1])
        row.weight = _ADDED


class ANYFACE_OT_emotion_remove(OnList, Operator):
    """Remove this emotion from the mixture"""

    bl_idname = "anyface.emotion_remove"
    bl_label = "Remove Emotion"

    number: IntProperty(name="Row", default=0, min=0, options={"SKIP_SAVE"})

    def act(self, ob):
        """Removes the row; the other rows keep their keyframes."""
        rows = ob.anyface.mixture
        if self.number >= len(rows):
            raise AnyfaceError(
                "input", f"emotion: expected a row below {len(rows)}, got {self.number}"
            )
        _drop_curves(ob, self.number, len(rows))
        rows.remove(self.number)
        live.feel()


def _drop_curves(ob, number: int, count: int) -> None:
    """Removes the curve and driver of a row's weight; those of later rows move up by one."""
    animation = ob.animation_data
    bag = curves.channels(animation)
    for collection in (
        bag.fcurves if bag is not None else None,
        getattr(animation, "drivers", None),
    ):
        for row in range(number, count) if collection is not None else ():
            curve = collection.find("anyface." + WEIGHT_PATH.format(row))
            if curve is not None and row == number:
                collection.remove(curve)
            elif curve is not None:
                curve.data_path = "anyface." + WEIGHT_PATH.format(row - 1)


class ANYFACE_OT_emotion_mixture(OnList, Operator):
    """Set the emotions to this mixture"""

    bl_idname = "anyface.emotion_mixture"
    bl_label = "Mixture"

    name: StringProperty(name="Mixture", options={"SKIP_SAVE"})

    def act(self, ob):
        """Replaces all rows, the first one too; says so if keyframes or drivers still set them."""
        if self.name not in MIXTURES:
            known = ", ".join(MIXTURES)
            raise AnyfaceError("input", f"mixture: expected one of {known}, got {self.name!r}")
        first, *others = emotion.read_shares(MIXTURES[self.name])
        stored = ob.anyface
        stored.emotion_source = "GIVEN"
        stored.emotion, stored.intensity = first.emotion, first.weight
        _fill(stored, others)
        paths = [WEIGHT_PATH.format(number) for number in range(len(others))]
        if sliders.animated(ob, ("emotion", "intensity", *paths)):
            return f"{self.name}: keyframes and drivers of emotion and weights stay as they are"


class ANYFACE_MT_mixtures(Menu):
    """Emotions that are mixtures of others"""

    bl_label = "Mixtures"

    def draw(self, context):
        """Draws all of them."""
        for name in MIXTURES:
            self.layout.operator("anyface.emotion_mixture", text=name).name = name


def draw(line_of, settings) -> None:
    """Draws the emotions; `line_of(name)` adds a line with that name."""
    line = line_of("Emotion")
    _draw_row(line, settings, "intensity")
    line.operator("anyface.emotion_add", text="", icon="ADD")
    for number, row in enumerate(settings.mixture):
        line = line_of("")
        _draw_row(line, row, "weight")
        line.operator("anyface.emotion_remove", text="", icon="REMOVE").number = number
    together = emotion.total(shares(settings)) if settings.mixture else 0.0
    if together > MAX_INTENSITY + 1e-4:
        line_of("").label(text=f"{together:.2f} in sum, shown as {MAX_INTENSITY:g}", icon="INFO")


def _draw_row(line, row, strength: str) -> None:
    """Draws an emotion and its `strength`, the name of a property."""
    line.use_property_split = False
    both = line.split(factor=_EMOTION_SHARE, align=True)
    both.prop(row, "emotion", text="")
    slider = both.row(align=True)
    slider.active = row.emotion != EMOTIONS[0]
    slider.prop(row, strength, text="", slider=True)
