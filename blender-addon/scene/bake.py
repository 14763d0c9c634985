"""One character from settings to keys, in three steps: read, work, write.

`read` and `write` touch Blender's data, so they belong to the main thread. `Snapshot.work` does
not, so any thread may run it.
"""

from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from functools import partial

import bpy
import numpy as np

from ..core import holding, measure, perform, plan, sparse, systems, wording
from ..core.emotion import Share
from ..core.errors import AnyfaceError
from ..core.job import BEGUN, Progress, at_once
from ..core.native_live import StreamedFace
from ..core.plan import Plan
from ..core.source import SoundSource
from ..core.take import WORD_OF_SOURCE, FaceMesh, Request, Sound, Take, WrittenFile
from . import event_strips, identity, live, outputs
from .animation import emotion
from .face import mesh, opening, pieces, sample_head
from .life import head_and_eyes
from .life.settings import LifeSettings
from .outputs import OutputSettings
from .shape_keys import guard
from .sound import decode, sound_source, sounds, strips
from .takes import corrections, panel_settings, take_list, together

NO_SOUND = "no sound: choose a strip or a sound file"


@dataclass
class Settings:
    """An artist's request: the fields of `ui.properties.AnyfaceCharacter` as plain data.

    `strip` or `sound_file` is set. `fps` 0 means the frame rate of the scene. `system` is a name
    from `core.systems`; "" means the default one. `fields` holds values by the names of
    `core.systems.plain_fields`, for recordings the paths of their files. `controls` holds values by
    name, and `fixed_controls` override these and their keyframes. `mixture` holds further emotions
    beside `emotion`. `blend` holds strengths `[15]` that override all emotions and their keyframes.
    """

    strip: str = ""
    sound_file: str = ""
    start_frame: int = 1
    emotion_source: str = "GIVEN"
    emotion: str = "neutral"
    intensity: float = 1.0
    mixture: list[Share] = field(default_factory=list)
    blend: list[float] | None = None
    fields: dict[str, object] = field(default_factory=dict)
    fps: float = 0.0
    system: str = ""
    controls: dict[str, float] = field(default_factory=dict)
    fixed_controls: dict[str, float] = field(default_factory=dict)
    mode: str = outputs.MODES[0]
    error_mm: float = 0.1
    # Whether new keys follow controls and are named after them.
    named_keys: bool = True
    # With `core.sparse.SPARSE` curves get few keys, which may move any vertex by up to `curves_mm`.
    curves: str = sparse.SPARSE
    curves_mm: float = 0.2
    # How long each pose is held if `curves` is `core.holding.HELD`.
    holds: holding.Holds = field(default_factory=holding.Holds)
    layered: bool = True
    axes: str = "AUTO"
    landmark_file: str = ""
    # Several strips can make one take: by their names, or all strips of a channel (from 1).
    strips: list[str] = field(default_factory=list)
    channel: int = 0
    # The channel (from 1) whose text strips are events; 0 for none.
    event_channel: int = 0
    # Whether markers are events too, and how long a marker lasts if no other marker ends it.
    event_markers: bool = False
    marker_s: float = 0.8
    # A file of events, used instead of the channel and the markers.
    event_file: str = ""
    # The face shows the emotion of this sound strip or file, if the system hears emotion.
    emotion_strip: str = ""
    emotion_file: str = ""
    # The words that are spoken; empty if they are not known.
    text: str = ""
    # Whether the take starts from the current pose of the face, for systems that can do that.
    starts_from_pose: bool = False
    # The other objects of the face, and roles of single connected parts by number.
    parts: list[pieces.Part] = field(default_factory=list)
    loose: dict[int, str] = field(default_factory=dict)
    output: OutputSettings = field(default_factory=OutputSettings)
    life: LifeSettings = field(default_factory=LifeSettings)


