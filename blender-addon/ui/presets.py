"""Presets of a performance: the artist chooses, saves, imports, exports and deletes them.

Shipped presets lie in the extension's folder, the artist's own in the user folder that Blender
gives the extension. Only an export writes anywhere else.
"""

from pathlib import Path

import bpy
from bpy.props import StringProperty
from bpy.types import Menu, Operator

from ..core import presets
from ..core.errors import AnyfaceError
from .operators import Acting, WithFile
from .preferences import PACKAGE

_EMOTION = ("emotion", "intensity", presets.MIXED)
SHIPPED = Path(__file__).resolve().parents[1] / "presets"


def own_folder(create: bool = False) -> Path:
    """The folder of the artist's own presets. Raises `AnyfaceError("file")` where there is none."""
    try:
        return Path(bpy.utils.extension_path_user(PACKAGE, path="presets", create=create))
    except ValueError as error:
        raise AnyfaceError("file", f"no user folder for presets: {error}") from error
    except OSError as error:
        raise AnyfaceError("file", f"the user folder cannot be written: {error}") from error


def everyone() -> list[presets.Preset]:
    """The shipped presets, then the artist's own."""
    return presets.in_folder(SHIPPED) + _own()


def _own() -> list[presets.Preset]:
    try:
        return presets.in_folder(own_folder())
    except AnyfaceError:
        return []


def name_of(settings) -> str:
    """The name of the most specific preset that `settings` match; "My Own" if none does."""
    fitting = [preset for preset in everyone() if _is(preset, settings)]
    return max(fitting, key=lambda preset: len(preset.values)).name if fitting else "My Own"


def _is(preset: presets.Preset, settings) -> bool:
    """Whether `settings` match a preset apart from its emotion, which has a line of its own."""
    values = {name: value for name, value in preset.values.items() if name not in _EMOTION}
    return bool(values) and all(_same(getattr(settings, name), values[name]) for name in values)


def _same(setting, value) -> bool:
    """Whether two values are equal, up to the rounding of a slider."""
    return setting == value if isinstance(value, str) else abs(setting - value) < 1e-4


def apply(preset: presets.Preset, settings) -> None:
    """Sets the panel's sliders (`Object.anyface`) to the values of a preset.

    If the preset names an emotion, all emotions that it does not name are removed.
    """
    if "emotion" in preset.values:
        settings.mixed = ""
    for name, value in preset.values.items():
        setattr(settings, name, value)


def of_settings(name: str, settings) -> presets.Preset:
    """The panel's sliders as a preset."""
    values = {item: getattr(settings, item) for item in presets.names()}
    # An empty mixture is left out, so that versions without mixtures can read the preset.
    return presets.Preset(name, {item: value for item, value in values.items() if value != ""})


class ANYFACE_OT_preset_apply(Acting, Operator):
    """Set the performance's sliders to this preset"""

    bl_idname = "anyface.preset_apply"
    bl_label = "Apply Preset"

    path: StringProperty(subtype="FILE_PATH", options={"SKIP_SAVE"})

    def act(self, ob):
        """Reads the file and sets the sliders."""
        preset = presets.read(self.path)
        apply(preset, ob.anyface)
        return f"preset {preset.name}"


class ANYFACE_OT_preset_save(Acting, Operator):
    """Keep the performance's sliders as a preset of your own"""

    bl_idname = "anyface.preset_save"
    bl_label = "Save Preset"

    name: StringProperty(name="Name", default="My Performance")

    def invoke(self, context, event):
        """Asks for the name."""
        return context.window_manager.invoke_props_dialog(self)

    def act(self, ob):
        """Writes the preset into the user folder."""
        path = own_folder(create=True) / presets.file_name(self.name)
        presets.write(of_settings(self.name, ob.anyface), path)
        return f"preset {self.name} saved"


class ANYFACE_OT_preset_delete(Acting, Operator):
    """Delete a preset of your own"""

    bl_idname = "anyface.preset_delete"
    bl_label = "Delete Preset"

    name: StringProperty(name="Name", options={"SKIP_SAVE"})

    def act(self, ob):
        """Deletes its file; shipped presets stay."""
        own_presets = {preset.name: preset for preset in presets.in_folder(own_folder())}
        if self.name not in own_presets:
            known = ", ".join(own_presets) or "none"
            raise AnyfaceError(
                "input", f"preset: expected one of your own ({known}), got {self.name!r}"
            )
        own_presets[self.name].path.unlink(missing_ok=True)
        return f"preset {self.name} deleted"


class ANYFACE_OT_preset_import(WithFile, Operator):
    """Add a preset from a file to your presets and apply it"""

    bl_idname = "anyface.preset_import"
    bl_label = "Import Preset"

    def act(self, ob):
        """Checks the file, stores a copy of it beside your presets, and applies it."""
        preset = presets.read(bpy.path.abspath(self.filepath))
        preset = presets.with_free_name(preset, own_folder(create=True))
        presets.write(preset, preset.path)
        apply(preset, ob.anyface)
        return f"preset {preset.name} imported"


class ANYFACE_OT_preset_export(WithFile, Operator):
    """Write the performance's sliders to a file for others"""

    bl_idname = "anyface.preset_export"
    bl_label = "Export Preset"

    filepath: StringProperty(subtype="FILE_PATH", default="performance.json")

    def act(self, ob):
        """Writes the file."""
        path = Path(bpy.path.abspath(self.filepath))
        if not path.name:
            raise AnyfaceError("file", "export: choose a file name first")
        typed, path = path, path.with_suffix(presets.SUFFIX)
        if path != typed and path.exists():
            raise AnyfaceError("file", f"{path} exists already: choose another name or delete it")
        presets.write(of_settings(path.stem, ob.anyface), path)
        return f"written {path}"


class ANYFACE_MT_presets(Menu):
    """How the face speaks: a style of Anyface's or of your own"""

    bl_label = "Style"

    def draw(self, context):
        """Draws all styles, then the actions on them."""
        for preset in everyone():
            entry = self.layout.operator("anyface.preset_apply", text=preset.name)
            entry.path = str(preset.path)
        self.layout.separator()
        self.layout.operator("anyface.preset_save", text="Save…", icon="ADD")
        self.layout.operator("anyface.preset_import", text="Import…", icon="IMPORT")
        self.layout.operator("anyface.preset_export", text="Export…", icon="EXPORT")
        self.layout.menu("ANYFACE_MT_preset_delete")


class ANYFACE_MT_preset_delete(Menu):
    """Delete a preset of your own"""

    bl_label = "Delete"

    def draw(self, context):
        """Draws the artist's own presets."""
        own_presets = _own()
        for preset in own_presets:
            entry = self.layout.operator("anyface.preset_delete", text=preset.name, icon="TRASH")
            entry.name = preset.name
        if not own_presets:
            self.layout.label(text="No presets of your own")
