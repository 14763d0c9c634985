"""three-vrm in node opens the avatars and motion that `anyface rig` and `animate` write."""

import json
import struct

import avatar as ball
import numpy as np
import pytest

from conftest import FPS, HEAD, THREE, VALIDATE, VALIDATOR, animate, anyface, node

PACKAGES = ("three@0.170.0", "@pixiv/three-vrm@3.5.5", "@pixiv/three-vrm-animation@3.5.5")
SAME_M = 3e-6
"""Tolerance in metres. Shapes leave out vertices that move less than 0.002 mm on each axis."""

READ = """
import * as THREE from 'three';
import { GLTFLoader } from 'three/addons/loaders/GLTFLoader.js';
import { VRMLoaderPlugin } from '@pixiv/three-vrm';
import fs from 'fs';
globalThis.self = globalThis;
async function load(path, plugin) {
  const loader = new GLTFLoader();
  loader.register(plugin);
  return loader.parseAsync(new Uint8Array(fs.readFileSync(path)).buffer, '');
}
const { vrm } = (await load(process.argv[1], (parser) => new VRMLoaderPlugin(parser))).userData;
const faces = [];
vrm.scene.traverse((object) => { if (object.morphTargetInfluences) faces.push(object); });
const place = new THREE.Vector3(), rest = new THREE.Vector3();
function moved() {
  return faces.flatMap((face) => {
    const { position } = face.geometry.attributes;
    const places = [];
    for (let v = 0; v < position.count; v++) {
      rest.fromBufferAttribute(position, v);
      places.push(...face.getVertexPosition(v, place).sub(rest).toArray());
    }
    return places;
  });
}
"""
EXPRESSIONS = (
    READ
    + """
const all = vrm.expressionManager, names = Object.keys(all.expressionMap);
const rows = names.map((name) => {
  all.resetValues();
  all.setValue(name, 1);
  all.update();
  return moved();
});
fs.writeFileSync(process.argv[2], new Float32Array(rows.flat()));
all.resetValues();
all.setValue('aa', 1);
all.setValue('JawOpen', 0.5);
all.update();
const aa = faces[0].morphTargetInfluences[faces[0].morphTargetDictionary.viseme_aa];
console.log(JSON.stringify({
  names, aa, bones: Object.keys(vrm.humanoid.humanBones), meta: vrm.meta,
  lookAt: vrm.lookAt?.applier.constructor.type,
}));
"""
)
SHADED = (
    READ
    + """
const { geometry } = faces[0], k = faces[0].morphTargetDictionary.jawOpen;
const normals = geometry.attributes.normal.clone(), turned = geometry.morphAttributes.normal[k];
const whole = geometry.clone(), shape = geometry.morphAttributes.position[k];
whole.morphAttributes = {};
for (let i = 0; i < normals.array.length; i++) {
  normals.array[i] += turned.array[i];
  whole.attributes.position.array[i] += shape.array[i];
}
whole.computeVertexNormals();
let most = 0;
for (let v = 0; v < normals.count; v++) {
  place.fromBufferAttribute(normals, v);
  rest.fromBufferAttribute(whole.attributes.normal, v);
  if (rest.length() > 0.5) most = Math.max(most, place.angleTo(rest));
}
console.log(most * 180 / Math.PI);
"""
)
PLAY = (
    READ
    + """
import { VRMAnimationLoaderPlugin, VRMLookAtQuaternionProxy, createVRMAnimationClip }
  from '@pixiv/three-vrm-animation';
const [, talk, out, fps] = process.argv.slice(1);
const file = await load(talk, (parser) => new VRMAnimationLoaderPlugin(parser));
const proxy = new VRMLookAtQuaternionProxy(vrm.lookAt);
proxy.name = 'lookAtQuaternionProxy';
vrm.scene.add(proxy);
const clip = createVRMAnimationClip(file.userData.vrmAnimations[0], vrm);
const mixer = new THREE.AnimationMixer(vrm.scene), action = mixer.clipAction(clip);
action.setLoop(THREE.LoopOnce);
action.clampWhenFinished = true;
action.play();
const head = vrm.humanoid.getNormalizedBoneNode('head');
const frames = Math.round(clip.duration * fps) + 1, places = [], heads = [], looks = [];
for (let t = 0; t < frames; t++) {
  mixer.setTime(t / fps);
  vrm.update(0);
  places.push(...moved());
  heads.push(head.quaternion.toArray());
  looks.push([vrm.lookAt.yaw, vrm.lookAt.pitch]);
}
fs.writeFileSync(out, new Float32Array(places));
console.log(JSON.stringify({ heads, looks, tracks: clip.tracks.map((track) => track.name) }));
"""
)


