"""Unpacks the wheel, as pip does, and hands it to the tests.

`ANYFACE_WHEEL` names the wheel; without it `cargo xtask wheel` builds one.
"""

import importlib
import os
import subprocess
import sys
import wave
import zipfile
from pathlib import Path

import numpy as np
import pytest

ROOT = Path(__file__).resolve().parents[2]
HEAD = ROOT / "weights/shared/default_head/head.obj"
RATE_HZ = 16000


@pytest.fixture(scope="session")
def wheel(tmp_path_factory):
    """The wheel under test."""
    given = os.environ.get("ANYFACE_WHEEL")
    if given:
        return Path(given).resolve()
    out = tmp_path_factory.mktemp("wheel")
    subprocess.run(["cargo", "xtask", "wheel", "--out", str(out)], cwd=ROOT, check=True)
    return next(out.glob("*.whl"))


@pytest.fixture(scope="session")
def anyface(wheel, tmp_path_factory):
    """The package of the wheel; what it keeps of meshes goes to a folder of its own."""
    os.environ["XDG_CACHE_HOME"] = str(tmp_path_factory.mktemp("cache"))
    site = tmp_path_factory.mktemp("site")
    zipfile.ZipFile(wheel).extractall(site)
    sys.path.insert(0, str(site))
    package = importlib.import_module("anyface")
    assert package.__file__.startswith(str(site))
    return package


def spoken(seconds=1.5):
    """Samples `[S]` of a buzz of 120 Hz through the formants of a, four syllables a second."""
    time = np.arange(int(seconds * RATE_HZ)) / RATE_HZ
    samples = np.zeros(len(time))
    for number in range(1, 40):
        hertz = 120.0 * number
        strength = sum(1.0 / (1.0 + ((hertz - f) / 90.0) ** 2) for f in (730.0, 1090.0, 2440.0))
        samples += strength * np.sin(2 * np.pi * hertz * time)
    samples *= np.clip(np.sin(2 * np.pi * 4.0 * time), 0.0, None)
    return (0.5 * samples / np.abs(samples).max()).astype(np.float32)


@pytest.fixture(scope="session")
def voice(tmp_path_factory):
    """A WAV file of `spoken`, 16 bit."""
    path = tmp_path_factory.mktemp("voice") / "voice.wav"
    with wave.open(str(path), "wb") as file:
        file.setnchannels(1)
        file.setsampwidth(2)
        file.setframerate(RATE_HZ)
        file.writeframes((spoken() * 32767).astype("<i2").tobytes())
    return path


@pytest.fixture(scope="session")
def clip(anyface, voice):
    """The default head, speaking."""
    return anyface.animate(HEAD, voice, fps=25, weights=True)
