"""Reads the sound of a strip or a file: trimmed, mono, with the frame at which it begins."""

import os
import tempfile
from contextlib import contextmanager
from dataclasses import dataclass

import bpy
import numpy as np

from ..core.errors import AnyfaceError
from ..core.take import Sound
from . import sequencer


@dataclass
class PlacedSound:
    """A sound and the scene frame of its first sample."""

    sound: Sound
    start_frame: float


def read_file(path: str, start_frame: float, decode) -> PlacedSound:
    """A sound file; `decode(path)` returns samples `[S]` and their rate in Hz."""
    full = bpy.path.abspath(path)
    if not path or not os.path.isfile(full):
        raise AnyfaceError("audio", f"no sound file at {full or 'an empty path'}")
    samples, rate_hz = decode(full)
    return PlacedSound(Sound(samples, rate_hz, os.path.basename(full)), start_frame)


def read_strip(scene, name: str, decode) -> PlacedSound:
    """The part of a sound strip that plays: trimmed on both sides, retimed, packed or not."""
    strip = sequencer.sound_strip(scene, name)
    start, end = strip.frame_final_start, strip.frame_final_end
    with sound_path(strip.sound) as path:
        samples, rate_hz = decode(path)
    fps = scene.render.fps / scene.render.fps_base
    if sequencer.is_retimed(strip, len(samples) / rate_hz * fps):
        samples, rate_hz = _mix_down(scene, strip, decode)
        return PlacedSound(Sound(samples, rate_hz, name), start)
    # sound_offset (4.3 and later) moves the content inside the strip, in seconds.
    first_s = (start - strip.frame_start) / fps - getattr(strip, "sound_offset", 0.0)
    samples = cut(samples, rate_hz, first_s, first_s + (end - start) / fps)
    return PlacedSound(Sound(samples, rate_hz, name), start)


def cut(samples: np.ndarray, rate_hz: float, first_s: float, last_s: float) -> np.ndarray:
    """The samples from `first_s` to `last_s`; silence where that lies before the first."""
    first, last = round(first_s * rate_hz), round(last_s * rate_hz)
    silence = np.zeros(max(0, min(-first, last - first)), dtype=np.float32)
    return np.concatenate([silence, samples[max(first, 0) : max(last, 0)]])


@contextmanager
def sound_path(sound):
    """The path of a sound's file; a packed sound becomes a temporary file."""
    if sound is None:
        raise AnyfaceError("audio", "the strip holds no sound")
    if sound.packed_file is None:
        path = bpy.path.abspath(sound.filepath, library=sound.library)
        if not os.path.isfile(path):
            raise AnyfaceError("audio", f"{sound.name}: no sound file at {path}")
        yield path
        return
    suffix = os.path.splitext(sound.filepath)[1] or ".wav"
    with tempfile.TemporaryDirectory(prefix="anyface-") as folder:
        path = os.path.join(folder, "packed" + suffix)
        with open(path, "wb") as file:
            file.write(sound.packed_file.data)
        yield path


def _mix_down(scene, strip, decode) -> tuple[np.ndarray, float]:
    """A retimed strip as Blender itself plays it; everything else is muted meanwhile."""
    others = [other for other in sequencer.all_strips(scene) if other != strip]
    muted = [(other, other.mute) for other in others]
    kept = strip.mute, scene.frame_start, scene.frame_end
    with tempfile.TemporaryDirectory(prefix="anyface-") as folder:
        path = os.path.join(folder, "strip.wav")
        try:
            for other in others:
                other.mute = True
            strip.mute = False
            scene.frame_start = strip.frame_final_start
            scene.frame_end = max(strip.frame_final_end - 1, strip.frame_final_start)
            with bpy.context.temp_override(**sequencer.override(scene)):
                bpy.ops.sound.mixdown(
                    filepath=path,
                    container="WAV",
                    codec="PCM",
                    format="S16",
                    channels="MONO",
                    check_existing=False,
                )
        except RuntimeError as error:
            raise AnyfaceError("audio", f"{strip.name}: {str(error).strip()}") from error
        finally:
            for other, mute in muted:
                other.mute = mute
            strip.mute, scene.frame_start, scene.frame_end = kept
        return decode(path)