@dataclass(kw_only=True)
class Snapshot:
    """Everything that was read for one character; `work` needs nothing else."""

    object_name: str
    face: FaceMesh
    source: SoundSource
    request: Request
    settings: Settings
    plan: Plan
    scene_fps: float
    scene_start: int
    engine: object = field(repr=False)
    # Notes for the report, and the panel's settings at the time of reading.
    notes: list[str] = field(default_factory=list)
    panel_values: dict = field(default_factory=dict)
    # The numbers of all objects that take part, by their names at the time of reading.
    numbers: dict[str, int] = field(default_factory=dict)
    # Start and end in seconds, and the text, of each strip that shows a speech sound.
    sounds: list[tuple[float, float, str]] | None = None
    # Recordings beside the speech, by the fields of the request that take them.
    recordings: dict[str, SoundSource] = field(default_factory=dict)

    def heard(self, progress: Progress) -> tuple[Sound, Request]:
        """The decoded sound, and the request with everything else that comes from sound.

        The request gets the intervals in which strips close the lips, and the recordings beside
        the speech.
        """
        progress.check("sound")
        voice, request = self.source.load(decode.decoder(self.engine)), self.request
        if self.sounds is not None:
            closed = [[a, b] for a, b, label in self.sounds if self.engine.closes_lips(label)]
            request = request.with_fields(closures=np.array(closed).reshape(-1, 2))
        decoder = decode.decoder(self.engine)
        others = {name: source.load(decoder) for name, source in self.recordings.items()}
        return voice, request.with_fields(**others)

    def ask(self, function, progress: Progress, *more):
        """Calls a `function` of the engine with the face and its sound, and returns the result."""
        voice, request = self.heard(progress)
        return function(*self.face.space.to_library(self.face), voice, request, *more, progress)

    def perform(self, progress: Progress, rows: range | None = None) -> Take:
        """The take before its plan is applied, of all frames or `rows`; raises `AnyfaceError`.

        Where only names are animated and the mesh has no face, `face` becomes the sample head.
        """
        try:
            return self._perform(progress, rows)
        except AnyfaceError as error:
            if error.kind != "face" or outputs.of(self.settings.mode).needs_face:
                raise
        self.notes.append(_no_face(self.face.name))
        self.face = sample_head.in_place_of(self.face)
        self.request = replace(self.request, roles=None).with_fields(starts_from=None)
        return self._perform(progress, rows)

    def _perform(self, progress: Progress, rows: range | None) -> Take:
        animate, (voice, request) = self.engine.animate, self.heard(progress)
        if rows is None:
            request = replace(request, keeps_clip=self.plan.keeps_clip)
        else:
            animate = partial(self.engine.animate_stretch, rows=rows)
        return perform.perform(self.face, voice, request, animate, progress)

    def work(self, progress: Progress) -> Take:
        """The take; raises `AnyfaceError`."""
        take = self.perform(progress)
        holds = self.settings.holds if self.settings.curves == holding.HELD else None
        # Poses are held first, because the plan packs the changes of the sliders.
        is_held = holds is not None and holding.hold(take, holds)
        take = self.plan.finish(self.face, take, self.engine, progress)
        try:
            if holds is not None and not is_held and not holding.hold(take, holds):
                take.notes.append("only curves of shape keys and rigs can hold poses")
            moves = self.plan.moves(take)
            if self.settings.curves == sparse.SPARSE and moves is not None:
                sparse.thin(take, moves, self.engine, self.settings.curves_mm, progress)
            output = outputs.of_take(take)
            if len(self.face.pieces) > 1 and output.moves_parts and not output.in_files:
                take.largest_of = measure.largest(take, self.face.pieces, progress)
        except BaseException:
            discard(take)
            raise
        return take


