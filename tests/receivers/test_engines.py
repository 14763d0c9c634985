"""Compiles the scripts for Unity and Unreal and runs them in hosts that stand in for the engines.

`ANYFACE_COMMAND` names the command. The library must be in the same folder.
"""

import json
import os
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

from conftest import vowels, write_wav

ROOT = Path(__file__).resolve().parents[2]
HERE = Path(__file__).parent
COMMAND = os.environ.get("ANYFACE_COMMAND", str(ROOT / "target/debug/anyface"))
LIBRARIES = Path(COMMAND).parent
RATE_HZ, SECONDS = 16000, 3
EMOTION = "happy:0.8"


@pytest.fixture(scope="module")
def sound(tmp_path_factory):
    """A folder with three seconds of a voice, raw and as WAV, and the command's frames of it."""
    folder = tmp_path_factory.mktemp("engines")
    samples = vowels()[: 2 * SECONDS * RATE_HZ]
    (folder / "voice.raw").write_bytes(samples)
    write_wav(folder / "voice.wav", samples)
    words = ["live", "--input", "-", "--any-sound", "--emotion", EMOTION, "--json"]
    done = subprocess.run([COMMAND, *words], input=samples, capture_output=True, check=True)
    frames = [json.loads(line) for line in done.stdout.splitlines()]
    assert len(frames) == 25 * SECONDS
    return folder, frames


def weights(frames, name):
    """Values of a shape in all frames."""
    return np.array([frame["shapes"][name] for frame in frames])


def run(words, **more):
    """Runs a program; returns the finished process with its output."""
    environment = {**os.environ, "LD_LIBRARY_PATH": str(LIBRARIES)}
    done = subprocess.run(words, capture_output=True, text=True, env=environment, **more)
    assert done.returncode == 0, done.stderr
    return done


def test_the_face_of_unity_is_that_of_the_command(sound):
    if shutil.which("mcs") is None:
        pytest.skip("ignored, needs mono-mcs")
    folder, frames = sound
    scripts = sorted((ROOT / "engines/unity").glob("*.cs"))
    words = ["-warnaserror", "-warn:4", "-nowarn:649", f"-out:{folder}/host.exe"]
    run(["mcs", *words, *scripts, HERE / "unity/Host.cs"])
    done = run(["mono", folder / "host.exe", folder / "voice.raw", str(RATE_HZ), EMOTION])
    assert done.stderr == ""
    lines = np.array([line.split() for line in done.stdout.splitlines()], dtype=float)
    jaw, smile = weights(frames, "jawOpen"), weights(frames, "mouthSmileLeft")
    head = np.array([frame["head"] for frame in frames]) * [1, -1, -1]
    assert np.ptp(jaw) > 0.15 and smile.max() > 0.2
    assert np.abs(lines[:, 0] / 100 - jaw).max() < 1e-6
    assert (lines[:, 1] == 0).all()
    assert np.abs(lines[:, 2] / 100 - smile).max() < 1e-6
    assert np.abs(lines[:, 3:] - head).max() < 1e-6
    wrong = run(["mono", folder / "host.exe", folder / "voice.raw", str(RATE_HZ), "hapy:1"])
    assert wrong.stderr.count("Anyface: ") == 1 and "hapy" in wrong.stderr


def test_the_face_of_unreal_is_that_of_the_command(sound):
    folder, frames = sound
    folders = [HERE / "unreal", ROOT / "engines/unreal", ROOT / "include"]
    words = ["-std=c++20", "-Wall", "-Wextra", "-Wpedantic", "-Werror", "-O1"]
    words += [f"-I{one}" for one in folders] + ["-o", folder / "host", HERE / "unreal/host.cpp"]
    run(["g++", *words, ROOT / "engines/unreal/AnyfaceSpeaker.cpp", f"-L{LIBRARIES}", "-lanyface"])
    done = run([folder / "host", folder / "voice.wav", str(SECONDS), EMOTION])
    assert done.stderr.count("\n") == 1 and "no such file" in done.stderr
    lines = np.array([line.split() for line in done.stdout.splitlines()], dtype=float)
    jaw, smile = weights(frames, "jawOpen"), weights(frames, "mouthSmileLeft")
    # Positive pitch lifts the nose. Positive yaw and roll go to the face's right.
    head = np.rad2deg([frame["head"] for frame in frames]) * [-1, -1, 1]
    assert np.abs(lines[:, 0] - jaw).max() < 1e-6
    assert np.abs(lines[:, 1] - smile).max() < 1e-6
    assert np.abs(lines[:, 2:] - head).max() < 1e-4
