"""Writes a microphone recording as a sound file."""

import wave
from itertools import count
from pathlib import Path

import bpy
import numpy as np

from ...core.take import Sound

_FOLDER, _NAME = "sounds", "recording"


def write(sound: Sound) -> Path:
    """Writes `sound` into a new 16-bit WAV file; returns its path.

    The file goes into the folder *sounds* beside the .blend, or into Blender's temporary folder if
    the .blend was never saved. Raises `OSError`.
    """
    saved = bpy.data.filepath
    folder = Path(saved).parent / _FOLDER if saved else Path(bpy.app.tempdir)
    folder.mkdir(parents=True, exist_ok=True)
    samples = np.clip(sound.samples * 32767.0, -32768.0, 32767.0).astype("<i2")
    for number in count(1):
        path = folder / f"{_NAME}_{number:03}.wav"
        try:
            # Another Blender may be recording into the same folder.
            file = path.open("xb")
        except FileExistsError:
            continue
        with file, wave.open(file, "wb") as out:
            out.setnchannels(1)
            out.setsampwidth(2)
            out.setframerate(round(sound.rate_hz))
            out.writeframes(samples.tobytes())
        return path