def read(ob, scene, settings: Settings, engine) -> Snapshot:
    """Reads mesh, sound and emotion; raises `AnyfaceError` with a message for the artist."""
    live.end(ob)
    output = outputs.of(settings.mode)
    output.check(ob, settings.output)
    head_and_eyes.check(ob, settings)
    off = {name: 0.0 for name in settings.life.controls_off if name in settings.controls}
    settings.fixed_controls = off | settings.fixed_controls
    notes = _leave_out_foreign(ob, settings)
    face, more = _face_or_head(ob, settings, output)
    notes += more
    source = find_sound(scene, settings, engine)
    scene_fps = scene.render.fps / scene.render.fps_base
    when = source.start_frame, strips.duration_s(source)
    asked_for = event_strips.read(scene, ob, settings, *when, engine.models)
    notes += asked_for.notes
    request = Request(
        fps=settings.fps or scene_fps,
        fields=words_and_numbers(settings)
        | {
            "emotion": _emotion(ob, scene, settings, when),
            "starts_from": _pose(ob, face, settings),
        },
        error_mm=settings.error_mm if output.as_basis else None,
        controls=settings.controls | settings.fixed_controls,
        control_keys=emotion.control_keys(ob, scene, settings, *when),
        roles=face.roles,
        events=asked_for.events,
        layered=output.as_basis
        and settings.layered
        and systems.by_name(settings.system).hears_emotion,
        output=output.name,
        named_keys=settings.named_keys,
    )
    names = [piece.name for piece in face.pieces] or [ob.name]
    return Snapshot(
        object_name=ob.name,
        face=face,
        source=source,
        request=request,
        settings=settings,
        plan=output.plan(ob, settings.output, request.fps, names),
        scene_fps=scene_fps,
        scene_start=scene.frame_start,
        engine=engine,
        notes=notes,
        panel_values=panel_settings.read(ob),
        numbers=_numbers(names, settings),
        sounds=sounds.read(scene, source),
        recordings=_recordings(scene, settings, engine),
    )


def _face_or_head(ob, settings: Settings, output) -> tuple[FaceMesh, list[str]]:
    """The face, or the sample head where the mesh is too small for one but need not have one."""
    try:
        return read_face(ob, settings), []
    except AnyfaceError as error:
        if output.needs_face or error.kind != "mesh" or not len(ob.data.polygons):
            raise
    return sample_head.in_place_of(mesh.read_face(ob)), [_no_face(ob.name)]


def _no_face(name: str) -> str:
    return f"no face was found on {name}: its keys follow the sample head by name"


def words_and_numbers(settings: Settings) -> dict[str, object]:
    """The fields of a request that are texts, numbers and files, the spoken text among them."""
    plain = systems.plain_fields(systems.NUMBER, systems.TEXT)
    values = {known.name: settings.fields.get(known.name) for known in plain}
    files = (
        (known.name, settings.fields.get(known.name))
        for known in systems.plain_fields(systems.FILE)
    )
    paths = {name: bpy.path.abspath(path) for name, path in files if path}
    return values | paths | {"text": settings.text}


def hears_emotion(settings: Settings) -> bool:
    """Whether the emotion of a voice is heard: only then recordings beside the speech count."""
    return systems.by_name(settings.system).hears_emotion or settings.emotion_source == "VOICE"


def read_still(ob, scene, settings: Settings) -> tuple[FaceMesh, Request]:
    """The face, and a request for a voice that comes later.

    Raises `AnyfaceError` with a message for the artist.
    """
    live.end(ob)
    outputs.of(settings.mode).check(ob, settings.output)
    _leave_out_foreign(ob, settings)
    face = read_face(ob, settings)
    return face, Request(fps=scene.render.fps / scene.render.fps_base, roles=face.roles)


def _numbers(names: list[str], settings: Settings) -> dict[str, int]:
    every = {*names, *(part.name for part in settings.parts), *settings.life.names}
    objects = {name: bpy.data.objects.get(name) for name in every if name}
    return {name: identity.number(ob) for name, ob in objects.items() if ob is not None}


def follow_names(snapshot: Snapshot, files: Iterable[WrittenFile]) -> None:
    """Updates the names of objects in `snapshot` and `files` to the present ones.

    Raises `AnyfaceError("mesh")` if an object is gone.
    """
    now = {}
    for name, number in snapshot.numbers.items():
        ob = identity.with_number(number, name)
        if ob is None:
            raise AnyfaceError("mesh", f"{name} is gone")
        now[name] = ob.name
    for piece in (*snapshot.face.pieces, *snapshot.settings.parts):
        piece.name = now[piece.name]
    for file in files:
        file.object_name = now[file.object_name]
    snapshot.settings.life.rename(now)
    snapshot.numbers = {now[name]: number for name, number in snapshot.numbers.items()}


