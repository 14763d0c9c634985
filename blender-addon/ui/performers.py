"""Performers: the artist learns them from a face or a recording, chooses and deletes them.

They lie in the folder of the preferences, or in the user folder that Blender gives the extension.
"""

from pathlib import Path

import bpy
from bpy.props import StringProperty
from bpy.types import Menu, Operator

from ..core import performers
from ..core.errors import AnyfaceError
from ..scene import performers as lessons
from . import preferences, running
from .audio import WithSound
from .operators import Acting, InThread, WithFile
from .settings import from_object
from .target import sequencer_scene, target


def everyone() -> list[Path]:
    """The files of all performers."""
    try:
        return performers.in_folder(preferences.performer_folder())
    except AnyfaceError:
        return []


def name_of(settings) -> str:
    """The name of the performer that speaks with `settings` (`Object.anyface`); "None" for none."""
    return Path(settings.performer).stem if settings.performer else "None"


class Learn(WithSound, InThread):
    """Asks for a name first, then learns in a thread."""

    # Another name in the panel of the last operation must not learn once more.
    bl_options = {"REGISTER"}
    cancelled = "cancelled: no performer was written"
    # Nothing but the chosen performer changes in the scene.
    goes_back = False
    _asks = False

    def ask(self, context):
        """Opens the question."""
        raise NotImplementedError

    def invoke(self, context, event):
        """Asks; Blender then calls `execute`."""
        if bpy.app.background:
            return self.execute(context)
        self._asks = True
        return self.ask(context)

    def execute(self, context):
        """Learns in a thread after a question, at once for scripts."""
        if self._asks:
            self._asks = False
            return InThread.invoke(self, context, None)
        return InThread.execute(self, context)

    def finish(self, ob, lesson, text):
        """The face speaks with the new performer from the next Generate on."""
        name = lesson.path.stem
        if ob.library is None:
            ob.anyface.performer = str(lesson.path)
            ob.anyface.report, ob.anyface.report_is_error = f"{name} {text}", False
        return f"{name} {text}"

    def _path(self) -> Path:
        name = performers.file_name(self.name)
        return preferences.performer_folder(create=True) / name


class ANYFACE_OT_performer_learn(Learn, Operator):
    """Learn how this face moves its mouth while its sound plays: from a take that you corrected \
by hand, or from keys of your own. Other sounds are then spoken that way"""

    bl_idname = "anyface.performer_learn"
    bl_label = "Learn Performer from Take"

    name: StringProperty(name="Name", description="Name of the performer", default="My Performer")

    def ask(self, context):
        """Asks for the name."""
        return context.window_manager.invoke_props_dialog(self)

    def read(self, context, ob):
        """Reads how the face moves."""
        scene = sequencer_scene(context)
        settings = from_object(ob, scene)
        engine = running.engine(settings.system)
        return lessons.read_face(ob, scene, settings, engine, self._path())


class ANYFACE_OT_performer_learn_file(Learn, WithFile, Operator):
    """Learn how a person speaks from a recording of Live Link Face that begins with the sound of \
this face. Other sounds are then spoken that way"""

    bl_idname = "anyface.performer_learn_file"
    bl_label = "Learn Performer from Live Link Face"

    name: StringProperty(
        name="Name", description="Name of the performer; empty takes that of the file"
    )
    filter_glob: StringProperty(default="*.csv", options={"HIDDEN"})

    def ask(self, context):
        """Opens the file browser."""
        context.window_manager.fileselect_add(self)
        return {"RUNNING_MODAL"}

    def read(self, context, ob):
        """Checks the file, and finds the sound."""
        scene = sequencer_scene(context)
        settings = from_object(ob, scene)
        self.name = self.name or self.path.stem
        engine = running.engine(settings.system)
        return lessons.read_file(scene, settings, engine, self._path(), str(self.path))


class ANYFACE_OT_performer_use(Acting, Operator):
    """Let this face speak as the performer does, from the next Generate on"""

    bl_idname = "anyface.performer_use"
    bl_label = "Use Performer"

    path: StringProperty(subtype="FILE_PATH", options={"SKIP_SAVE"})

    def act(self, ob):
        """Sets the performer; an empty path sets none."""
        ob.anyface.performer = self.path
        return f"performer {name_of(ob.anyface)}"


class ANYFACE_OT_performer_delete(Acting, Operator):
    """Delete the file of this performer"""

    bl_idname = "anyface.performer_delete"
    bl_label = "Delete Performer"

    path: StringProperty(subtype="FILE_PATH", options={"SKIP_SAVE"})

    def invoke(self, context, event):
        """Asks whether that is meant."""
        return context.window_manager.invoke_confirm(self, event)

    def act(self, ob):
        """Deletes a file of the list, and no other."""
        path = Path(self.path)
        if path not in everyone():
            known = ", ".join(file.stem for file in everyone()) or "none"
            raise AnyfaceError("input", f"performer: expected one of {known}, got {path.stem!r}")
        path.unlink()
        if ob.library is None and ob.anyface.performer == self.path:
            ob.anyface.performer = ""
        return f"performer {path.stem} deleted"


class ANYFACE_MT_performers(Menu):
    """Whose mouth the face has"""

    bl_label = "Performer"

    def draw(self, context):
        """Draws all performers, then what can be done with them."""
        layout, shown = self.layout, target(context)
        layout.operator("anyface.performer_use", text="None").path = ""
        for path in everyone():
            icon = "CHECKMARK" if shown.anyface.performer == str(path) else "NONE"
            entry = layout.operator("anyface.performer_use", text=path.stem, icon=icon)
            entry.path = str(path)
        layout.separator()
        layout.operator("anyface.performer_learn", text="Learn from Take…", icon="ADD")
        layout.operator("anyface.performer_learn_file", text="Learn from Live Link…", icon="IMPORT")
        layout.menu("ANYFACE_MT_performer_delete")


class ANYFACE_MT_performer_delete(Menu):
    """Delete a performer"""

    bl_label = "Delete"

    def draw(self, _context):
        """Draws all performers."""
        for path in everyone():
            entry = self.layout.operator("anyface.performer_delete", text=path.stem, icon="TRASH")
            entry.path = str(path)
