"""Programs by other authors open the avatar that `anyface rig --out x.glb` gives shapes to."""

import json

import bpy
import numpy as np
import pytest

import skinned_head
from conftest import HEAD, THREE_JS, VALIDATE, VALIDATOR, anyface, node

SAME_M = 3e-6
"""Tolerance in metres. Shapes leave out vertices that move less than 0.002 mm on each axis."""

READ = """
import * as THREE from 'three';
import { GLTFLoader } from 'three/addons/loaders/GLTFLoader.js';
import fs from 'fs';
globalThis.self = globalThis;
const [glb, out, names] = process.argv.slice(1);
const loader = new GLTFLoader().setPath('');
// Node shows no pictures.
loader.register((parser) => ({ name: 'pictures', loadTexture: async () => new THREE.Texture() }));
const gltf = await loader.parseAsync(new Uint8Array(fs.readFileSync(glb)).buffer, '');
gltf.scene.updateMatrixWorld(true);
const bones = {}, materials = {}, shapes = {}, meshes = [];
gltf.scene.traverse((object) => {
  if (object.isBone) bones[object.name] = object.matrixWorld.toArray();
  if (!object.isMesh) return;
  materials[object.name] = object.material.name;
  shapes[object.name] = Object.keys(object.morphTargetDictionary ?? {});
  meshes.push(object);
});
const place = new THREE.Vector3(), rest = new THREE.Vector3(), moved = [];
for (const name of out ? JSON.parse(names) : []) {
  for (const mesh of meshes) {
    const k = mesh.morphTargetDictionary?.[name], { count } = mesh.geometry.attributes.position;
    for (let v = 0; v < count; v++) {
      mesh.morphTargetInfluences?.fill(0);
      mesh.getVertexPosition(v, rest);
      if (k !== undefined) mesh.morphTargetInfluences[k] = 1;
      moved.push(...mesh.getVertexPosition(v, place).sub(rest).toArray());
    }
  }
}
if (out) fs.writeFileSync(out, new Float32Array(moved));
const tracks = gltf.animations.map((clip) => [clip.name, clip.tracks.map((track) =>
  [track.name, [...track.times], [...track.values]])]);
console.log(JSON.stringify({ bones, materials, shapes, tracks }));
"""


def document(path) -> tuple[dict, bytes]:
    """The description of a GLB and its data."""
    whole = path.read_bytes()
    length = int.from_bytes(whole[12:16], "little")
    return json.loads(whole[20 : 20 + length]), whole[28 + length :]


@pytest.fixture(scope="module")
def avatars(tmp_path_factory):
    """A folder with an avatar: `before.glb`, with shapes `after.glb`, and `rig.npz`."""
    folder = tmp_path_factory.mktemp("rigged")
    skinned_head.write(folder / "before.glb")
    landmarks = json.loads((HEAD / "landmarks.json").read_text())["landmarks"]
    numbers = folder / "numbers.json"
    numbers.write_text(json.dumps([landmark["vertex"] for landmark in landmarks]))
    for name in ("after.glb", "rig.npz"):
        out = ["--out", folder / name]
        said = anyface("rig", *out, mesh=folder / "before.glb", landmarks=numbers)
        if name == "after.glb":
            assert "skin got 66 shapes, kept 1" in said, said
    return folder


def test_all_else_in_the_file_stays(avatars):
    (before, bytes_before), (after, bytes_after) = map(
        document, (avatars / "before.glb", avatars / "after.glb")
    )
    assert bytes_after.startswith(bytes_before)
    for names in ("nodes", "skins", "materials", "textures", "images", "scenes", "extras", "asset"):
        assert before[names] == after[names], names
    for names in ("accessors", "bufferViews"):
        assert after[names][: len(before[names])] == before[names]
    for old, new in zip(before["meshes"], after["meshes"], strict=True):
        [old_part], [new_part] = old["primitives"], new["primitives"]
        assert {**old_part, "targets": 0} == {**new_part, "targets": 0}
        own, targets = old_part.get("targets", []), new_part.get("targets", [])
        assert targets[: len(own)] == own
        if targets:
            assert len(new["weights"]) == len(targets) == len(new["extras"]["targetNames"])
        else:
            assert old == new
    face = after["meshes"][0]["extras"]
    assert face["mine"] == 1 and face["targetNames"][:2] == list(skinned_head.OWN_TARGETS)
    assert len(face["targetNames"]) == len(set(face["targetNames"])) == 68
    assert before["animations"][0] == after["animations"][0]