@pytest.fixture(scope="module")
def head(spoken):
    """The default head as an avatar."""
    anyface("rig", "--out", spoken / "head.vrm")
    return spoken / "head.vrm"


def test_every_expression_moves_what_its_shapes_move(spoken, expected, head):
    read = node(EXPRESSIONS, head, spoken / "expressions.bin", packages=PACKAGES)
    shapes = expected.shapes
    rows = np.fromfile(spoken / "expressions.bin", "<f4").reshape(len(read["names"]), -1, 3)
    moved = dict(zip(read["names"], rows, strict=True))
    for name, shape in shapes.items():
        if not name.startswith("viseme_"):
            custom = moved[name[0].upper() + name[1:]]
            assert np.abs(custom - shape).max() < SAME_M, name
    presets = {
        "aa": ["viseme_aa"], "ih": ["viseme_I"], "ou": ["viseme_U"], "ee": ["viseme_E"],
        "oh": ["viseme_O"], "blink": ["eyeBlinkLeft", "eyeBlinkRight"],
        "blinkLeft": ["eyeBlinkLeft"], "blinkRight": ["eyeBlinkRight"],
        "lookUp": ["eyeLookUpLeft", "eyeLookUpRight"],
        "lookLeft": ["eyeLookOutLeft", "eyeLookInRight"],
    }  # fmt: skip
    for name, parts in presets.items():
        assert np.abs(moved[name] - sum(shapes[part] for part in parts)).max() < 2 * SAME_M, name
    for name in ("happy", "angry", "sad", "relaxed", "surprised"):
        assert np.linalg.norm(moved[name], axis=1).max() > 2e-3, name
    assert len(read["bones"]) == 15 and read["lookAt"] == "expression"
    assert read["meta"]["name"] == "head" and read["meta"]["metaVersion"] == "1"
    # An avatar that gets both `aa` and `JawOpen` opens its mouth only once.
    assert read["aa"] == 0.0


def test_an_avatar_of_somebody_keeps_what_it_has(spoken, expected, head):
    whole = head.read_bytes()
    length = int.from_bytes(whole[12:16], "little")
    document = json.loads(whole[20 : 20 + length])
    vrm = document["extensions"]["VRMC_vrm"]
    vrm["meta"]["name"] = "Mine"
    vrm["expressions"]["custom"] = {"Ears": vrm["expressions"]["custom"]["NoseSneerLeft"]}
    document["materials"][0]["name"] = "Skin by hand"
    text = json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    rest = whole[20 + length :]
    head_of_file = b"glTF" + struct.pack("<III", 2, 20 + len(text) + len(rest), len(text))
    (spoken / "mine.vrm").write_bytes(head_of_file + b"JSON" + text + rest)
    landmarks = json.loads((HEAD / "landmarks.json").read_text())["landmarks"]
    numbers = spoken / "numbers.json"
    numbers.write_text(json.dumps([landmark["vertex"] for landmark in landmarks]))
    said = anyface(
        "rig", "--out", spoken / "again.vrm", mesh=spoken / "mine.vrm", landmarks=numbers
    )
    assert "aa, ih, ou" in said
    read = node(EXPRESSIONS, spoken / "again.vrm", spoken / "again.bin", packages=PACKAGES)
    assert read["meta"]["name"] == "Mine"
    rows = np.fromfile(spoken / "again.bin", "<f4").reshape(len(read["names"]), -1, 3)
    moved = dict(zip(read["names"], rows, strict=True))
    assert np.abs(moved["Ears"] - expected.shapes["noseSneerLeft"]).max() < SAME_M
    for name in ("jawOpen", "mouthSmileLeft", "eyeBlinkRight"):
        custom, shape = moved[name[0].upper() + name[1:]], expected.shapes[name]
        assert np.linalg.norm(custom - shape) < 0.1 * np.linalg.norm(shape), name
    issues = node(VALIDATE, spoken / "again.vrm", packages=VALIDATOR)
    assert issues["numErrors"] == 0, issues["messages"][:5]


