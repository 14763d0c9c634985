"""Cuts apart lips, or lids and eyes, that are one surface of a Blender mesh.

Layers, groups and keys on the mesh are kept.
"""

from dataclasses import dataclass

import bmesh
import bpy
import numpy as np

from ...core import finding
from ...core.errors import AnyfaceError
from ...core.job import Progress
from ...core.take import FaceMesh, Found, OpenedFace
from ..shape_keys import guard
from . import landmarks

# What a report says about lips that are one surface.
WELDED = "the lips are one surface and cannot part: Open Mouth parts them"
# What a report says about eyes that are one surface with their lids.
JOINED = "eyes and lids are one surface and cannot blink: Open Eyes cuts them apart"
# The material of the mouth's inside.
INSIDE = "Mouth Inside"
_COLOUR = (0.16, 0.03, 0.03, 1.0)
# The layer that keeps the artist's custom normals while the mesh changes.
_NORMALS = "anyface_normals"


def is_welded(ob) -> bool:
    """Whether the lips of `ob` are one surface, by its landmarks or else by its last take."""
    try:
        stored = landmarks.load(ob)
    except AnyfaceError:
        return False
    known = stored.mouth if stored is not None else ""
    return (known or ob.anyface.mouth) == "welded"


def has_joined_eyes(ob) -> bool:
    """Whether an eye of `ob` is one surface with its lids.

    It looks at the landmarks, or else at the last take.
    """
    try:
        stored = landmarks.load(ob)
    except AnyfaceError:
        return False
    if stored is not None and stored.mouth:
        return "joined" in stored.lids
    return "joined" in ob.anyface.lids.split()


@dataclass
class Opening:
    """A snapshot for opening a face; `work` needs no Blender data, so any thread may run it.

    `feature` is "mouth" or "eyes". `stored` holds the landmarks of the object; without them `work`
    searches for landmarks.
    """

    face: FaceMesh
    engine: object
    stored: landmarks.Stored | None
    feature: str

    def work(self, progress: Progress) -> OpenedFace:
        """The opened mesh in object space; raises `AnyfaceError`."""
        opens = {"mouth": self.engine.open_mouth, "eyes": self.engine.open_eyes}[self.feature]
        space = self.face.space
        if self.stored is None:
            face_points = finding.find(self.face, {}, self.engine.find, progress)
            self.face.landmarks, self.face.landmark_vertices = (
                face_points.positions,
                face_points.vertices,
            )
            self.stored = landmarks.Stored(
                face_points.positions,
                face_points.confidence,
                face_points.mouth,
                lids=face_points.lids,
            )
        with finding.naming(self.face):
            opened = opens(*space.to_library(self.face), progress)
        opened.positions = space.points_to_object(opened.positions)
        opened.landmarks = space.points_to_object(opened.landmarks)
        if space.mirrored:
            opened.triangles = opened.triangles[:, ::-1]
            opened.corner_shares = opened.corner_shares[:, ::-1, ::-1]
        return opened


def write(ob, opening: Opening, opened: OpenedFace) -> str:
    """Puts an opened face on `ob`; returns a sentence about it.

    Texture coordinates, vertex groups, attributes, materials, custom normals and shape keys stay.
    Raises `AnyfaceError` where the mesh has changed since it was read.
    """
    guard.check_local(ob)
    face, stored = opening.face, opening.stored
    guard.check_size(ob, len(face.positions))
    if ob.data.users > 1:
        ob.data = ob.data.copy()
    mode = ob.mode
    if mode != "OBJECT":
        bpy.ops.object.mode_set(mode="OBJECT")
    with _travelling_normals(ob.data) as layer:
        _Rewriter(ob.data, face, opened, layer).write()
    if mode != "OBJECT":
        bpy.ops.object.mode_set(mode=mode)
    places, nearest = opened.landmarks, opened.landmark_vertices
    none = np.empty(0, dtype=np.int64)
    mouth, lids, done = stored.mouth, stored.lids, f"the eyes of {ob.name} can blink now"
    if opening.feature == "mouth":
        mouth, done = "slit", f"the lips of {ob.name} part now"
    else:
        lids = tuple("close" if state == "joined" else state for state in lids)
    face_points = Found(places, nearest, stored.confidence, mouth, none, none, lids)
    landmarks.store(ob, face_points, stored.fixed)
    ob.anyface.mouth, ob.anyface.lids = mouth, " ".join(lids)
    return done


