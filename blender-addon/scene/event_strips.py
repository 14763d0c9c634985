"""Text strips and timeline markers that are events.

The text of a strip is the expression, its position is the time slot, and its opacity is the
strength. The strip belongs to every character that listens to its channel. If its name contains the
name of one of them, it belongs only to that character. *Add at Playhead* mutes the strips that it
adds, since Blender would render them over the picture. Muted strips still act.

The name of a marker is the expression; `:0.5` after it is the strength. The event begins at the
marker. It ends at a marker named `end`, or `end` and the same expression. Without such a marker it
lasts as long as the character's settings say. It belongs to all characters that listen to markers,
or only to the one that it names.
"""

import re
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path

import numpy as np

from ..core import events, systems
from ..core.errors import AnyfaceError
from ..core.events import Event, Expression
from .animation import curves
from .sound import sequencer, sounds, strips

# An opacity that changes over time is rounded to multiples of this step.
_STEP = 0.05
# The length of a new event, seconds.
LENGTH_S = 0.8


@dataclass
class Row:
    """A strip or a marker as the panel lists it, from frame `first` up to `last`.

    `wrong` says why it has no effect, or only part of it. A marker has no `strip`.
    """

    name: str
    expression: Expression
    first: int
    last: int
    wrong: str = ""
    strip: object = None


@dataclass
class CharacterEvents:
    """The events of a character, and notes about strips and markers that were left out."""

    events: list[Event] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)


def strips_of(scene, channel: int, ob=None) -> list:
    """The text strips of a channel, in time order, without those that show sounds.

    With `ob` it also leaves out strips that name another character of this channel.
    """
    faces, every = others(scene, channel), sequencer.all_strips(scene) if channel else []
    text_strips = [
        s for s in every if s.type == "TEXT" and s.channel == channel and not sounds.shows(s)
    ]
    if ob is not None:
        text_strips = [s for s in text_strips if strips.named_in(s.name, faces) in (None, ob)]
    return sorted(text_strips, key=lambda strip: sequencer.ends(strip)[0])


def marked(scene, ob, settings, models: Path | None = None) -> list[Row]:
    """The markers that may be events of `ob`; none if it does not listen to markers.

    `settings` has `event_markers` and `marker_s`; `models` is the folder of the models. Markers
    that bind a camera or still have their default name from Blender do not count.
    """
    if not settings.event_markers:
        return []
    faces = [other for other in _meshes(scene) if other.anyface_audio.event_markers]
    named = [marker for marker in scene.timeline_markers if _says_something(marker)]
    named = [marker for marker in named if strips.named_in(marker.name, faces) in (None, ob)]
    fps = scene.render.fps / scene.render.fps_base
    length, event_rows, begun = max(1, round(settings.marker_s * fps)), [], []
    for marker in sorted(named, key=lambda marker: marker.frame):
        text = strips.without_name(marker.name, faces)
        ended = events.ended_by(text, [row.expression.said for row in begun])
        if ended is not None:
            row = begun.pop(ended)
            row.last = max(marker.frame, row.first + 1)
            continue
        expression = events.expression(text, models)
        row = Row(marker.name, expression, marker.frame, marker.frame + length)
        event_rows.append(row)
        begun.append(row)
    return event_rows


def _says_something(marker) -> bool:
    by_blender = re.fullmatch(r"(F|Marker)[_. ]?\d*", marker.name)
    return marker.camera is None and not by_blender and bool(marker.name.strip())


def others(scene, channel: int) -> list:
    """The characters that listen to a channel."""
    meshes = _meshes(scene)
    return [ob for ob in meshes if channel and ob.anyface_audio.event_channel == channel]


def _meshes(scene) -> list:
    return [ob for ob in scene.objects if ob.type == "MESH"]


def rows(
    scene,
    ob,
    settings,
    when: tuple[float, float | None] | None = None,
    models: Path | None = None,
) -> list[Row]:
    """The strips and markers that belong to `ob`, in time order, each with its expression.

    `settings` has `event_channel`, `event_markers` and `marker_s`. `when` is the frame at which the
    sound begins, and its length in seconds if that is known. `models` is the folder of the models.
    """
    event_rows = [
        Row(strip.name, events.expression(strip.text, models), *sequencer.ends(strip), strip=strip)
        for strip in strips_of(scene, settings.event_channel, ob)
    ]
    event_rows += marked(scene, ob, settings, models)
    for row in event_rows:
        row.wrong = row.expression.hint
        if not row.wrong and when is not None and _slot(scene, row, *when) is None:
            row.wrong = f"frames {row.first} to {row.last} lie outside the sound"
    return sorted(event_rows, key=lambda row: row.first)


