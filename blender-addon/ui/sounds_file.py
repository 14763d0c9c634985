"""Writes the strips of *Mend* as a file of times for other tools."""

from pathlib import Path

import bpy
from bpy.props import BoolProperty, EnumProperty, StringProperty
from bpy.types import Operator

from ..core.errors import AnyfaceError
from ..scene import bake
from ..scene.sound import sounds, strips
from . import running
from .audio import WithSound
from .operators import WithFile
from .settings import from_object
from .target import sequencer_scene

# The file formats that the library writes: ending, name, and help.
_KINDS = (
    (".TextGrid", "Praat TextGrid", "Phones as intervals; Praat, ELAN and forced aligners read it"),
    (".tsv", "Rhubarb TSV", "Mouth shapes A to H and X, one line each"),
    (".json", "Rhubarb JSON", "Mouth shapes A to H and X"),
    (".pgo", "Papagayo", "A Papagayo project; its frames count as the scene's do"),
    (".dat", "Moho", "A Moho switch; its frames count as the scene's do"),
    (".txt", "Lines of Text", "Start, end and phone in each line; Audacity reads it"),
)
_NO_STRIPS = "no strips of this sound: press Show Sounds first, or read them from a file"


class ANYFACE_OT_sounds_write(WithSound, WithFile, Operator):
    """Write the strips as a file of times: Praat, Rhubarb, Papagayo, Moho, or lines of text"""

    bl_idname = "anyface.sounds_write"
    bl_label = "Write Sounds"

    filter_glob: StringProperty(
        default=";".join(f"*{kind[0]}" for kind in _KINDS), options={"HIDDEN"}
    )
    check_existing: BoolProperty(default=True, options={"HIDDEN"})
    kind: EnumProperty(name="Kind", items=_KINDS, description="The program that the file is for")

    def invoke(self, context, event):
        """Opens the file browser with the name of the .blend."""
        stem = Path(bpy.data.filepath).stem or "sounds"
        self.filepath = self.filepath or stem
        self.filepath = self._path()
        return super().invoke(context, event)

    def check(self, _context):
        """Changes the ending of the path to match the kind."""
        before, self.filepath = self.filepath, self._path()
        return before != self.filepath

    def act(self, ob):
        """Writes the file."""
        scene = sequencer_scene(bpy.context)
        settings = from_object(ob, scene)
        engine = running.engine(settings.system)
        source = bake.find_sound(scene, settings, engine)
        closures = sounds.read(scene, source)
        if not closures:
            raise AnyfaceError("input", _NO_STRIPS)
        path = bpy.path.abspath(self._path())
        fps = scene.render.fps / scene.render.fps_base
        ends_s = max(strips.duration_s(source) or 0.0, closures[-1][1])
        engine.write_sounds(path, sounds.apart(closures), ends_s, fps)
        return f"{len(closures)} sounds in {Path(path).name}"

    def _path(self) -> str:
        """The path with the ending of `kind`; a known ending stays if no kind was chosen."""
        path = Path(self.filepath)
        if path.suffix.lower() not in {kind[0].lower() for kind in _KINDS}:
            return f"{path}{self.kind}"
        chosen = self.properties.is_property_set("kind")
        return str(path.with_suffix(self.kind)) if chosen else str(path)
