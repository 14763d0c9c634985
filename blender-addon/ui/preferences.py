"""The add-on's preferences: what is built in and how many threads it may use."""

from pathlib import Path

import bpy
from bpy.props import IntProperty
from bpy.types import AddonPreferences

from ..core import native

# The name under which Blender knows the add-on: the package of this one.
PACKAGE = __package__.rpartition(".")[0]


class AnyfacePreferences(AddonPreferences):
    """Preferences > Add-ons > Anyface."""

    bl_idname = PACKAGE

    threads: IntProperty(
        name="Threads",
        description="Worker threads; 0 takes one per core. Used from the next start on",
        default=0,
        min=0,
        max=256,
    )

    def draw(self, context):
        """Draws the preferences."""
        self.layout.prop(self, "threads")
        self.layout.label(text=f"Library: {native.library_path()}")


def threads() -> int:
    """The number of threads that the artist set; 0 where there are no preferences."""
    addon = bpy.context.preferences.addons.get(PACKAGE)
    return addon.preferences.threads if addon is not None and addon.preferences else 0


def cache_folder() -> Path | None:
    """Where the library keeps what it knows of meshes: the extension's own user folder.

    None outside an installed extension: the library then takes the user's cache folder.
    """
    try:
        return Path(bpy.utils.extension_path_user(PACKAGE, path="cache", create=True))
    except (ValueError, OSError):
        return None


CLASSES = (AnyfacePreferences,)