def read(
    scene,
    ob,
    settings,
    start_frame: float,
    duration_s: float | None,
    models: Path | None = None,
) -> CharacterEvents:
    """The events of a character; none if its system does not take events.

    Strips and markers that mean nothing, or lie outside the sound, are left out with a note.
    """
    result = CharacterEvents()
    if not systems.by_name(settings.system).takes_events:
        if settings.event_file:
            raise AnyfaceError("input", "events: expected a system that shows them")
        return result
    if settings.event_file:
        result.events = events.of_file(settings.event_file, models)
        return result
    when = start_frame, duration_s
    for row in rows(scene, ob, settings, when, models):
        if row.wrong:
            result.notes.append(f"the event {row.name} was left out: {row.wrong}")
            continue
        slot = _slot(scene, row, *when)
        said = row.expression
        for start_s, end_s, opacity in _pieces(scene, row, slot, start_frame):
            strength = opacity * said.strength
            event = Event(start_s, end_s, said.units, strength, said.over_speech, row.name)
            result.events.append(event)
    result.notes = events.shortened(result.notes)
    return result


def add(scene, ob, channel: int, text: str, frame: int, strength: float = 1.0):
    """Adds a strip of `ob` at `frame` and returns it.

    It is `LENGTH_S` long, or ends earlier where the next strip of its channel begins. If other
    characters listen to the same channel, its name contains the character's name.
    """
    fps = scene.render.fps / scene.render.fps_base
    last = frame + max(1, round(LENGTH_S * fps))
    behind = [sequencer.ends(strip)[0] for strip in _in_channel(scene, channel)]
    last = min([last, *(first for first in behind if first > frame)])
    shared = any(other != ob for other in others(scene, channel))
    name = f"{ob.name} {text}" if shared else text
    strip = sequencer.new_text(scene, name, channel, frame, last)
    strip.text, strip.blend_alpha = text, strength
    return strip


def is_free(scene, channel: int, frame: int) -> bool:
    """True where no strip of a channel plays at a frame."""
    ends = [sequencer.ends(strip) for strip in _in_channel(scene, channel)]
    return all(not first <= frame < last for first, last in ends)


def free_channel(scene) -> int:
    """The first channel above all strips."""
    return 1 + max((strip.channel for strip in sequencer.all_strips(scene)), default=0)


def _in_channel(scene, channel: int) -> list:
    return [strip for strip in sequencer.all_strips(scene) if strip.channel == channel]


def _slot(scene, row: Row, start_frame: float, duration_s: float | None):
    """The frames of a strip or marker that lie within the sound; None if it lies outside."""
    fps = scene.render.fps / scene.render.fps_base
    ends = np.inf if duration_s is None else start_frame + duration_s * fps
    first, last = max(row.first, start_frame), min(row.last, ends)
    return (first, last) if first < last else None


def _pieces(scene, row: Row, slot, start_frame: float) -> list[tuple[float, float, float]]:
    """Start and end in seconds, and opacity, of each piece of an event.

    A constant opacity gives one piece. An animated opacity gives one piece for each step.
    """
    fps = scene.render.fps / scene.render.fps_base
    first, last = slot
    seconds = [(at - start_frame) / fps for at in (first, last)]
    curve = None if row.strip is None else _opacity_curve(scene, row.strip)
    if curve is None:
        opacity = 1.0 if row.strip is None else float(row.strip.blend_alpha)
        return [(*seconds, opacity)]
    frames = np.arange(np.floor(first), np.ceil(last))
    strengths = [_STEP * round(np.clip(curve.evaluate(at), 0.0, 1.0) / _STEP) for at in frames]
    changes = [0, *(np.flatnonzero(np.diff(strengths)) + 1), len(frames)]
    steps = []
    for begins, ends in pairwise(changes):
        if strengths[begins] == 0.0:
            continue
        start_s = max((frames[begins] - start_frame) / fps, seconds[0])
        end_s = min((frames[ends - 1] + 1 - start_frame) / fps, seconds[1])
        steps.append((float(start_s), float(end_s), float(strengths[begins])))
    return steps


def _opacity_curve(scene, strip):
    """The curve of a strip's opacity, or None; the scene's action holds it."""
    path = f"{strip.path_from_id()}.blend_alpha"
    return curves.find(scene.animation_data, path)
