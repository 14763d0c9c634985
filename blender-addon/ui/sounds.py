"""Shows sounds as strips that the artist can correct, and redoes a stretch of the take."""

from functools import partial

import bpy
from bpy.props import StringProperty
from bpy.types import Operator, Panel

from ..core.errors import AnyfaceError
from ..core.job import Work, at_once
from ..scene import bake
from ..scene.sound import decode, sequencer, sounds
from ..scene.takes import redo
from . import running, texts, words
from .audio import WithSound
from .operators import InThread, WithFile
from .panel import OfFacePanel
from .settings import from_object
from .target import sequencer_scene, target


class ANYFACE_PT_sounds(OfFacePanel, Panel):
    """Corrects sounds."""

    bl_label = "Mend"
    bl_order = 5
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context):
        """Draws the buttons, and which frames Redo changes."""
        layout = self.layout
        row = layout.row(align=True)
        row.operator("anyface.sounds_show", icon="SEQ_SEQUENCER")
        row.operator("anyface.sounds_read", text="", icon="IMPORT")
        row.operator("anyface.sounds_write", text="", icon="EXPORT")
        layout.operator("anyface.redo", icon="FILE_REFRESH")
        try:
            first, last = redo.between(sequencer_scene(context))
            layout.label(text=f"Between frames {first:g} and {last:g}")
        except AnyfaceError:
            text = "Where words moved, between two markers, or in the preview range"
            words.draw(layout.column(align=True), text, context.region.width)


def _listen(source, engine, text: str, progress) -> tuple:
    """Where lips close, `[N, 2]` in seconds, and start, end and label of each word of `text`."""
    progress.check("sound")
    heard = source.load(decode.decoder(engine))
    return engine.listen_to_words(heard, text) if text else (engine.listen(heard), [])


def _show(scene, source, closures, words=()) -> str:
    """Adds the strips, and says how many."""
    was_used = scene.render.use_sequencer
    count = sounds.show(scene, source, closures, words)
    said = f", {len(words)} words" if words else ""
    times = "once" if count == 1 else f"{count} times"
    return sequencer.with_camera_kept(scene, was_used, f"The lips close {times}{said}")


class ANYFACE_OT_sounds_show(WithSound, InThread, Operator):
    """Show where the lips close (p, b, m) as text strips. Move, delete, copy or rename them, then \
use Redo Stretch. The words of the text are shown above"""

    bl_idname = "anyface.sounds_show"
    bl_label = "Show Sounds"

    def read(self, context, ob):
        """Reads the sound that the character speaks."""
        scene = sequencer_scene(context)
        settings = from_object(ob, scene)
        engine = running.engine(settings.system)
        self._scene = scene.name
        source = bake.find_sound(scene, settings, engine)
        return Work(partial(_listen, source, engine, texts.of(ob, scene)), source)

    def finish(self, ob, work, heard):
        """Adds the strips."""
        return _show(bpy.data.scenes[self._scene], work.about, *heard)


class ANYFACE_OT_sounds_read(WithSound, WithFile, Operator):
    """Show the sounds of a file: Praat, Rhubarb, Papagayo, Moho, times of text-to-speech, or \
lines of start, end, phone"""

    bl_idname = "anyface.sounds_read"
    bl_label = "Read Sounds"

    filter_glob: StringProperty(
        default="*.TextGrid;*.tsv;*.json;*.pgo;*.dat;*.txt;*.srt;*.vtt", options={"HIDDEN"}
    )

    def act(self, ob):
        """Adds the strips."""
        scene = sequencer_scene(bpy.context)
        settings = from_object(ob, scene)
        engine = running.engine(settings.system)
        source = bake.find_sound(scene, settings, engine)
        fps = scene.render.fps / scene.render.fps_base
        closures = engine.read_sounds(bpy.path.abspath(self.filepath), fps)
        return _show(scene, source, closures)


class ANYFACE_OT_redo(WithSound, InThread, Operator):
    """Redo the take between two markers, or in the preview range; the rest stays"""

    bl_idname = "anyface.redo"
    bl_label = "Redo Stretch"

    @classmethod
    def why_not(cls, context):
        reason = super().why_not(context) or redo.why_not(target(context))
        return reason[:1].upper() + reason[1:]

    def read(self, context, ob):
        """Reads the stretch, the keys of the take, the mesh and the sound."""
        scene = sequencer_scene(context)
        self._scene = scene.name
        settings = from_object(ob, scene)
        return redo.read(ob, scene, settings, running.engine(settings.system))

    def finish(self, ob, job, result):
        """Writes the new frames at once."""
        return at_once(self.land(ob, job, result))

    def land(self, ob, job, result):
        """Writes the new frames."""
        text = yield from redo.landing(ob, bpy.data.scenes[self._scene], job, result)
        ob.anyface.report, ob.anyface.report_is_error = text, False
        ob.anyface.report_details = ""
        return text