def _leave_out_foreign(ob, settings: Settings) -> list[str]:
    """Removes parts that another face animates from `settings`; returns a note for each."""
    notes = []
    for part in list(settings.parts):
        other = bpy.data.objects.get(part.name)
        owner = identity.face_of(other) if outputs.has_take(other) else None
        if owner not in (None, ob):
            settings.parts.remove(part)
            notes.append(f"{part.name} belongs to {owner.name} and was left out")
    return notes


def read_face(ob, settings: Settings, editable: bool = True) -> FaceMesh:
    """Reads the face together with its other objects.

    With `editable` it raises `AnyfaceError` for parts that cannot get keys.
    """
    face = mesh.read_face(ob, settings.landmark_file)
    mesh.check_face(ob, face)
    face.axes = settings.axes
    for part in settings.parts if editable else ():
        other, output = pieces.object_of(part, ob), outputs.of(settings.mode)
        if output.moves_parts:
            output.check_object(other)
    pieces.add(face, ob, settings.parts, settings.loose)
    return face


def write(ob, snapshot: Snapshot, take: Take) -> str:
    """Writes the take at once; returns one line about what it wrote."""
    return at_once(landing(ob, snapshot, take))


def landing(ob, snapshot: Snapshot, take: Take):
    """Writes the take in short steps, yielding between them; returns one line about what it wrote.

    If the generator is closed before it yields `BEGUN`, nothing has changed.
    """
    follow_names(snapshot, take.motion.files)
    output_settings = snapshot.settings.output
    take.earliest = float(snapshot.scene_start)
    start, scene_fps = snapshot.source.start_frame, snapshot.scene_fps
    output = outputs.of_take(take)
    yield from head_and_eyes.look(take, snapshot.settings, start, scene_fps)
    take = yield from output.settle(ob, take, output_settings)
    if snapshot.settings.curves == sparse.SPARSE:
        take.few = sparse.Few(snapshot.engine, snapshot.settings.curves_mm)
    corrected = ""
    if output_settings.new_take:
        keep = output.keep if output.in_files else take_list.keep
        before = partial(keep, ob)
    elif output.on_mesh and corrections.can_wait(ob):
        corrected = take_list.name_of(ob)
        before = partial(take_list.keep, ob)
    else:
        before = None
    yield from together.landing(ob, snapshot.face.pieces, take, start, scene_fps, before)
    if not take.motion.files:
        yield BEGUN
    turned = yield from head_and_eyes.writing(ob, take, snapshot.settings, start, scene_fps)
    notes = snapshot.notes + take.notes + snapshot.source.notes
    notes += [f"the take with your corrections waits in Takes as {corrected}"] if corrected else []
    notes += [] if take.motion.files else guard.notes(ob)
    notes += output.notes(ob, output_settings)
    if ob.library is None:
        ob.anyface.mouth, ob.anyface.lids = take.mouth, " ".join(take.lids)
        ob.anyface.report_details = details(ob, take, snapshot.settings.curves_mm)
        ob.anyface.last_frame = int(take.scene_frames(start, scene_fps)[-1])
    if take.mouth == "welded":
        notes.append(opening.WELDED)
    if "joined" in take.lids:
        notes.append(opening.JOINED)
    text = " ".join([describe(take), *(f"({note})" for note in [*turned, *notes])])
    panel_settings.note(ob, snapshot.panel_values, text, take.heard_emotion)
    corrections.settle_all(ob)
    return text


def discard(result) -> None:
    """Deletes the files of a take, or of each take in a list, that was not written.

    If `result` is a `StreamedFace`, closes it. Does not use Blender.
    """
    if isinstance(result, StreamedFace):
        result.close()
    for take in _takes(result):
        plan.take_back(take.motion.files)


