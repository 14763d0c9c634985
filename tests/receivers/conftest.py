"""Helpers for the tests of receivers: a take, and programs by other authors.

`ANYFACE_COMMAND` names the command. Without it the tests run the one that `cargo build` makes.
"""

import fcntl
import json
import os
import shutil
import subprocess
import wave
from pathlib import Path

import numpy as np
import pytest

ROOT = Path(__file__).resolve().parents[2]
COMMAND = os.environ.get("ANYFACE_COMMAND", str(ROOT / "target/debug/anyface"))
HEAD = ROOT / "weights/shared/default_head"
PACKAGES = ROOT / "target/npm"
RATE_HZ, SECONDS, FPS = 16000, 1.0, 25
NEAR_M = 1e-5
"""Tolerance in metres, for the default head, which is of human size."""
VALIDATOR, THREE_JS = ("gltf-validator@2.0.0-dev.3.10",), ("three@0.170.0",)

VALIDATE = """
import validator from 'gltf-validator';
import fs from 'fs';
validator.validateBytes(new Uint8Array(fs.readFileSync(process.argv[1])))
  .then(report => console.log(JSON.stringify(report.issues)));
"""
THREE = """
import * as THREE from 'three';
import { GLTFLoader } from 'three/addons/loaders/GLTFLoader.js';
import fs from 'fs';
globalThis.self = globalThis;
const [glb, out, fps] = process.argv.slice(1);
const gltf = await new GLTFLoader().parseAsync(new Uint8Array(fs.readFileSync(glb)).buffer, '');
let face;
gltf.scene.traverse((object) => { if (object.isMesh) face = object; });
const mixer = new THREE.AnimationMixer(gltf.scene), clip = gltf.animations[0];
const action = mixer.clipAction(clip);
action.setLoop(THREE.LoopOnce);
action.clampWhenFinished = true;
action.play();
const count = face.geometry.attributes.position.count, frames = Math.round(clip.duration * fps) + 1;
const moved = new Float32Array(frames * count * 3);
const place = new THREE.Vector3(), rest = new THREE.Vector3();
for (let t = 0; t < frames; t++) {
  mixer.setTime(t / fps);
  for (let v = 0; v < count; v++) {
    rest.fromBufferAttribute(face.geometry.attributes.position, v);
    face.getVertexPosition(v, place).sub(rest).toArray(moved, 3 * (t * count + v));
  }
}
fs.writeFileSync(out, moved);
console.log(JSON.stringify(Object.keys(face.morphTargetDictionary)));
"""


