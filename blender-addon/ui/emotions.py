"""*Emotion* under *More*: mixtures, pictures of emotions on this face, and the heard emotion."""

import tempfile
from pathlib import Path

from bpy.types import Operator, Panel

from ..core.portraits import Portraits
from ..scene import bake
from . import audio, emotion_plot, pictures, preferences, running
from .operators import InThread, redraw
from .panel import OfFacePanel
from .settings import from_object
from .target import target

# Heights of the chosen picture and of the pictures in its menu, in lines of the panel.
_LINES, _LINES_EACH = 6.0, 5.0
_FOLDER = "emotions"


class ANYFACE_PT_emotion(OfFacePanel, Panel):
    """Shows the emotion of the face in words and pictures."""

    bl_label = "Emotion"
    bl_order = 1
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context):
        """Draws mixtures, pictures to choose from, and the emotion that was heard."""
        layout, ob = self.layout, target(context)
        layout.menu("ANYFACE_MT_mixtures")
        layout.operator("anyface.draw_emotions", icon="USER")
        shown = pictures.of(ob)
        if shown is not None:
            sizes = {"scale": _LINES, "scale_popup": _LINES_EACH}
            layout.template_icon_view(ob.anyface, "emotion_face", show_labels=True, **sizes)
            layout.label(text=f"{ob.anyface.emotion.capitalize()}, at {shown.intensity:.2f}")
        audio.draw_recordings(layout, ob)
        emotion_plot.draw(layout, ob)


class ANYFACE_OT_draw_emotions(InThread, Operator):
    """Draw every emotion on this face at the intensity of the panel, to choose from"""

    bl_idname = "anyface.draw_emotions"
    bl_label = "Draw Emotions"
    # Nothing in the file changes, so there is nothing to undo.
    bl_options = {"REGISTER"}

    busy = "Another face is being animated"
    goes_back = False

    def instead(self, context):
        """Shows earlier pictures if they still fit; then no job is needed."""
        ob = target(context)
        self._portraits = _portraits(ob)
        if self._portraits.are_drawn:
            self.tell(self.finish(ob, self._portraits, self._portraits.folder))
            redraw(context)
            return True
        return False

    def read(self, context, ob):
        """Returns the face and the intensity, which `instead` has read."""
        return self._portraits

    def finish(self, ob, portraits, folder):
        """Shows the pictures."""
        pictures.show(ob, folder, portraits.intensity)
        return f"emotions of {ob.name} drawn: choose one under More, Emotion"


def _portraits(ob) -> Portraits:
    settings = from_object(ob)
    cache = preferences.cache_folder() or Path(tempfile.gettempdir()) / "anyface"
    return Portraits(
        face=bake.read_face(ob, settings, editable=False),
        intensity=settings.intensity,
        system=settings.system,
        controls=settings.controls,
        cache=cache / _FOLDER,
        engine=running.engine(settings.system),
    )
