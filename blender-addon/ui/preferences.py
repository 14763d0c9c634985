"""The add-on's preferences: which models are used, and how many threads."""

from pathlib import Path

import bpy
from bpy.props import BoolProperty, EnumProperty, IntProperty, StringProperty
from bpy.types import AddonPreferences

from ..core import native
from ..core.errors import AnyfaceError
from ..core.microphone import devices

# Blender knows the add-on by this name: the package that contains this one.
PACKAGE = __package__.rpartition(".")[0]


class AnyfacePreferences(AddonPreferences):
    """Preferences > Add-ons > Anyface."""

    bl_idname = PACKAGE

    threads: IntProperty(
        name="Threads",
        description="Worker threads; 0 uses one per core. A change takes effect at the next start",
        default=0,
        min=0,
        max=256,
    )

    model_folder: StringProperty(
        name="Model Folder",
        description="Folder of your own models, used instead of the built-in ones; a scene can "
        "name another folder",
        subtype="DIR_PATH",
    )

    performer_folder: StringProperty(
        name="Performer Folder",
        description="Folder of performers, such as one that a studio shares; empty uses a folder "
        "of the extension",
        subtype="DIR_PATH",
    )

    research: BoolProperty(
        name="Research Controls",
        description="Show controls for how a model works: guidance, noise, steps, fields "
        "and templates. Those that were changed are always shown",
        default=False,
    )

    microphone: StringProperty(
        name="Microphone",
        description="Name of the device that Live Microphone records, or a part of it; empty "
        "uses the system's default",
        search=lambda _self, _context, _text: _microphones(),
    )

    look_ahead: EnumProperty(
        name="Microphone Delay",
        description="How far Live Microphone listens ahead before the face shows a sound. "
        "FreeTalk allows less: the face then reacts sooner but is less certain",
        items=[
            ("0.19", "0.2 s", "Lips close in time"),
            ("0.07", "0.07 s", "Lips close in time, but also where they should not"),
            ("0", "None", "Half of the closures come late or not at all"),
        ],
        default="0.19",
    )

    def draw(self, context):
        """Draws the preferences."""
        self.layout.prop(self, "model_folder", placeholder="Built-In")
        self.layout.prop(self, "performer_folder", placeholder="The Extension's")
        self.layout.prop(self, "microphone", placeholder="System's Choice")
        self.layout.prop(self, "look_ahead")
        self.layout.prop(self, "threads")
        self.layout.prop(self, "research")
        self.layout.label(text=f"Library: {native.library_path()}")


def _microphones() -> list[str]:
    """Names of the recording devices; none if the system's sound cannot be used."""
    try:
        return devices()
    except AnyfaceError:
        return []


def microphone() -> str:
    """The microphone that the artist set; "" for the system's choice."""
    return _stored("microphone", "")


def look_ahead() -> float:
    """How many seconds of coming sound Live Microphone waits for, at most."""
    return float(_stored("look_ahead", "0.19"))


def threads() -> int:
    """The number of threads that the artist set; 0 if there are no preferences."""
    return _stored("threads", 0)


def shows_research() -> bool:
    """Whether the artist wants to see controls of how a model works."""
    return _stored("research", False)


def usual_folder() -> str:
    """The folder of models that the artist set for all scenes; "" for the built-in ones."""
    return _stored("model_folder", "")


def model_folder(scene) -> Path | None:
    """The folder of the models for `scene`; None for the built-in ones."""
    folder = scene.anyface.model_folder or usual_folder()
    return Path(bpy.path.abspath(folder)) if folder else None


def performer_folder(create: bool = False) -> Path:
    """The folder of the performers. Raises `AnyfaceError("file")` if there is none."""
    folder = _stored("performer_folder", "")
    try:
        if not folder:
            return Path(bpy.utils.extension_path_user(PACKAGE, path="performers", create=create))
        path = Path(bpy.path.abspath(folder))
        if create:
            path.mkdir(parents=True, exist_ok=True)
        return path
    except (ValueError, OSError) as error:
        text = f"no folder for performers: {error}: choose one in the preferences"
        raise AnyfaceError("file", text) from error


def _stored(name: str, otherwise):
    addon = bpy.context.preferences.addons.get(PACKAGE)
    stored = addon.preferences if addon is not None else None
    return getattr(stored, name) if stored else otherwise


def cache_folder() -> Path | None:
    """The extension's own user folder, where the library caches what it knows about meshes.

    None if this is no installed extension; the library then takes the user's cache folder.
    """
    try:
        return Path(bpy.utils.extension_path_user(PACKAGE, path="cache", create=True))
    except (ValueError, OSError):
        return None
