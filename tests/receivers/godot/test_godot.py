"""Godot 4 receives a live face with docs/examples/anyface.gd, and opens a take.

`ANYFACE_GODOT` names the program that runs Godot 4. Without it these tests are skipped.
"""

import json
import os
import shutil
import subprocess
import threading
import time
from pathlib import Path

import numpy as np
import pytest

from conftest import vowels, write_wav

ROOT = Path(__file__).resolve().parents[3]
COMMAND = os.environ.get("ANYFACE_COMMAND", str(ROOT / "target/debug/anyface"))
GODOT = os.environ.get("ANYFACE_GODOT")
RATE_HZ, FPS = 16000, 25
SHAPES = ["jawOpen", "eyeBlinkLeft", "mouthSmileLeft"]
NEAR_M = 1e-5

pytestmark = pytest.mark.skipif(not GODOT, reason="ignored, needs ANYFACE_GODOT")


@pytest.fixture
def project(tmp_path):
    """The folder of a Godot project."""
    (tmp_path / "project.godot").write_text("config_version=5\n")
    for script in Path(__file__).parent.glob("*.gd"):
        shutil.copy(script, tmp_path)
    shutil.copy(ROOT / "docs/examples/anyface.gd", tmp_path)
    return tmp_path


def godot(project, script, *words):
    """Starts a process that runs a script of the project."""
    return subprocess.Popen(
        [GODOT, "--headless", "--path", project, "--script", f"res://{script}", "--", *words],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip


class Lines(threading.Thread):
    """Collects the JSON objects that a process writes, one per line."""

    def __init__(self, pipe):
        super().__init__(daemon=True)
        self._pipe, self.all = pipe, []
        self.start()

    def run(self):
        """Reads until the process ends."""
        self.all.extend(json.loads(line) for line in self._pipe if line.startswith("{"))

    def wait(self, count, seconds=60.0):
        """Waits until there are `count` objects."""
        end = time.monotonic() + seconds
        while len(self.all) < count:
            assert time.monotonic() < end, f"{len(self.all)} of {count} lines came"
            time.sleep(0.02)


def rotation(vector):
    """Quaternion x, y, z, w of a rotation vector."""
    angle = np.linalg.norm(vector)
    axis = np.array(vector) / max(angle, 1e-12)
    return np.append(np.sin(angle / 2) * axis, np.cos(angle / 2))


def test_a_mesh_follows_the_live_face(project):
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    words = ["live", "--input", "-", "--any-sound", "--emotion", "happy:1", "--json"]
    live = subprocess.Popen([COMMAND, *words, "--websocket", "127.0.0.1:0"], **pipes)
    address = live.stderr.readline().decode().split()[-1].strip('"}').rstrip(".")
    engine = godot(project, "follow.gd", address)
    sent, shown = Lines(map(bytes.decode, live.stdout)), Lines(engine.stdout)
    try:
        shown.wait(1)
        sound, block = vowels()[: 2 * 3 * RATE_HZ], 2 * RATE_HZ // FPS
        begun = time.monotonic()
        for number, first in enumerate(range(0, len(sound), block)):
            time.sleep(max(0.0, begun + number / FPS - time.monotonic()))
            live.stdin.write(sound[first : first + block])
            live.stdin.flush()
        sent.wait(len(sound) // block - 10)
        time.sleep(0.5)
    finally:
        for process in (engine, live):
            process.kill()
            process.wait()
    weights = np.array([[frame["shapes"][name] for name in SHAPES] for frame in sent.all])
    turns = np.array([rotation(frame["head"]) for frame in sent.all])
    moving = [one for one in shown.all if one["weights"][2] > 0.0]
    assert np.ptp([one["weights"][0] for one in moving]) > 0.2
    # Every pose that Godot shows is a frame that was sent, including the turn of the head.
    frames = []
    for one in moving:
        off = np.abs(weights - one["weights"]).max(axis=1)
        assert off.min() < 1e-5
        frames.append(off.argmin())
        turn = np.array(one["turn"]) * np.copysign(1.0, one["turn"][3])
        assert np.abs(turns[frames[-1]] - turn).max() < 1e-4
    assert len(set(frames)) > len(weights) / 3


def test_a_node_speaks_with_its_player(project):
    library = Path(COMMAND).with_name("libanyface_godot.so")
    if not library.is_file():
        pytest.skip("ignored, needs cargo build -p anyface-godot")
    addon = project / "addons/anyface"
    addon.mkdir(parents=True)
    shutil.copy(library, addon)
    shutil.copy(ROOT / "engines/godot/anyface.gdextension", addon)
    # The editor would write this list when it sees the extension.
    (project / ".godot").mkdir()
    listed = "res://addons/anyface/anyface.gdextension\n"
    (project / ".godot/extension_list.cfg").write_text(listed)
    samples = vowels()[: 2 * 3 * RATE_HZ]
    write_wav(project / "voice.wav", samples)
    words = ["live", "--input", "-", "--any-sound", "--emotion", "happy:1", "--json"]
    live = subprocess.run([COMMAND, *words], input=samples, capture_output=True, check=True)
    frames = [json.loads(line) for line in live.stdout.splitlines()]
    engine = godot(project, "speaker.gd", project / "voice.wav", "happy:1")
    out, err = engine.communicate(timeout=60)
    assert "ERROR" not in err, err
    lines = [json.loads(line) for line in out.splitlines() if line.startswith("{")]
    every = [line["all"] for line in lines if "all" in line]
    shown = [line for line in lines if "place" in line]
    # Godot's mixer works at 44.1 kHz, so the sound is not the same bit for bit.
    for name in (*SHAPES, "viseme_aa"):
        kind = "visemes" if name.startswith("viseme") else "shapes"
        sent = [frame[kind][name] for frame in frames]
        assert np.abs(np.array([one[name] for one in every]) - sent).max() < 0.05
    jaw = np.array([frame["shapes"]["jawOpen"] for frame in frames])
    moved = np.array([one["weights"][0] for one in shown])
    assert np.ptp(moved) > 0.2
    # The face is in time with the sound, within a mixed block of some hundredths of a second.
    places = np.array([one["place"] for one in shown])
    late_s = np.arange(-0.1, 0.101, 0.01)
    off = [
        np.abs(np.interp(25 * (places + late), range(len(jaw)), jaw) - moved).mean()
        for late in late_s
    ]
    assert abs(late_s[np.argmin(off)]) < 0.05 and min(off) < 0.02
    # An unknown emotion is reported once.
    wrong = godot(project, "speaker.gd", project / "voice.wav", "hapy:1")
    out, _ = wrong.communicate(timeout=60)
    assert out.count("failed") == 1 and "hapy" in out
    # So is a sound that cannot be decoded, while the scene goes on.
    endless = godot(project, "speaker.gd", "endless", "happy:1")
    out, err = endless.communicate(timeout=60)
    assert out.count("failed") == 1 and "length" in out, out
    assert out.count("place") > 5 and "panicked" not in err, err


def test_every_vertex_of_a_take_moves_as_the_arrays_do(project, spoken, expected):
    # Godot may run in a chroot that sees only temporary files.
    shutil.copy(spoken / "talk.glb", project)
    displacements = expected.displacements()
    count = len(displacements)
    words = [project / "talk.glb", project / "places", str(count), str(FPS)]
    out, err = godot(project, "positions.gd", *words).communicate(timeout=120)
    assert "ERROR" not in err, err
    read = next(json.loads(line) for line in out.splitlines() if line.startswith("{"))
    assert read["vertices"] == displacements.shape[1] and read["shapes"] > 5
    places = np.fromfile(project / "places", "<f4").reshape(count, -1, 3)
    moved = places - expected.rest
    assert np.abs(displacements).max() > 1e-3
    assert np.linalg.norm(moved - displacements, axis=2).max() < NEAR_M
