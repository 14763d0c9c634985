"""A take as a point cache beside the .blend, played by a Mesh Cache modifier.

The add-on recognises the modifier by its name. If the artist renames it, it belongs to the artist
and stays.
"""

import math
from pathlib import Path

import bpy

from ...core import pc2
from ...core.errors import AnyfaceError
from ...core.estimate import VERTEX, Cost
from ...core.job import BEGUN
from ...core.plan import WriteCaches
from ...core.redo_film import PatchCaches
from ...core.take import WrittenFile
from .. import cache_files, identity
from ..animation import curves
from ..shape_keys import guard
from .output import Output, check_place

MODIFIER = "Anyface Cache"
# Modifiers that leave every vertex where it is.
_HARMLESS = {
    "COLLISION", "DATA_TRANSFER", "NORMAL_EDIT", "UV_PROJECT", "UV_WARP", "VERTEX_WEIGHT_EDIT",
    "VERTEX_WEIGHT_MIX", "VERTEX_WEIGHT_PROXIMITY", "WEIGHTED_NORMAL",
}  # fmt: skip


class Cache(Output):
    """Writes a file for each object of the face. All file names of a take end the same way."""

    name = "cache"
    label = "Cache File"
    help = (
        "A point cache beside the .blend and a modifier that plays it; for heavy and linked meshes"
    )
    finished = "a cache holds the finished motion: use New Keys"
    in_files = True
    lost_in = {
        name: f"the motion lies in a point cache, which {name} does not hold: choose USD or "
        "Alembic, or generate New Keys"
        for name in ("glTF", "FBX")
    }
    options = ("cache_folder",)

    def check_object(self, ob):
        guard.check_mesh(ob)
        if ob.library is not None:
            raise AnyfaceError(
                "mesh",
                f"{ob.name} is linked and takes no modifier: make a library override first "
                "(Object > Library Override > Make)",
            )
        ours = self.find(ob)
        before = [m.name for m in ob.modifiers if m.type not in _HARMLESS and m != ours]
        if ob.override_library is not None and before:
            raise AnyfaceError(
                "mesh",
                f"the modifier {before[0]} of the library acts before a cache could, which would "
                "tear the face: make the object local first (Object > Relations > Make Local > "
                "Selected Objects); its mesh and rig may stay linked",
                ("make_object_local",),
            )

    def check(self, ob, settings):
        super().check(ob, settings)
        check_place(settings.cache_folder)

    def draw(self, layout, ob):
        super().draw(layout, ob)
        layout.operator("anyface.remove_unused_caches", icon="TRASH")

    def cost(self, workload):
        return Cost(workload.frames * workload.vertices * VERTEX, beside=True)

    def plan(self, ob, settings, fps, objects):
        place = Path(bpy.path.abspath(settings.cache_folder or f"//{cache_files.FOLDER}"))
        paths = {name: str(place / file) for name, file in cache_files.names(objects).items()}
        return WriteCaches(paths, math.ceil(curves.EASE_S * fps))

    def describe(self, take):
        files = take.motion.files
        return "a cache" if len(files) == 1 else f"caches of {len(files)} objects"

    def details(self, take, is_human):
        return [bpy.path.basename(file.path) for file in take.motion.files]

    def check_files(self, take):
        for file in take.motion.files:
            other = bpy.data.objects.get(file.object_name)
            guard.check_mesh(other)
            guard.check_size(other, file.vertices)

    def write_files(self, ob, take, start_frame, scene_fps):
        for file in take.motion.files:
            other = bpy.data.objects[file.object_name]
            _play(other, file, start_frame, scene_fps / take.fps)
            if other != ob:
                identity.join(ob, other)

    def find(self, ob):
        modifier = ob.modifiers.get(MODIFIER) if ob is not None and ob.type == "MESH" else None
        return modifier if modifier is not None and modifier.type == "MESH_CACHE" else None

    def remove(self, ob):
        """Removes the modifiers of the face and of the objects beside it. The files stay."""
        for modifier in self._playing(ob):
            modifier.id_data.modifiers.remove(modifier)

    def _playing(self, ob) -> list:
        """The modifiers that play the take of `ob`, with the one on `ob` itself first."""
        face_modifier = self.find(ob)
        if face_modifier is None:
            return []
        take = cache_files.take_of(face_modifier.filepath)
        modifiers = [self.find(other) for other in identity.parts_of(ob)]
        beside = [m for m in modifiers if m is not None and cache_files.take_of(m.filepath) == take]
        return [face_modifier, *beside]

    def span(self, ob, snapshot):
        modifier, ease = self.find(ob), snapshot.plan.ease
        step = 1.0 / max(modifier.frame_scale, 1e-6)
        count = pc2.frames_in(_absolute(modifier), len(ob.data.vertices))
        return modifier.frame_start + ease * step, step, count - 2 * ease

    def redo_plan(self, ob, snapshot, first, shares):
        fresh, playing = snapshot.plan.paths, self._playing(ob)
        played = {m.id_data.name: str(_absolute(m)) for m in playing if m.id_data.name in fresh}
        paths = {name: (path, fresh[name]) for name, path in played.items()}
        return PatchCaches(paths, first, shares, snapshot.plan.ease)

    def redo_write(self, parts, snapshot, take, first, at, stretch):
        for file in take.motion.files:
            self.find(bpy.data.objects[file.object_name]).filepath = _relative(file.path)
        yield BEGUN


def _play(ob, file: WrittenFile, first_frame: float, frames_per_frame: float) -> None:
    """Adds the modifier that plays `file`, and moves it to the top where that is allowed.

    The first frame after the ease lies at scene frame `first_frame`. A frame of the cache lasts
    `frames_per_frame` scene frames.
    """
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
    # If keys or armatures of a library move the mesh before the cache, the cache adds to their
    # motion.
    moved_before = ob.data.shape_keys is not None or ob.modifiers[0] != modifier
    modifier.deform_mode = "INTEGRATE" if moved_before else "OVERWRITE"


def _absolute(modifier) -> Path:
    return Path(bpy.path.abspath(modifier.filepath, library=modifier.id_data.library))


def _relative(path: str) -> str:
    if not bpy.data.filepath:
        return path
    try:
        return bpy.path.relpath(path)
    except ValueError:
        # The cache is on another drive.
        return path
