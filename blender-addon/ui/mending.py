"""Remedies for an error, as buttons below its text.

An `AnyfaceError` names its mends; the object stores them with the report.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import bpy
from bpy.props import StringProperty
from bpy.types import Operator

from ..core.errors import AnyfaceError
from ..scene import outputs
from ..scene.face import opening
from ..scene.sound import sequencer
from . import words
from .operators import Alone
from .target import is_there, sequencer_scene


@dataclass(frozen=True)
class Mend:
    """A button: its text, and the function `act(ob)` that mends the character."""

    label: str
    icon: str
    help: str
    act: Callable
    keeps_report: bool = False


# Mends that have an operator of their own: the operator, its label, its icon.
_OPERATORS = {
    "choose_sound": ("anyface.choose_sound", "Choose a Sound File…", "FILE_SOUND"),
    "find_files": ("file.find_missing_files", "Find Missing Files…", "FILE_REFRESH"),
    "save": ("wm.save_mainfile", "Save the File", "FILE_TICK"),
    "find_parts": ("anyface.find_parts", "Find Parts", "VIEWZOOM"),
    "place_points": ("anyface.place_points", "Place Points", "PIVOT_CURSOR"),
    "open_mouth": ("anyface.open_mouth", "Open Mouth", "MOD_BOOLEAN"),
    "open_eyes": ("anyface.open_eyes", "Open Eyes", "HIDE_OFF"),
}
# Mends that are a setting: the property of `Object.anyface` that the panel shows.
_SETTINGS = {"direction": "axes", "points_file": "landmark_file"}


def offers(ob) -> list[str]:
    """The names of the mends that the panel offers for `ob`: for its report and for its face."""
    # A linked object cannot store a report.
    if ob.library is not None:
        return ["make_local"]
    names = ob.anyface.report_mends.split()
    names += [] if ob.anyface.report_is_error else [name for name, text in _of_scene(ob) if text]
    closed = {"open_mouth": opening.is_welded, "open_eyes": opening.has_joined_eyes}
    if ob.anyface.report:
        names += [name for name, holds in closed.items() if name not in names and holds(ob)]
    return [name for name in names if name in (*_OPERATORS, *_SETTINGS, *_MENDS)]


def keep(ob, names) -> None:
    """Stores the mends that the report of `ob` offers."""
    ob.anyface.report_mends = " ".join(names)


def _of_scene(ob) -> list[tuple[str, str]]:
    """Mends of the scene for the take of `ob`, each with a message, "" where all is well."""
    scene = bpy.context.scene
    behind = frames_behind(ob, scene)
    late = late_take(behind) if behind > 0 else ""
    return [("scene_range", late), ("stretching_off", stretched(ob, scene))]


def said_of_scene(ob) -> list[str]:
    """Messages about the scene that concern the take of `ob`."""
    return [text for _, text in _of_scene(ob) if text]


def draw(layout, ob, width: int) -> None:
    """Draws a button for each mend."""
    column = layout.column(align=True)
    for name in offers(ob):
        text = dict(_of_scene(ob)).get(name, "")
        if text:
            words.draw(column, text, width, "INFO")
        if name in _SETTINGS:
            column.prop(ob.anyface, _SETTINGS[name])
        elif name in _OPERATORS:
            operator, label, icon = _OPERATORS[name]
            column.operator(operator, text=label, icon=icon)
        else:
            mend = _MENDS[name]
            column.operator("anyface.mend", text=mend.label, icon=mend.icon).name = name


class ANYFACE_OT_mend(Alone, Operator):
    """Fix the problem that the report names"""

    bl_idname = "anyface.mend"
    bl_label = "Mend"

    name: StringProperty(options={"SKIP_SAVE"})

    @classmethod
    def description(cls, _context, properties):
        """The tooltip: what the button will do."""
        mend = _MENDS.get(properties.name)
        return mend.help if mend is not None else cls.__doc__

    def act(self, ob):
        """Applies the mend, then clears the report unless the mend keeps it."""
        if self.name not in _MENDS:
            known = ", ".join(_MENDS)
            raise AnyfaceError("input", f"mend: expected one of {known}, got {self.name!r}")
        try:
            _MENDS[self.name].act(ob)
        except RuntimeError as error:
            raise AnyfaceError("mesh", str(error).strip()) from error
        if ob.library is None and not _MENDS[self.name].keeps_report:
            ob.anyface.report, ob.anyface.report_mends = "", ""
            ob.anyface.report_is_error = False


def frames_behind(ob, scene) -> int:
    """How many frames of the take of `ob` come after the scene's end; 0 or less for none."""
    last = ob.anyface.last_frame
    return math.ceil(last + ob.anyface_output.shift) - scene.frame_end if last else 0


