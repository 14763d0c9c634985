"""The ways in which a take is written: what each needs, what each makes."""

import math
from dataclasses import dataclass, field

import bpy

from ..core.errors import AnyfaceError
from ..core.plan import Plan
from ..core.take import Piece, Take
from . import cache, csv_file, existing, guard, keys, rig_keys, together

MODES = ("basis", "frames", "cache", "keys", "arkit", "csv")
# Modifiers that leave every vertex where it is.
_HARMLESS = {
    "COLLISION", "DATA_TRANSFER", "NORMAL_EDIT", "UV_PROJECT", "UV_WARP", "VERTEX_WEIGHT_EDIT",
    "VERTEX_WEIGHT_MIX", "VERTEX_WEIGHT_PROXIMITY", "WEIGHTED_NORMAL",
}  # fmt: skip


@dataclass
class OutputSettings:
    """What an output may be told; the fields of `ui.output_properties.AnyfaceOutput`.

    An empty folder or file takes the place beside the .blend. `new_take` keeps the earlier take.
    `mapping` is the artist's list of shape name and key; empty, keys are found by name.
    """

    cache_folder: str = ""
    csv_file: str = ""
    visemes: bool = False
    new_take: bool = False
    mapping: dict[str, str] = field(default_factory=dict)


def check(ob, mode: str, output: OutputSettings) -> None:
    """Raises `AnyfaceError` with the remedy where `mode` cannot work on `ob`."""
    if mode not in MODES:
        raise AnyfaceError("input", f"mode: expected {' or '.join(MODES)}, got {mode!r}")
    if mode == "cache":
        _check_cache(ob, output)
    elif mode == "csv":
        guard.check_mesh(ob)
        _check_place(output.csv_file)
        csv_file.check(ob, csv_file.path_of(ob, output.csv_file))
    else:
        guard.check_editable(ob, mode)
    if mode == "keys":
        existing.check(ob, output.mapping)
    elif mode == "arkit":
        rig_keys.check(ob, output.visemes)


def check_part(ob, mode: str, output: OutputSettings) -> None:
    """The same for an object beside the face, which follows it in the same way."""
    if mode == "cache":
        _check_cache(ob, output)
    elif mode not in ("csv", "keys"):
        guard.check_editable(ob, mode)


def why_not(ob, mode: str, output: OutputSettings) -> str:
    """Why `mode` cannot work on `ob`, in words; empty where it can."""
    try:
        check(ob, mode, output)
    except AnyfaceError as error:
        return str(error)
    return ""


def plan(ob, mode: str, output: OutputSettings, fps: float, objects: list[str]) -> Plan:
    """What the worker needs; raises as `check` does.

    `fps` are frames of the take per second, `objects` the names of the face's objects.
    """
    check(ob, mode, output)
    made = Plan(mode, visemes=output.visemes)
    if mode == "cache":
        made.paths = cache.new_paths(objects, output.cache_folder)
        made.ease = math.ceil(keys.EASE_S * fps)
    elif mode == "csv":
        made.paths = {ob.name: str(csv_file.path_of(ob, output.csv_file))}
    elif mode == "keys":
        made.keys = existing.find(ob, output.mapping)
        made.vectors = existing.vectors(ob, made.keys.values())
    return made


def write(ob, parts: list[Piece], take: Take, start_frame: float, scene_fps: float) -> None:
    """Puts a take on `ob` and the objects beside it, `parts`.

    An earlier one goes, but for a table, which changes no mesh.
    """
    if not take.files:
        together.write(ob, parts, take, start_frame, scene_fps)
    elif take.files[0].vertices:
        _write_cache(ob, take, start_frame, scene_fps)
    else:
        csv_file.write_record(ob, csv_file.path_of(ob, take.files[0].path))


def describe(take: Take) -> str:
    """What was made: "31 basis keys, largest error 0.098 mm"."""
    if take.frames is not None:
        return "one key per frame"
    if take.basis is not None:
        return f"{len(take.basis.vectors)} basis keys, largest error {take.basis.error_mm:.3f} mm"
    if take.key_motion is not None:
        motion = take.key_motion
        what = "made" if motion.vectors is not None else "driven"
        return f"{len(motion.keys)} keys {what}, {1.0 - motion.left_out:.0%} of the motion shown"
    names = ", ".join(bpy.path.basename(file.path) for file in take.files)
    if take.files[0].vertices:
        return f"cache {names}"
    return f"ARKit table {names}, {1.0 - take.files[0].left_out:.0%} of the motion shown"


def _write_cache(ob, take, start_frame, scene_fps) -> None:
    found = [(bpy.data.objects.get(file.object_name), file) for file in take.files]
    for other, file in found:
        guard.check_mesh(other)
        keys.check_size(other, file.vertices)
    together.remove_others(ob)
    keys.remove_earlier(ob)
    for other, file in found:
        cache.write(other, file, start_frame, scene_fps / take.fps)


def _check_cache(ob, output: OutputSettings) -> None:
    guard.check_mesh(ob)
    if ob.library is not None:
        raise AnyfaceError(
            "mesh",
            f"{ob.name} is linked and takes no modifier: make a library override first "
            "(Object > Library Override > Make)",
        )
    before = [m.name for m in ob.modifiers if m.type not in _HARMLESS and m != cache.find(ob)]
    if ob.override_library is not None and before:
        raise AnyfaceError(
            "mesh",
            f"the modifier {before[0]} of the library acts before a cache could, which would tear "
            "the face: make the object local first (Object > Relations > Make Local > Selected "
            "Objects); its mesh and rig may stay linked",
        )
    _check_place(output.cache_folder)


def _check_place(path: str) -> None:
    if not bpy.data.filepath and (not path or path.startswith("//")):
        raise AnyfaceError("file", "the .blend has no place yet: save it first, or choose a path")
