"""What was heard as strips to be mended, and *Redo* for a stretch of the take."""

import bpy
from bpy.props import StringProperty
from bpy.types import Operator, Panel

from ..core.errors import AnyfaceError
from ..core.job import at_once
from ..scene import bake
from ..scene.sound import decode, sounds
from ..scene.takes import redo
from . import audio, running, texts, words
from .operators import Alone, InThread
from .panel import OfFacePanel
from .settings import from_object
from .target import sequencer_scene, target


class ANYFACE_PT_sounds(OfFacePanel, Panel):
    """Sounds that can be mended."""

    bl_idname = "ANYFACE_PT_sounds"
    bl_label = "Mend"
    bl_order = 5
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context):
        """Draws the buttons, and which frames are meant."""
        layout = self.layout
        row = layout.row(align=True)
        row.operator("anyface.sounds_show", icon="SEQ_SEQUENCER")
        row.operator("anyface.sounds_read", text="", icon="IMPORT")
        row.operator("anyface.sounds_write", text="", icon="EXPORT")
        layout.prop(context.scene.anyface, "text")
        layout.operator("anyface.redo", icon="FILE_REFRESH")
        try:
            first, last = redo.between(sequencer_scene(context))
            layout.label(text=f"Between frames {first:g} and {last:g}")
        except AnyfaceError:
            text = "Where words moved, between two markers, or in the preview range"
            words.draw(layout.column(align=True), text, context.region.width)


class WithSound(Alone):
    """Works on the sound that the character speaks."""

    @classmethod
    def poll(cls, context):
        """False, with the reason, without a face or a sound."""
        if not super().poll(context):
            return False
        reason = audio.why_not(target(context), sequencer_scene(context))
        if reason:
            cls.poll_message_set(reason)
        return not reason


class _Listening:
    """Decodes a sound and says where lips close in it, and where the words of its text are."""

    def __init__(self, source, engine, text):
        self.source, self._engine, self._text = source, engine, text

    def work(self, progress):
        """Intervals `[N, 2]`, seconds, and start, end and label of the words."""
        progress.check("sound")
        sound = self.source.load(decode.decoder(self._engine))
        if not self._text:
            return self._engine.listen(sound), []
        return self._engine.listen_to_words(sound, self._text)


class ANYFACE_OT_sounds_show(WithSound, InThread, Operator):
    """Show where lips close (p, b, m) as text strips: move, delete, copy, rename, then Redo. \
Above them stand the words of the text"""

    bl_idname = "anyface.sounds_show"
    bl_label = "Show Sounds"

    def read(self, context, ob):
        """The sound that the character speaks."""
        scene = sequencer_scene(context)
        settings = from_object(ob, scene)
        engine = running.engine(settings.system)
        self._scene = scene.name
        text = texts.of(ob, scene)
        return _Listening(bake.find_sound(scene, settings, engine), engine, text)

    def finish(self, ob, listening, heard):
        """Puts the strips."""
        closures, words = heard
        count = sounds.show(bpy.data.scenes[self._scene], listening.source, closures, words)
        said = f", {len(words)} words" if words else ""
        self.report({"INFO"}, f"Anyface: {count} times the lips close{said}")
        return {"FINISHED"}


class ANYFACE_OT_sounds_read(WithSound, Operator):
    """Show the sounds of a file: Praat, Rhubarb, Papagayo, Moho, or lines of start, end, phone"""

    bl_idname = "anyface.sounds_read"
    bl_label = "Read Sounds"

    filepath: StringProperty(subtype="FILE_PATH")
    filter_glob: StringProperty(
        default="*.TextGrid;*.tsv;*.json;*.pgo;*.dat;*.txt", options={"HIDDEN"}
    )

    def invoke(self, context, event):
        """Opens the file browser."""
        context.window_manager.fileselect_add(self)
        return {"RUNNING_MODAL"}

    def act(self, ob):
        """Puts the strips."""
        scene = sequencer_scene(bpy.context)
        settings = from_object(ob, scene)
        engine = running.engine(settings.system)
        source = bake.find_sound(scene, settings, engine)
        fps = scene.render.fps / scene.render.fps_base
        found = engine.read_sounds(bpy.path.abspath(self.filepath), fps)
        return f"{sounds.show(scene, source, found)} times the lips close"


class ANYFACE_OT_redo(WithSound, InThread, Operator):
    """Make the take anew between two markers, or in the preview range; the rest of it stays"""

    bl_idname = "anyface.redo"
    bl_label = "Redo"

    @classmethod
    def poll(cls, context):
        """False, with the reason, without a take that can be redone."""
        if not super().poll(context):
            return False
        reason = redo.why_not(target(context))
        if reason:
            cls.poll_message_set(reason[0].upper() + reason[1:])
        return not reason

    def read(self, context, ob):
        """The stretch, the keys of the take, the mesh and the sound."""
        scene = sequencer_scene(context)
        self._scene = scene.name
        settings = from_object(ob, scene)
        return redo.read(ob, scene, settings, running.engine(settings.system))

    def finish(self, ob, wanted, made):
        """Writes the new frames at once."""
        return at_once(self.land(ob, wanted, made))

    def land(self, ob, wanted, made):
        """Writes the new frames."""
        text = yield from redo.landing(ob, bpy.data.scenes[self._scene], wanted, made)
        ob.anyface.report, ob.anyface.report_is_error = text, False
        self.report({"INFO"}, f"Anyface: {text}")
        return {"FINISHED"}


CLASSES = (
    ANYFACE_OT_sounds_show,
    ANYFACE_OT_sounds_read,
    ANYFACE_OT_redo,
    ANYFACE_PT_sounds,
)