def test_a_take_moves_the_avatar_as_the_arrays_do(spoken, expected, head):
    talk = animate(spoken, "talk.vrma")
    read = node(PLAY, head, talk, spoken / "vrma.bin", str(FPS), packages=PACKAGES)
    moved = np.fromfile(spoken / "vrma.bin", "<f4").reshape(expected.skin.shape)
    expected_motion = expected.displacements()
    left, whole = np.square(moved - expected_motion).sum(), np.square(expected_motion).sum()
    assert np.sqrt(left / whole) < 0.3
    turns = expected.arrays["head"]
    angles = np.linalg.norm(turns, axis=1, keepdims=True)
    axes = turns / np.maximum(angles, 1e-9)
    heads = np.hstack([axes * np.sin(angles / 2), np.cos(angles / 2)])
    assert np.abs(turns).max() > 1e-3 and np.abs(np.array(read["heads"]) - heads).max() < 1e-5
    yaw, pitch = np.degrees(expected.arrays["gaze"].mean(axis=1)).T
    looks = np.array(read["looks"])
    assert np.abs(yaw).max() > 0.1
    # In three-vrm a positive pitch looks down.
    assert np.abs(looks - np.stack([yaw, -pitch], axis=1)).max() < 0.05


def test_another_avatar_speaks_by_the_presets(spoken):
    ball.write(spoken / "ball.vrm")
    talk = animate(spoken, "presets.vrma", "--expressions", "vrm")
    play = PLAY.replace("new VRMLookAtQuaternionProxy(vrm.lookAt)", "new THREE.Object3D()")
    play = play.replace("looks.push([vrm.lookAt.yaw, vrm.lookAt.pitch]);", "")
    files = spoken / "ball.vrm", talk, spoken / "ball.bin"
    read = node(play, *files, str(FPS), packages=PACKAGES)
    moved = np.fromfile(spoken / "ball.bin", "<f4").reshape(FPS, -1, 3)
    assert np.abs(moved).max() > 5e-3
    assert not any("Jaw" in name for name in read["tracks"])


def test_shapes_are_shaded_as_they_are_moved(head):
    assert node(SHADED, head, packages=PACKAGES) < 2.0


def test_shapes_of_arkit_play_in_three(spoken, expected):
    glb = animate(spoken, "arkit.glb", "--targets", "arkit")
    names = node(THREE, glb, spoken / "arkit.bin", str(FPS), packages=PACKAGES)
    known = [name for name in expected.shapes if not name.startswith("viseme_")]
    assert names == known
    expected_motion = expected.displacements()
    moved = np.fromfile(spoken / "arkit.bin", "<f4").reshape(expected_motion.shape)
    left, whole = np.square(moved - expected_motion).sum(), np.square(expected_motion).sum()
    assert np.sqrt(left / whole) < 0.3


def test_the_validator_of_khronos_finds_no_error(spoken, head):
    files = [head, animate(spoken, "arkit.glb", "--targets", "arkit"), animate(spoken, "talk.vrma")]
    for path in files:
        issues = node(VALIDATE, path, packages=VALIDATOR)
        assert issues["numErrors"] == 0, issues["messages"][:5]
