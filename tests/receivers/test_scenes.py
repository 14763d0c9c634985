"""Programs by other authors open the scenes that `anyface animate` writes."""

import json
import subprocess
import sys

import bpy
import numpy as np

from conftest import FPS, NEAR_M, THREE, THREE_JS, VALIDATE, VALIDATOR, node

READ_USD = """
import json, sys
import numpy as np
from pxr import Usd, UsdGeom, UsdSkel, UsdValidation, Vt
stage = Usd.Stage.Open(sys.argv[1])
known = UsdValidation.ValidationRegistry().GetOrLoadAllValidators()
assert len(known) > 20
context = UsdValidation.ValidationContext(known)
mesh = UsdGeom.Mesh.Get(stage, '/Anyface/Face')
cache = UsdSkel.Cache()
cache.Populate(UsdSkel.Root.Get(stage, '/Anyface'), Usd.PrimDefaultPredicate)
skinning = cache.GetSkinningQuery(mesh.GetPrim())
animation = cache.GetAnimQuery(UsdSkel.Animation.Get(stage, '/Anyface/Animation'))
shapes = UsdSkel.BlendShapeQuery(UsdSkel.BindingAPI(mesh.GetPrim()))
rest = mesh.GetPointsAttr().Get()
frames = []
for t in range(int(stage.GetEndTimeCode()) + 1):
    weights = skinning.GetBlendShapeMapper().Remap(animation.ComputeBlendShapeWeights(t))
    parts = shapes.ComputeSubShapeWeights(weights)
    points = Vt.Vec3fArray(rest)
    indices, offsets = shapes.ComputeBlendShapePointIndices(), shapes.ComputeSubShapePointOffsets()
    assert shapes.ComputeDeformedPoints(*parts, indices, offsets, points)
    frames.append(np.array(points) - np.array(rest))
np.save(sys.argv[2], np.array(frames))
print(json.dumps({
    'errors': [error.GetMessage() for error in context.Validate(stage)],
    'sound': stage.GetRootLayer().customLayerData['sound'],
    'up': UsdGeom.GetStageUpAxis(stage), 'fps': stage.GetTimeCodesPerSecond(),
}))
"""


def test_blender_moves_every_vertex_as_the_arrays_do(spoken, expected):
    displacements = expected.displacements()
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.context.scene.render.fps = FPS
    bpy.ops.import_scene.gltf(filepath=str(spoken / "talk.glb"))
    face = next(ob for ob in bpy.data.objects if ob.type == "MESH")
    assert face.parent.parent.name == "Head"
    keys = face.data.shape_keys.key_blocks
    places = np.empty((len(keys), len(face.data.vertices) * 3), np.float32)
    for key, row in zip(keys, places, strict=True):
        key.data.foreach_get("co", row)
    shapes = places[1:] - places[0]
    largest = 0.0
    for t in range(len(displacements)):
        bpy.context.scene.frame_set(t)
        weights = np.array([key.value for key in keys[1:]])
        assert weights.min() >= 0.0 and weights.max() <= 1.0
        x, y, z = (weights @ shapes).reshape(-1, 3).T
        # Up is y in glTF and z in Blender.
        moved = np.stack([x, z, -y], axis=1)
        largest = max(largest, float(np.linalg.norm(moved - displacements[t], axis=1).max()))
    assert np.abs(displacements).max() > 1e-3
    assert largest < NEAR_M


def test_usd_moves_every_vertex_as_the_arrays_do(spoken, expected):
    # Use a separate process: Blender contains a USD, and one process cannot hold two.
    done = subprocess.run(
        [sys.executable, "-c", READ_USD, spoken / "talk.usda", spoken / "usd.npy"],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    read = json.loads(done.stdout)
    assert (read["errors"], read["sound"], read["up"], read["fps"]) == ([], "talk.wav", "Y", FPS)
    displacements = expected.displacements()
    moved = np.load(spoken / "usd.npy")
    assert moved.shape == displacements.shape
    assert np.linalg.norm(moved - displacements, axis=2).max() < NEAR_M


def test_blender_reads_the_usd_too(spoken):
    displacements = np.load(spoken / "talk.npz")["displacements"]
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.ops.wm.usd_import(filepath=str(spoken / "talk.usda"))
    face = next(ob for ob in bpy.data.objects if ob.type == "MESH")
    assert len(face.data.vertices) == displacements.shape[1]
    assert any(ob.type == "ARMATURE" for ob in bpy.data.objects)
    keys = face.data.shape_keys.key_blocks
    bpy.context.scene.frame_set(len(displacements) // 2)
    assert any(key.value > 0.1 for key in keys[1:])


def test_the_sound_lies_beside_the_scene(spoken):
    assert (spoken / "talk.wav").read_bytes() == (spoken / "voice.wav").read_bytes()
    whole = (spoken / "talk.glb").read_bytes()
    length = int.from_bytes(whole[12:16], "little")
    document = json.loads(whole[20 : 20 + length])
    assert document["animations"][0]["extras"] == {"sound": "talk.wav"}


def test_three_moves_every_vertex_as_the_arrays_do(spoken, expected):
    names = node(THREE, spoken / "talk.glb", spoken / "three.bin", str(FPS), packages=THREE_JS)
    displacements = expected.displacements()
    assert expected.looks()["eyeLookInLeft"].any() and "eyeLookInLeft" in names
    moved = np.fromfile(spoken / "three.bin", "<f4").reshape(displacements.shape)
    assert np.linalg.norm(moved - displacements, axis=2).max() < NEAR_M


def test_the_validator_of_khronos_finds_nothing(spoken):
    issues = node(VALIDATE, spoken / "talk.glb", packages=VALIDATOR)
    assert (issues["numErrors"], issues["numWarnings"]) == (0, 0), issues["messages"][:5]