def settle(result) -> None:
    """The take, or each take in a list, is final: deletes the files that it has replaced."""
    for take in _takes(result):
        plan.settle(take.motion.files)


def _takes(result) -> list[Take]:
    return [
        take
        for take in (result if isinstance(result, list) else [result])
        if isinstance(take, Take)
    ]


def describe(take: Take) -> str:
    """One line of counts: "150 frames, 31 shape keys"."""
    return f"{take.frame_count} frames, {outputs.of_take(take).describe(take)}"


def details(ob, take: Take, curves_mm: float) -> str:
    """Details that only some artists want: "moves by up to 9.1 mm, exact to 0.10 mm".

    `curves_mm` is the tolerance of curves with few keys.
    """
    is_human = mesh.is_of_human_size(ob)
    phrases = [f"moves by up to {wording.length(take.largest_mm, is_human)}"]
    phrases += outputs.of_take(take).details(take, is_human)
    return ", ".join(filter(None, [*phrases, sparse.describe(take, curves_mm)]))


def find_sound(scene, settings: Settings, engine) -> SoundSource:
    """The sound that `settings` name, not decoded yet; raises `AnyfaceError("audio")`."""
    if settings.strips or settings.channel:
        chosen = strips.chosen(scene, settings.strips, settings.channel)
        return strips.as_one(scene, chosen, decode.decoder(engine))
    if settings.strip:
        return sound_source.from_strip(scene, settings.strip, decode.decoder(engine))
    if settings.sound_file:
        return sound_source.from_file(settings.sound_file, settings.start_frame)
    raise AnyfaceError("audio", NO_SOUND, ("choose_sound",))


def _emotion_sound(scene, settings: Settings, engine) -> SoundSource | None:
    """The recording that gives the emotion; None for a strip if the system hears no emotion."""
    if settings.emotion_file:
        return sound_source.from_file(settings.emotion_file, settings.start_frame)
    if not settings.emotion_strip or not systems.by_name(settings.system).hears_emotion:
        return None
    try:
        return sound_source.from_strip(scene, settings.emotion_strip, decode.decoder(engine))
    except AnyfaceError as error:
        raise AnyfaceError(error.kind, f"Emotion Of: {error}") from error


def _recordings(scene, settings: Settings, engine) -> dict[str, SoundSource]:
    """The recordings beside the speech, by the fields that take them."""
    other = _emotion_sound(scene, settings, engine)
    recordings = {} if other is None else {"emotion_of": other}
    for known in systems.plain_fields(systems.SOUND) if hears_emotion(settings) else ():
        if path := settings.fields.get(known.name):
            recordings[known.name] = _recording(known.label, path, settings.start_frame)
    return recordings


def _recording(label: str, path: str, start_frame: int) -> SoundSource:
    try:
        return sound_source.from_file(path, start_frame)
    except AnyfaceError as error:
        raise AnyfaceError(error.kind, f"{label}: {error}") from error


def _pose(ob, face: FaceMesh, settings: Settings) -> np.ndarray | None:
    """The current displacements `[V, 3]` of the face and its other pieces.

    None if the take does not start from the current pose.
    """
    if not settings.starts_from_pose or not systems.by_name(settings.system).starts_from_pose:
        return None
    moved = np.zeros_like(face.positions)
    face_pose = mesh.read_pose(ob)
    moved[: len(face_pose)] = face_pose
    for piece in face.pieces[1:]:
        stands = mesh.read_pose(bpy.data.objects[piece.name])
        moved[piece.rows] = stands @ piece.matrix[:3, :3].T
    return moved


def _emotion(ob, scene, settings: Settings, when: tuple):
    """The word of another source, or rows of strengths over time."""
    if settings.emotion_source != "GIVEN":
        return WORD_OF_SOURCE[settings.emotion_source]
    if settings.blend is not None:
        return [(0.0, list(settings.blend))]
    return emotion.emotion_keys(ob, scene, settings, *when)