def test_three_finds_bones_materials_and_animations_again(avatars):
    before = node(READ, avatars / "before.glb", packages=THREE_JS)
    after = node(READ, avatars / "after.glb", packages=THREE_JS)
    assert before["bones"] == after["bones"] and len(before["bones"]) == 3
    assert before["materials"] == after["materials"]
    assert set(before["shapes"]["skin"]) < set(after["shapes"]["skin"])
    for (name, old), (new_name, new) in zip(before["tracks"], after["tracks"], strict=True):
        assert name == new_name and len(old) == len(new)
        for (track, times, values), (*same, new_values) in zip(old, new, strict=True):
            assert [track, times] == same
            if "morph" in track:
                count, wide = len(values) // 2, np.array(new_values).reshape(-1, 68)
                assert wide.shape[0] == count and np.allclose(wide[:, :2].ravel(), values)
                assert not wide[:, 2:].any()
            else:
                assert values == new_values


def test_three_moves_every_object_as_the_rig_does(avatars):
    rig = np.load(avatars / "rig.npz")
    shapes = dict(zip(rig["names"].tolist(), rig["deltas"], strict=True))
    names = ("jawOpen", "eyeBlinkLeft", "eyeLookUpRight", "viseme_aa", "tongueOut")
    files = avatars / "after.glb", avatars / "moved.bin"
    node(READ, *files, json.dumps(names), packages=THREE_JS)
    moved = np.fromfile(avatars / "moved.bin", "<f4").reshape(len(names), -1, 3)
    for name, row in zip(names, moved, strict=True):
        assert np.abs(shapes[name]).max() > 2e-3
        assert np.abs(row - shapes[name]).max() < SAME_M, name


def test_blender_finds_bones_actions_and_shapes(avatars):
    def read(path):
        bpy.ops.wm.read_factory_settings(use_empty=True)
        bpy.ops.import_scene.gltf(filepath=str(path))
        armature = next(ob for ob in bpy.data.objects if ob.type == "ARMATURE")
        bones = {bone.name: np.array(bone.matrix_local) for bone in armature.data.bones}
        ranges = {action.name: tuple(action.frame_range) for action in bpy.data.actions}
        meshes = {ob.data.name: ob for ob in bpy.data.objects if ob.type == "MESH"}
        keys = {
            name: [key.name for key in ob.data.shape_keys.key_blocks] if ob.data.shape_keys else []
            for name, ob in meshes.items()
        }
        slots = {name: [slot.name for slot in ob.material_slots] for name, ob in meshes.items()}
        return bones, ranges, slots, keys

    bones, ranges, slots, keys = read(avatars / "before.glb")
    new_bones, new_ranges, new_slots, new_keys = read(avatars / "after.glb")
    assert bones.keys() == new_bones.keys() and ranges and ranges == new_ranges
    assert all(np.array_equal(matrix, new_bones[name]) for name, matrix in bones.items())
    assert slots == new_slots
    assert keys["skin"] == new_keys["skin"][:3] and len(new_keys["skin"]) == 69
    assert {"jawOpen", "viseme_aa"} <= set(new_keys["teeth_lower"])
    assert "eyeLookUpLeft" in new_keys["eye_left"] and "tongueOut" in new_keys["tongue"]


def test_the_validator_of_khronos_finds_no_error(avatars):
    for name in ("before.glb", "after.glb"):
        issues = node(VALIDATE, avatars / name, packages=VALIDATOR)
        assert issues["numErrors"] == 0, issues["messages"][:5]