class _travelling_normals:
    """Keeps custom normals in a layer while the mesh changes; yields the name of the layer."""

    def __init__(self, mesh):
        self._mesh = mesh

    def __enter__(self) -> str | None:
        if not self._mesh.has_custom_normals:
            return None
        normals = np.empty(3 * len(self._mesh.loops), dtype=np.float32)
        self._mesh.corner_normals.foreach_get("vector", normals)
        layer = self._mesh.attributes.new(_NORMALS, "FLOAT_VECTOR", "CORNER")
        layer.data.foreach_set("vector", normals)
        return layer.name

    def __exit__(self, *_):
        layer = self._mesh.attributes.get(_NORMALS)
        if layer is None:
            return
        normals = np.empty(3 * len(self._mesh.loops), dtype=np.float32)
        layer.data.foreach_get("vector", normals)
        self._mesh.attributes.remove(layer)
        self._mesh.normals_split_custom_set(normals.reshape(-1, 3).tolist())


class _Rewriter:
    """Rewrites the faces of a mesh at its mouth or its eyes."""

    def __init__(self, mesh, face: FaceMesh, opened: OpenedFace, normals: str | None):
        self._mesh, self._opened, self._count = mesh, opened, len(face.positions)
        self._old = face.triangles
        self._normals = normals
        mesh.calc_loop_triangles()
        self._loops = np.empty((len(self._old), 3), dtype=np.int32)
        self._polygons = np.empty(len(self._old), dtype=np.int32)
        mesh.loop_triangles.foreach_get("loops", self._loops.reshape(-1))
        mesh.loop_triangles.foreach_get("polygon_index", self._polygons)

    def write(self) -> None:
        """Changes the mesh."""
        has_inside = self._opened.first_inside_triangle < len(self._opened.triangles)
        inside = self._material() if has_inside else 0
        self._bm = bmesh.new()
        try:
            self._bm.from_mesh(self._mesh)
            self._bm.faces.ensure_lookup_table()
            self._add_vertices()
            self._replace_faces(inside)
            self._bm.to_mesh(self._mesh)
        finally:
            self._bm.free()
        self._mesh.update()

    def _material(self) -> int:
        """The slot of the material for the inside of the mouth."""
        material = bpy.data.materials.get(INSIDE)
        if material is None:
            material = bpy.data.materials.new(INSIDE)
            material.diffuse_color = _COLOUR
            if material.node_tree is None:
                material.use_nodes = True
            shader = material.node_tree.nodes.get("Principled BSDF")
            if shader is not None:
                shader.inputs["Base Color"].default_value = _COLOUR
        if len(self._mesh.materials) == 0:
            self._mesh.materials.append(None)
        self._mesh.materials.append(material)
        return len(self._mesh.materials) - 1

    def _add_vertices(self) -> None:
        """Adds vertices. Each is a mixture of old ones, and moves in shape keys as they do."""
        layers, old = self._bm.verts.layers, list(self._bm.verts)
        groups, shapes = layers.deform.active, layers.shape.values()
        new = zip(
            self._opened.positions[self._count :].tolist(),
            self._opened.vertex_sources[self._count :].tolist(),
            self._opened.vertex_shares[self._count :].tolist(),
            strict=True,
        )
        for place, numbers, shares in new:
            sources = [(old[n], s) for n, s in zip(numbers, shares, strict=True) if s > 0.0]
            vertex = self._bm.verts.new(place, max(sources, key=lambda pair: pair[1])[0])
            if groups is not None:
                _mix_groups(vertex, sources, groups)
            for layer in shapes:
                vertex[layer] = vertex.co
                for source, share in sources:
                    vertex[layer] += share * (source[layer] - source[shapes[0]])
        self._bm.verts.ensure_lookup_table()

    def _replace_faces(self, inside: int) -> None:
        changed, beside, pieces = self._changed()
        self._faces = {number: self._bm.faces[number] for number in beside}
        gone = [self._faces[number] for number in changed]
        edges = {edge for face in gone for edge in face.edges}
        loops = self._loops_of(beside)
        for number in changed:
            self._cut(number, pieces, loops)
        lips, first = self._opened.first_lining_triangle, self._opened.first_inside_triangle
        for new in range(lips, first):
            self._add(new, loops)
        news = range(first, len(self._opened.triangles))
        bag = {face for face in (self._add(new, loops) for new in news) if face is not None}
        for face in bag:
            face.material_index = inside
        bmesh.ops.delete(self._bm, geom=gone, context="FACES_ONLY")
        for edge in edges:
            if not edge.link_faces:
                self._bm.edges.remove(edge)
        # The edge between lips and inside is sharp, so that the lips keep their shading.
        for edge in {edge for face in bag for edge in face.edges}:
            edge.smooth = all(face in bag for face in edge.link_faces)

    def _changed(self) -> tuple[list[int], list[int], dict[int, list[int]]]:
        """The polygons that change, all polygons at the cut, and the new triangles.

        The polygons at the cut include those that change. New triangles in changed polygons are
        listed by the old triangle that they lie in.
        """
        opened, first = self._opened, self._opened.first_lining_triangle
        sources = opened.triangle_sources[:first].astype(np.int64)
        counts = np.bincount(sources, minlength=len(self._old))
        same = (opened.triangles[:first] == self._old[sources]).all(axis=1)
        touched = np.zeros(len(self._old), dtype=bool)
        touched[sources[~same]] = True
        touched |= counts != 1
        changed = np.unique(self._polygons[touched])
        touched[opened.triangle_sources[first:]] = True
        beside = np.unique(self._polygons[touched])
        of_changed = np.isin(self._polygons[sources], changed)
        pieces = {}
        for new in np.flatnonzero(of_changed).tolist():
            pieces.setdefault(int(sources[new]), []).append(new)
        return changed.tolist(), beside.tolist(), pieces

    def _loops_of(self, polygons: list[int]) -> dict:
        """The loops of polygons by their number in the mesh."""
        out = {}
        for number in polygons:
            start = self._mesh.polygons[number].loop_start
            for offset, loop in enumerate(self._faces[number].loops):
                out[start + offset] = loop
        return out

    def _cut(self, polygon: int, pieces: dict, loops: dict) -> None:
        """Rewrites one polygon: as a whole if only its vertices changed, otherwise as triangles."""
        triangles = np.flatnonzero(self._polygons == polygon).tolist()
        if any(len(pieces[t]) != 1 for t in triangles):
            for new in (new for t in triangles for new in pieces[t]):
                self._add(new, loops)
            return
        renamed = {}
        for t in triangles:
            pairs = zip(self._old[t], self._opened.triangles[pieces[t][0]], strict=True)
            renamed.update((int(a), int(b)) for a, b in pairs)
        old = self._faces[polygon]
        corners = [self._bm.verts[renamed[loop.vert.index]] for loop in old.loops]
        self._new_face(corners, [[(loop, 1.0)] for loop in old.loops], old)

    def _add(self, new: int, loops: dict):
        """Adds one new triangle."""
        source = int(self._opened.triangle_sources[new])
        around = [loops[number] for number in self._loops[source].tolist()]
        corners = [self._bm.verts[number] for number in self._opened.triangles[new].tolist()]
        shares = self._opened.corner_shares[new].tolist()
        mixed = [[(around[k], row[k]) for k in range(3) if row[k] > 0.0] for row in shares]
        return self._new_face(corners, mixed, around[0].face)

    def _new_face(self, corners, mixed, like):
        """Adds a face whose loops are mixtures of old ones; None if it has no area or exists."""
        if len(set(corners)) < len(corners):
            return None
        try:
            face = self._bm.faces.new(corners, like)
        except ValueError:
            return None
        for loop, sources in zip(face.loops, mixed, strict=True):
            self._mix_loop(loop, sources)
        return face

    def _mix_loop(self, loop, sources) -> None:
        """Fills the layers of a new corner.

        Floats, vectors and colours are mixed. Everything else comes from the nearest old corner.
        """
        layers = self._bm.loops.layers
        for layer in layers.uv.values():
            loop[layer].uv = _sum(share * source[layer].uv for source, share in sources)
        for kind in (layers.float, layers.float_vector, layers.float_color, layers.color):
            for layer in kind.values():
                loop[layer] = _sum(share * source[layer] for source, share in sources)
        nearest = max(sources, key=lambda pair: pair[1])[0]
        # Blender 4.2 gives no access to layers of booleans.
        for kind in ("int", "bool", "string"):
            for layer in getattr(layers, kind).values() if hasattr(layers, kind) else ():
                loop[layer] = nearest[layer]


def _mix_groups(vertex, sources, layer) -> None:
    weights = vertex[layer]
    weights.clear()
    for source, share in sources:
        for group, weight in source[layer].items():
            weights[group] = weights.get(group, 0.0) + share * weight


def _sum(values):
    first, *others = values
    for value in others:
        first = first + value
    return first