def late_take(frames: int) -> str:
    """The message that the take goes on for `frames` after the end of the scene."""
    return f"The take goes on for {frames} frames after the end of the scene"


def stretched(ob, scene) -> str:
    """The message that the scene plays the take faster or slower than its sound, or ""."""
    old, new = scene.render.frame_map_old, scene.render.frame_map_new
    if old == new or not ob.anyface.last_frame:
        return ""
    return (
        f"Time Stretching (Output properties) plays the face at {old / new:.3g} times its speed, "
        "and its sound at its own"
    )


def _turn_stretching_off(ob) -> None:
    render = bpy.context.scene.render
    render.frame_map_old = render.frame_map_new = 100


def _extend_scene(ob) -> None:
    scene = bpy.context.scene
    scene.frame_end += max(frames_behind(ob, scene), 0)


def _use(mode: str) -> Mend:
    output = outputs.of(mode)

    def act(ob):
        ob.anyface.mode = mode

    return Mend(f"Use {output.label}", "SHAPEKEY_DATA", f"{output.help} (More > Output)", act)


def _apply_mirror(ob) -> None:
    for name in [m.name for m in ob.modifiers if m.type == "MIRROR"]:
        with bpy.context.temp_override(object=ob, active_object=ob, selected_objects=[ob]):
            bpy.ops.object.modifier_apply(modifier=name)


def _make_object_local(ob) -> None:
    ob.make_local()


def _make_local(ob) -> None:
    local = ob.make_local()
    local.data.make_local()


def _turn_relative_on(ob) -> None:
    ob.data.shape_keys.use_relative = True


def _leave_tweak_mode(ob) -> None:
    ob.data.shape_keys.animation_data.use_tweak_mode = False


def _drop_lost_parts(ob) -> None:
    parts = ob.anyface_face.parts
    for number in reversed(range(len(parts))):
        if not is_there(parts[number].object):
            parts.remove(number)


def _unmute(ob) -> None:
    names = {item.name for item in ob.anyface_audio.chosen}
    for strip in sequencer.sound_strips(sequencer_scene(bpy.context)):
        if strip.name in names or strip.channel == ob.anyface_audio.channel:
            strip.mute = False


_MENDS = {
    "use_basis": _use("basis"),
    "use_keys": _use("keys"),
    "use_arkit": _use("arkit"),
    "use_cache": _use("cache"),
    "apply_mirror": Mend(
        "Apply Mirror", "MOD_MIRROR", "Apply the Mirror modifiers of the face", _apply_mirror
    ),
    "make_object_local": Mend(
        "Make the Object Local",
        "UNLINKED",
        "Make the face object part of this file; its mesh stays linked",
        _make_object_local,
    ),
    "make_local": Mend(
        "Make Local", "UNLINKED", "Make the face and its mesh part of this file", _make_local
    ),
    "turn_relative_on": Mend(
        "Turn Relative On", "SHAPEKEY_DATA", "Let shape keys add up", _turn_relative_on
    ),
    "leave_tweak_mode": Mend(
        "Leave Tweak Mode", "NLA", "Leave the tweak mode of the NLA strip", _leave_tweak_mode
    ),
    "drop_lost_parts": Mend(
        "Drop Lost Parts", "TRASH", "Take deleted objects off the list of parts", _drop_lost_parts
    ),
    "scene_range": Mend(
        "Set Scene Range",
        "PREVIEW_RANGE",
        "Let the scene end with the take",
        _extend_scene,
        keeps_report=True,
    ),
    "stretching_off": Mend(
        "Turn Time Stretching Off",
        "TIME",
        "Let the scene play at the speed of its sound",
        _turn_stretching_off,
        keeps_report=True,
    ),
    "unmute": Mend("Unmute", "PLAY_SOUND", "Unmute the strips that speak", _unmute),
}
