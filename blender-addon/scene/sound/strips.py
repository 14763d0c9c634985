"""Several sound strips as one take, and the length of a sound for the panel."""

import math
import os
import re
import wave
from dataclasses import dataclass
from functools import lru_cache

import bpy

from ...core.errors import AnyfaceError
from ...core.source import Decode, MixedSource
from . import sequencer, sound_source


def chosen(scene, names: list[str], channel: int) -> list:
    """The strips called `names`, or else all sound strips of a channel, first to last.

    Raises `AnyfaceError("audio")` if there are none.
    """
    strips = sequencer.sound_strips(scene)
    if names:
        selection = [sequencer.sound_strip(scene, name) for name in names]
        return sorted(selection, key=lambda strip: sequencer.ends(strip)[0])
    selection = [strip for strip in strips if strip.channel == channel]
    if not selection:
        known = ", ".join(str(n) for n in sorted({strip.channel for strip in strips})) or "none"
        raise AnyfaceError(
            "audio",
            f"no sound strip on channel {channel} of {scene.name} (there are some on {known})",
        )
    return selection


def named_in(name: str, objects: list):
    """The object whose name occurs in a strip's name, or None. The longest name wins."""
    said, named = f" {_words(name)} ", [ob for ob in objects if _words(ob.name)]
    named = [ob for ob in named if f" {_words(ob.name)} " in said]
    return max(named, key=lambda ob: len(ob.name), default=None)


def without_name(name: str, objects: list) -> str:
    """Removes an object's name from a name: "Anna: smile" becomes "smile"."""
    ob = named_in(name, objects)
    if ob is None:
        return name
    letters = r"[\W_]*".join(map(re.escape, _words(ob.name).split()))
    return re.sub(rf"(?i)[\W_]*{letters}[\s:_.-]*", " ", name, count=1).strip()


def _words(name: str) -> str:
    """Splits a name into words: "Anna_01.wav" becomes "anna 01 wav"."""
    return " ".join(re.findall(r"[^\W\d_]+|\d+", name.lower()))


def as_one(scene, strips: list, decode: Decode) -> MixedSource:
    """Combines strips as they play, each at its place. Muted strips are left out with a note.

    Raises `AnyfaceError("audio")` if all are muted.
    """
    audible = [strip for strip in strips if not strip.mute]
    muted = [strip.name for strip in strips if strip.mute]
    if not audible:
        text = f"all chosen strips are muted ({', '.join(muted)}): unmute one"
        raise AnyfaceError("audio", text, ("unmute",))
    fps = scene.render.fps / scene.render.fps_base
    parts = [sound_source.from_strip(scene, strip.name, decode) for strip in audible]
    start = min(part.start_frame for part in parts)
    places = [(part.start_frame - start) / fps for part in parts]
    name = audible[0].name if len(audible) == 1 else f"{len(audible)} strips"
    notes = [f"muted and left out: {', '.join(muted)}"] if muted else []
    return MixedSource(parts, places, name, start, notes)


@dataclass
class Length:
    """The length of a sound for the panel: scene frames (`last` is not included) and seconds."""

    first: float
    last: float
    seconds: float

    def __str__(self) -> str:
        # The last frame that still has sound.
        last = max(math.ceil(self.last) - 1, math.floor(self.first))
        return f"frames {self.first:g} to {last}, {self.seconds:.2f} s"


def length_of(scene, strips: list, with_muted: bool = False) -> Length | None:
    """Where strips begin and end; None if there are none. Muted ones count only if `with_muted`."""
    audible = [strip for strip in strips if with_muted or not strip.mute]
    if not audible:
        return None
    ends = [sequencer.ends(strip) for strip in audible]
    first, last = min(start for start, _ in ends), max(end for _, end in ends)
    return Length(first, last, (last - first) * scene.render.fps_base / scene.render.fps)


def length_of_file(scene, path: str, start_frame: float) -> Length | None:
    """The length of a sound file that begins at `start_frame`; None if it is not known yet."""
    seconds = seconds_of(path)
    if seconds is None:
        return None
    frames = seconds * scene.render.fps / scene.render.fps_base
    return Length(start_frame, start_frame + round(frames, 2), seconds)


def seconds_of(path: str) -> float | None:
    """The length of a sound file in seconds; None if only decoding can tell."""
    full = bpy.path.abspath(path)
    if not path or not os.path.isfile(full):
        return None
    return _seconds(full, os.stat(full).st_mtime_ns)


def duration_s(source) -> float | None:
    """The length of a `SoundSource` or `MixedSource` in seconds; None if it is not known yet."""
    known = source.duration_s
    return seconds_of(getattr(source, "path", "")) if known is None else known


@lru_cache(maxsize=32)
def _seconds(path: str, _changed: int) -> float | None:
    """The length of a sound file from its header; cached, since every redraw asks for it."""
    try:
        with wave.open(path, "rb") as file:
            return file.getnframes() / file.getframerate()
    except (wave.Error, EOFError, OSError, ZeroDivisionError):
        pass
    try:
        import aud

        sound_file = aud.Sound(path)
        return sound_file.length / sound_file.specs[0]
    except Exception:
        # The panel must draw, whatever the decoder raises. Generate reports the error.
        return None
