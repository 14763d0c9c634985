"""A take as a point cache beside the .blend, played by a Mesh Cache modifier.

The modifier's own name is the record: one that the artist renamed is his and stays.
"""

import uuid
from pathlib import Path

import bpy

from ..core.take import WrittenFile
from . import cache_files
from .cache_files import FOLDER, SUFFIX

MODIFIER = "Anyface Cache"


def new_paths(names: list[str], folder: str) -> dict[str, str]:
    """Absolute paths of files that are not there yet, one for each object of a face.

    Their names end alike, by which they are known to belong together.
    """
    take = uuid.uuid4().hex[:8]
    place = Path(bpy.path.abspath(folder or f"//{FOLDER}"))
    return {name: str(place / f"{bpy.path.clean_name(name)}_{take}{SUFFIX}") for name in names}


def find(ob):
    """The modifier of a generated cache, or None."""
    modifier = ob.modifiers.get(MODIFIER) if ob is not None and ob.type == "MESH" else None
    return modifier if modifier is not None and modifier.type == "MESH_CACHE" else None


def write(ob, file: WrittenFile, first_frame: float, frames_per_frame: float) -> None:
    """Adds the modifier that plays `file`, before all others that may be moved.

    The first frame after the ease lies at scene frame `first_frame`; a frame of the cache lasts
    `frames_per_frame` scene frames.
    """
    cache_files.note_written(file.path)
    modifier = ob.modifiers.new(MODIFIER, "MESH_CACHE")
    modifier.cache_format = "PC2"
    modifier.filepath = _relative(file.path)
    modifier.interpolation = "LINEAR"
    modifier.time_mode, modifier.play_mode = "FRAME", "SCENE"
    modifier.forward_axis, modifier.up_axis = "POS_Y", "POS_Z"
    modifier.frame_start = first_frame - file.ease * frames_per_frame
    modifier.frame_scale = 1.0 / frames_per_frame
    if ob.override_library is None:
        ob.modifiers.move(len(ob.modifiers) - 1, 0)
    # What moves before the cache (keys, armatures of a library) is kept and added to.
    moved_before = ob.data.shape_keys is not None or ob.modifiers[0] != modifier
    modifier.deform_mode = "INTEGRATE" if moved_before else "OVERWRITE"


def remove(ob) -> bool:
    """Takes modifiers and, when nobody needs them, files and our folder away; False for none.

    Those of the objects beside the face go with its own.
    """
    modifiers = of_take(ob)
    for modifier in modifiers:
        path = Path(bpy.path.abspath(modifier.filepath))
        modifier.id_data.modifiers.remove(modifier)
        cache_files.drop(path)
    return bool(modifiers)


def of_take(ob) -> list:
    """The modifiers of the cache of `ob` and of the objects beside it."""
    own = find(ob)
    if own is None:
        return []
    found = [find(other) for other in bpy.data.objects]
    return [made for made in found if made is not None and _take_of(made) == _take_of(own)]


def _take_of(modifier) -> str:
    return Path(modifier.filepath).stem.rpartition("_")[2]


def _relative(path: str) -> str:
    if not bpy.data.filepath:
        return path
    try:
        return bpy.path.relpath(path)
    except ValueError:
        # Another drive.
        return path
