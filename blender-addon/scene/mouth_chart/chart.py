"""A mouth chart from sound to keyframes, in three steps: read, work, write."""

from dataclasses import dataclass

import numpy as np

from ...core import mouth_chart
from ...core.errors import AnyfaceError
from ...core.job import Progress
from ...core.source import SoundSource
from ...core.take import FaceMesh, Request
from .. import bake
from ..animation import emotion
from ..face import sample_head
from ..sound import decode, sounds, strips
from . import entry, outputs
from .outputs import Drawings


@dataclass
class Holds:
    """Mouths change only at every `on`-th frame, and each stays for at least `hold` frames.

    Mouths of closures and of vowels stay for at least `closures` and `vowels` frames instead, where
    these are not 0.
    """

    on: int = 1
    hold: int = 2
    closures: int = 0
    vowels: int = 0


@dataclass
class Snapshot:
    """Everything that `work` needs. `face` is None where the default head speaks."""

    face: FaceMesh | None
    source: SoundSource
    request: Request
    drawings: Drawings
    holds: Holds
    scene_fps: float
    scene_start: int
    engine: object
    closed: list | None = None

    def work(self, progress: Progress) -> "Chart":
        """Makes the chart; raises `AnyfaceError`. If no face is found, the default head speaks."""
        progress.check("sound")
        voice = self.source.load(decode.decoder(self.engine))
        if self.closed is not None:
            lips = [[a, b] for a, b, label in self.closed if self.engine.closes_lips(label)]
            closures = np.array(lips).reshape(-1, 2)
            self.request = self.request.with_fields(closures=closures)
        note = ""
        if self.face is not None:
            try:
                return Chart(self._draw(self.face.space.to_library(self.face), voice, progress))
            except AnyfaceError as error:
                if error.kind != "face":
                    raise
                note = f"no face was found on {self.face.name}: the default head spoke"
        head = (*sample_head.points_and_triangles(sample_head.HEIGHT), None, None)
        return Chart(self._draw(head, voice, progress), note)

    def _draw(self, face: tuple, voice, progress: Progress) -> list:
        holds = self.holds
        return self.engine.chart(
            *face, voice, self.request, progress, self.drawings.kind, holds.on, holds.hold,
            closure_hold=holds.closures, vowel_hold=holds.vowels,
        )  # fmt: skip


@dataclass
class Chart:
    """The start and end (seconds) and the name of each mouth, and a note for the report."""

    mouths: list[tuple[float, float, str]]
    note: str = ""


def read(ob, scene, settings: bake.Settings, drawings: Drawings, holds: Holds, engine):
    """Reads the sound of `ob`, and its face if it is a mesh.

    Raises `AnyfaceError` with a message.
    """
    outputs.check(drawings)
    outputs.check_editable(drawings)
    source = bake.find_sound(scene, settings, engine)
    fps = scene.render.fps / scene.render.fps_base
    keys = emotion.control_keys(ob, scene, settings, source.start_frame, strips.duration_s(source))
    request = Request(
        fps,
        bake.words_and_numbers(settings) | {"emotion": "off"},
        controls=settings.controls,
        control_keys=keys,
    )
    is_face = ob.type == "MESH" and len(ob.data.polygons) > 0
    face = bake.read_face(ob, settings, editable=False) if is_face else None
    request.roles = face.roles if face is not None else None
    return Snapshot(
        face, source, request, drawings, holds, fps, scene.frame_start, engine,
        sounds.read(scene, source),
    )  # fmt: skip


def write(ob, snapshot: Snapshot, chart: Chart) -> str:
    """Writes the keyframes of the drawings; returns one line about what it wrote.

    It first removes the earlier chart of `ob`, and any chart on the same drawings. If it raises
    `AnyfaceError`, nothing has changed.
    """
    drawings = snapshot.drawings
    outputs.check(drawings)
    start, fps = snapshot.source.start_frame, snapshot.scene_fps
    changes = mouth_chart.changes(drawings.kind, chart.mouths, start, fps, snapshot.scene_start)
    if not changes:
        raise AnyfaceError("audio", "the sound has no frame to draw a mouth in")
    if drawings.output != outputs.PENCIL:
        existing = outputs.channels(drawings, changes) if _is_there(drawings) else []
        entry.check_free(existing)
    remove(ob)
    for other in outputs.shown_on(drawings):
        entry.take_off(other)
    additions = outputs.make(drawings)
    frames = np.array([frame for frame, _ in changes], dtype=float)
    by_object: dict = {}
    for channel in outputs.channels(drawings, changes):
        by_object.setdefault(channel.ob, []).append(channel)
    for channels in by_object.values():
        entry.put(ob, channels, frames, **additions)
    drawn = len({mouth for _, mouth in changes})
    said = f"{len(changes)} mouths, {drawn} of {len(mouth_chart.MOUTHS[drawings.kind])} are used"
    return f"{said} ({chart.note})" if chart.note else said


def _is_there(drawings: Drawings) -> bool:
    """False for a custom property that will only be added with the chart."""
    return drawings.output != outputs.NUMBER or not outputs.is_new_property(drawings)


def remove(ob) -> int:
    """Removes the chart of a character from all objects that show it; returns their number."""
    return sum(entry.take_off(other) for other in entry.shown_by(ob))
