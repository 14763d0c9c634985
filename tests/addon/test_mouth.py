"""Open Mouth parts lips that are one surface. All data on the mesh follows."""

from pathlib import Path

import bpy
import numpy as np
import pytest
from mathutils import Vector
from mathutils.bvhtree import BVHTree

from figures import babble

HEAD = Path(__file__).resolve().parents[2] / "weights" / "shared" / "default_head" / "head.obj"
COLUMNS, ROWS = 70, 80


def _depths() -> np.ndarray:
    """Points `[ROWS, COLUMNS, 3]` on the front of the default head. +z points out of the face."""
    points, faces = [], []
    for line in HEAD.read_text().splitlines():
        word, *rest = line.split() or [""]
        if word == "v":
            points.append([float(x) for x in rest[:3]])
        elif word == "f":
            faces.append([int(x.split("/")[0]) - 1 for x in rest])
    tree = BVHTree.FromPolygons(points, faces)
    places = np.empty((ROWS, COLUMNS, 3))
    for row, y in enumerate(np.linspace(-0.12, 0.08, ROWS)):
        for column, x in enumerate(np.linspace(-0.08, 0.08, COLUMNS)):
            hit = tree.ray_cast(Vector((x, y, 1.0)), Vector((0.0, 0.0, -1.0)))[0]
            places[row, column] = (x, y, -0.02 if hit is None else hit.z)
    # Rays hit a step in depth where the head's lips part. Sealed lips have none, so smooth it.
    depth = np.pad(places[..., 2], 1, mode="edge")
    beside = depth[1:-1, 2:] + depth[1:-1, :-2] + depth[2:, 1:-1] + depth[:-2, 1:-1]
    places[..., 2] = 0.5 * places[..., 2] + 0.125 * beside
    return places


@pytest.fixture
def mask():
    """A face of quads, facing -Y, with sealed lips. It has UVs, a group, a key, two materials."""
    places = _depths().reshape(-1, 3)
    number = np.arange(ROWS * COLUMNS).reshape(ROWS, COLUMNS)
    corners = (number[:-1, :-1], number[:-1, 1:], number[1:, 1:], number[1:, :-1])
    quads = np.stack(corners, axis=-1).reshape(-1, 4)
    data = bpy.data.meshes.new("Mask")
    data.from_pydata((places * [1, 1, -1])[:, [0, 2, 1]].tolist(), [], quads.tolist())
    for name in ("Skin", "Chin"):
        data.materials.append(bpy.data.materials.new(name))
    for polygon in data.polygons:
        polygon.material_index = int(polygon.center.z < -0.06)
    layer = data.uv_layers.new(name="UVMap")
    for loop, uv in zip(data.loops, layer.data, strict=True):
        uv.uv = places[loop.vertex_index, :2]
    ob = bpy.data.objects.new("Mask", data)
    bpy.context.collection.objects.link(ob)
    group = ob.vertex_groups.new(name="height")
    for vertex, (_, y, _) in enumerate(places):
        group.add([vertex], 0.5 + 2.0 * float(y), "REPLACE")
    ob.shape_key_add(name="Basis")
    wide = ob.shape_key_add(name="Wide", from_mix=False)
    for point in wide.data:
        point.co.x *= 1.5
    bpy.context.view_layer.objects.active = ob
    return ob


def _opened(ob) -> None:
    assert bpy.ops.anyface.find_face() == {"FINISHED"}
    assert "welded" in ob["anyface_landmarks"]
    assert bpy.ops.anyface.open_mouth() == {"FINISHED"}


