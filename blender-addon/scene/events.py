"""Text strips that are events: their text the expression, their place the slot, their opacity the
strength.

A strip belongs to the characters that name its channel; where the name of one of them stands in its
own, to that one alone. Those of *Add at Playhead* are muted, for
Blender would render them over the picture; muted strips act all the same.
"""

from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np

from ..core import events, systems
from ..core.events import Event, Understood
from . import curves, sequencer, sounds, strips

# Steps in which an opacity that changes over time is followed.
_STEP = 0.05
# How long a new event is, seconds.
LENGTH_S = 0.8
# The largest strength that the library takes.
MAX_STRENGTH = 2.0


@dataclass
class Row:
    """A strip as the panel lists it; `wrong` says in words why it does nothing, or not all."""

    strip: object
    understood: Understood
    wrong: str


@dataclass
class Found:
    """The events of a character, and what is to be said of strips that are none."""

    events: list[Event] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)


def strips_of(scene, channel: int, ob=None) -> list:
    """The text strips of a channel, first to last; those that show sounds are left out.

    With `ob` those that name another character of this channel are left out too.
    """
    faces, every = others(scene, channel), sequencer.all_strips(scene) if channel else []
    found = [s for s in every if s.type == "TEXT" and s.channel == channel and not sounds.shows(s)]
    if ob is not None:
        found = [s for s in found if strips.named_in(s.name, faces) in (None, ob)]
    return sorted(found, key=lambda strip: sequencer.ends(strip)[0])


def others(scene, channel: int) -> list:
    """The characters whose events lie in a channel."""
    meshes = [ob for ob in scene.objects if ob.type == "MESH"]
    return [ob for ob in meshes if channel and ob.anyface_audio.event_channel == channel]


def rows(scene, ob, channel: int, when: tuple[float, float | None] | None = None) -> list[Row]:
    """Each strip of a channel that is `ob`'s, with what is understood of it.

    `when` is the frame at which the sound begins, and its seconds where they are known.
    """
    found = []
    for strip in strips_of(scene, channel, ob):
        understood = events.understand(strip.text, systems.units(), systems.words)
        wrong = understood.hint
        if not wrong and when is not None and _slot(scene, strip, *when) is None:
            first, last = sequencer.ends(strip)
            wrong = f"frames {first} to {last} lie outside the sound"
        found.append(Row(strip, understood, wrong))
    return found


def read(scene, ob, settings, start_frame: float, duration_s: float | None) -> Found:
    """The events of a character for a system that takes them; none for others.

    Strips that say nothing, or lie outside the sound, are named and left out.
    """
    found, channel = Found(), settings.event_channel
    if not channel or not systems.takes_events(settings.system):
        return found
    when = start_frame, duration_s
    for row in rows(scene, ob, channel, when):
        if row.wrong:
            found.notes.append(f"the event {row.strip.name} was left out: {row.wrong}")
            continue
        slot = _slot(scene, row.strip, *when)
        for start_s, end_s, strength in _pieces(scene, row.strip, slot, start_frame):
            units, over = row.understood.units, row.understood.over_speech
            strength = min(strength * row.understood.strength, MAX_STRENGTH)
            event = Event(start_s, end_s, units, strength, over, row.strip.name)
            found.events.append(event)
    found.notes = events.shortened(found.notes)
    return found


def add(scene, ob, channel: int, text: str, frame: int, strength: float = 1.0):
    """A new strip of `ob` at `frame`, which ends where the next one of its channel begins; it names
    the character where others have the same channel. Returns it."""
    fps = scene.render.fps / scene.render.fps_base
    last = frame + max(1, round(LENGTH_S * fps))
    behind = [sequencer.ends(strip)[0] for strip in _in_channel(scene, channel)]
    last = min([last, *(first for first in behind if first > frame)])
    shared = any(other != ob for other in others(scene, channel))
    name = f"{ob.name} {text}" if shared else text
    strip = sequencer.new_text(scene, name, channel, frame, last)
    strip.text, strip.mute, strip.blend_alpha = text, True, strength
    return strip


def is_free(scene, channel: int, frame: int) -> bool:
    """True where no strip of a channel plays at a frame."""
    ends = [sequencer.ends(strip) for strip in _in_channel(scene, channel)]
    return all(not first <= frame < last for first, last in ends)


def free_channel(scene) -> int:
    """The first channel above everything that is there."""
    return 1 + max((strip.channel for strip in sequencer.all_strips(scene)), default=0)


def _in_channel(scene, channel: int) -> list:
    return [strip for strip in sequencer.all_strips(scene) if strip.channel == channel]


def _slot(scene, strip, start_frame: float, duration_s: float | None):
    """The frames of a strip that lie in the sound; None where none does."""
    fps = scene.render.fps / scene.render.fps_base
    first, last = sequencer.ends(strip)
    ends = np.inf if duration_s is None else start_frame + duration_s * fps
    first, last = max(first, start_frame), min(last, ends)
    return (first, last) if first < last else None


def _pieces(scene, strip, slot, start_frame: float) -> list[tuple[float, float, float]]:
    """Start and end in seconds, and strength: one piece, or as many as the opacity has steps."""
    fps = scene.render.fps / scene.render.fps_base
    first, last = slot
    seconds = [(at - start_frame) / fps for at in (first, last)]
    curve = _opacity_curve(scene, strip)
    if curve is None:
        return [(*seconds, float(strip.blend_alpha))]
    frames = np.arange(np.floor(first), np.ceil(last))
    strengths = [_STEP * round(np.clip(curve.evaluate(at), 0.0, 1.0) / _STEP) for at in frames]
    changes = [0, *(np.flatnonzero(np.diff(strengths)) + 1), len(frames)]
    found = []
    for begins, ends in pairwise(changes):
        if strengths[begins] == 0.0:
            continue
        start_s = max((frames[begins] - start_frame) / fps, seconds[0])
        end_s = min((frames[ends - 1] + 1 - start_frame) / fps, seconds[1])
        found.append((float(start_s), float(end_s), float(strengths[begins])))
    return found


def _opacity_curve(scene, strip):
    """The keyframes of a strip's opacity, which lie in the scene's action, or None."""
    path = f"{strip.path_from_id()}.blend_alpha"
    return curves.find(scene.animation_data, path)
