"""Helpers for the tests of several packages: a voice, and the wheel."""

import os
import subprocess
import wave
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
RATE_HZ = 16000


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


def write_wav(path, samples):
    """Writes samples `[S]` of -1 to 1 as a WAV file, mono, 16 bit."""
    with wave.open(str(path), "wb") as file:
        file.setnchannels(1)
        file.setsampwidth(2)
        file.setframerate(RATE_HZ)
        file.writeframes((samples * 32767).astype("<i2").tobytes())


def find_wheel(folder):
    """The wheel of `ANYFACE_WHEEL`; without it `cargo xtask wheel` builds one in `folder`."""
    path = os.environ.get("ANYFACE_WHEEL")
    if path:
        return Path(path).resolve()
    subprocess.run(["cargo", "xtask", "wheel", "--out", str(folder)], cwd=ROOT, check=True)
    return next(folder.glob("*.whl"))