def test_the_lips_part_and_everything_goes_along(mask):
    before = np.array([vertex.co for vertex in mask.data.vertices])
    count, polygons = len(before), len(mask.data.polygons)
    _opened(mask)
    data = mask.data
    after = np.array([vertex.co for vertex in data.vertices])
    assert len(after) > count + 100
    assert np.abs(after[:count] - before).max() < 1e-7
    # Polygons far from the mouth stay quads.
    quads = sum(len(polygon.vertices) == 4 for polygon in data.polygons)
    assert polygons - 200 < quads < polygons
    inside = data.materials.find("Mouth Inside")
    skin = [polygon for polygon in data.polygons if polygon.material_index != inside]
    front, rolled = set(), set()
    for polygon in skin:
        assert polygon.material_index in (0, 1)
        uvs = {tuple(data.uv_layers["UVMap"].data[loop].uv) for loop in polygon.loop_indices}
        if len(uvs) == 1:
            # The inner side of a lip has the colour of the rim in front of it.
            rolled.update(vertex for vertex in polygon.vertices if vertex >= count)
            continue
        front.update(polygon.vertices)
        for loop in polygon.loop_indices:
            place = data.vertices[data.loops[loop].vertex_index].co
            uv = data.uv_layers["UVMap"].data[loop].uv
            assert abs(uv.x - place.x) < 1e-5 and abs(uv.y - place.z) < 1e-5
    assert len(rolled - front) > 100
    wide = data.shape_keys.key_blocks["Wide"].data
    basis = data.shape_keys.key_blocks["Basis"].data
    for vertex in front:
        place = data.vertices[vertex].co
        assert (basis[vertex].co - place).length < 1e-6
        assert abs(wide[vertex].co.x - 1.5 * place.x) < 1e-5
        weight = data.vertices[vertex].groups[0].weight
        assert abs(weight - (0.5 + 2.0 * place.z)) < 1e-4
    assert not any(edge.is_loose for edge in data.edges)


def test_the_mesh_stays_whole_and_the_face_is_known_to_part(mask, addon):
    def rim(data):
        uses = {}
        for polygon in data.polygons:
            for key in polygon.edge_keys:
                uses[key] = uses.get(key, 0) + 1
        assert max(uses.values()) == 2
        return sum(count == 1 for count in uses.values())

    before = rim(mask.data)
    _opened(mask)
    assert rim(mask.data) == before
    assert addon("scene.face.landmarks").load(mask).mouth == "slit"
    assert not bpy.ops.anyface.open_mouth.poll()
    assert bpy.ops.anyface.find_face() == {"FINISHED"}
    assert addon("scene.face.landmarks").load(mask).mouth == "slit"


def test_normals_of_the_artist_stay(mask):
    normals = [(0.0, -1.0, 0.0)] * len(mask.data.loops)
    mask.data.normals_split_custom_set(normals)
    _opened(mask)
    data = mask.data
    assert data.has_custom_normals
    inside = data.materials.find("Mouth Inside")
    skin = [polygon for polygon in data.polygons if polygon.material_index != inside]
    turned = [data.corner_normals[loop].vector.y for p in skin for loop in p.loop_indices]
    assert max(turned) < -0.99


def test_a_take_on_sealed_lips_offers_to_open_them(mask, addon, tmp_path):
    bpy.context.scene.render.fps = 24
    mask.anyface.source, mask.anyface.sound_file = "FILE", babble(tmp_path / "voice.wav", 1.0)
    offered = addon("ui.mending").offers
    assert bpy.ops.anyface.generate() == {"FINISHED"}
    assert addon("scene.face.landmarks").load(mask) is None, "nobody has looked for the face"
    assert addon("scene.face.opening").WELDED in mask.anyface.report
    assert offered(mask) == ["open_mouth", "open_eyes"]
    assert bpy.ops.anyface.open_mouth() == {"FINISHED"}
    assert addon("scene.face.landmarks").load(mask).mouth == "slit"
    assert offered(mask) == ["open_eyes"]
    assert bpy.ops.anyface.generate() == {"FINISHED"}
    assert addon("scene.face.opening").WELDED not in mask.anyface.report
    assert offered(mask) == ["open_eyes"]


def test_lips_roll_inward_in_the_colour_of_the_skin(mask):
    before = len(mask.data.vertices)
    _opened(mask)
    data = mask.data
    inside = data.materials.find("Mouth Inside")
    skin = [set(p.vertices) for p in data.polygons if p.material_index != inside]
    bag = {vertex for p in data.polygons if p.material_index == inside for vertex in p.vertices}
    edge = bag & set.union(*skin)
    front = {vertex for corners in skin for vertex in corners if vertex < before}
    depth = [data.vertices[vertex].co.y for vertex in edge]
    lips = [data.vertices[vertex].co.y for vertex in front]
    assert max(depth) - min(lips) > 0.002, "the dark inside begins behind the lips"