def anyface(task, *words, mesh=HEAD / "head.obj", landmarks=HEAD / "landmarks.json") -> str:
    """Runs the command, by default on the default head; returns its output."""
    head_options = ["--mesh", mesh, "--landmarks", landmarks]
    done = subprocess.run(
        [COMMAND, task, *head_options, *words], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    return done.stdout + done.stderr


def write_wav(path: Path, samples: bytes) -> None:
    """Writes 16-bit samples to a mono WAV file."""
    with wave.open(str(path), "wb") as file:
        file.setnchannels(1)
        file.setsampwidth(2)
        file.setframerate(RATE_HZ)
        file.writeframes(samples)


# The first two formants in hertz (None is a pause), and the duration in seconds.
SOUNDS = [((730, 1090), 1.5), (None, 1.5), ((300, 870), 1.5), (None, 4.0)]


def vowels() -> bytes:
    """Samples of vowels and pauses, 16 bit."""
    parts = []
    for formants, seconds in SOUNDS:
        time_s = np.arange(int(seconds * RATE_HZ)) / RATE_HZ
        pitch = 120 * (1 + 0.1 * np.sin(5.6 * time_s))
        phase = 2 * np.pi * np.cumsum(pitch) / RATE_HZ
        sound = np.zeros_like(time_s)
        for k in range(1, 30) if formants else ():
            near = sum(np.exp(-(((k * pitch - hz) / 150) ** 2)) for hz in formants)
            sound += near * np.sin(k * phase)
        parts.append(0.2 * sound)
    return (np.concatenate(parts) * 32767).astype("<i2").tobytes()


def animate(folder: Path, name: str, *words) -> Path:
    """Writes a take of the voice in the folder; returns its path."""
    voice = ["--audio", folder / "voice.wav", "--fps", str(FPS)]
    anyface("animate", *voice, "--out", folder / name, *words)
    return folder / name


@pytest.fixture(scope="session")
def spoken(tmp_path_factory):
    """A folder with a take of the default head: talk.glb, talk.usda, talk.npz, talk.wav."""
    folder = tmp_path_factory.mktemp("scenes")
    time = np.arange(int(SECONDS * RATE_HZ)) / RATE_HZ
    buzz = sum(np.sin(2 * np.pi * 120 * k * time) / k for k in range(1, 20))
    samples = 0.15 * buzz * np.clip(np.sin(2 * np.pi * 4.0 * time), 0.0, None)
    write_wav(folder / "voice.wav", (samples * 32767).astype("<i2").tobytes())
    for name in ("talk.glb", "talk.usda", "talk.npz"):
        animate(folder, name)
    return folder


class Expected:
    """Expected positions of vertices: the skin as in the arrays, and eyes that follow the gaze."""

    def __init__(self, folder: Path):
        self.arrays = np.load(folder / "talk.npz")
        if not (folder / "rig.npz").is_file():
            anyface("rig", "--out", folder / "rig.npz")
        rig = np.load(folder / "rig.npz")
        self.shapes = dict(zip(rig["names"].tolist(), rig["deltas"], strict=True))
        self.rest = rig["neutral"]
        self.skin = self.arrays["displacements"]

    def displacements(self) -> np.ndarray:
        """`[T, V, 3]`. The arrays leave the eyeballs at rest; this adds their motion."""
        moved = self.skin.copy()
        rests = ~self.skin.any(axis=(0, 2))
        for name, weights in self.looks().items():
            moved[:, rests] += weights[:, None, None] * self.shapes[name][rests]
        return moved

    def looks(self) -> dict[str, np.ndarray]:
        """Weights `[T]` of shapes that turn the eyes; 1 is 30 degrees sideways, 25 up or down."""
        looks = {}
        for eye, (side, left, right) in enumerate((("Right", "In", "Out"), ("Left", "Out", "In"))):
            yaw, pitch = np.degrees(self.arrays["gaze"][:, eye]).T
            ways = {left: yaw / 30, right: -yaw / 30, "Up": pitch / 25, "Down": -pitch / 25}
            for way, weights in ways.items():
                looks[f"eyeLook{way}{side}"] = np.clip(weights, 0, 1)
        return looks


@pytest.fixture(scope="session")
def expected(spoken):
    """Expected positions of vertices in the take."""
    return Expected(spoken)


def node(code: str, *words, packages: tuple[str, ...]):
    """Runs a module in node; returns its JSON output. Packages are fetched from npm once."""
    if shutil.which("npm") is None:
        pytest.skip("ignored, needs npm")
    names = [package.rsplit("@", 1)[0] for package in packages]
    PACKAGES.mkdir(parents=True, exist_ok=True)
    with open(PACKAGES / ".lock", "w") as lock:
        # Tests run in several processes, and npm makes a package's folder before its files.
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not all((PACKAGES / "node_modules" / name).is_dir() for name in names):
            install = ["npm", "install", "--silent", "--no-audit", "--prefix", str(PACKAGES)]
            if subprocess.run([*install, *packages], check=False).returncode:
                pytest.skip(f"ignored, npm cannot fetch {' '.join(packages)}")
    done = subprocess.run(
        ["node", "--input-type=module", "-e", code, *words],
        cwd=PACKAGES, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr[-2000:]
    return json.loads(done.stdout)
