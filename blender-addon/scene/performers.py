"""Reads from the scene how a face moves with its sound, so that a performer can be learned."""

from pathlib import Path

import bpy
import numpy as np

from ..core import finding, holding, performers, sparse, systems
from ..core.errors import AnyfaceError
from ..core.job import Progress
from ..core.performers import FaceMotion, Lesson
from ..core.plan import Plan
from . import bake, outputs
from .face import mesh
from .rig_controls.control_bench import Bench
from .rig_controls.control_bench import check as check_visible
from .sound import decode, strips


def check_system(name: str) -> None:
    """Raises `AnyfaceError("input")` for a system that shows no performers."""
    system = systems.by_name(name)
    if not system.shows_performers:
        able = " or ".join(other.label for other in systems.known() if other.shows_performers)
        text = f"{system.label} shows no performers: choose {able} as the system"
        raise AnyfaceError("input", text)


def read_file(scene, settings: bake.Settings, engine, path: Path, motion_file: str) -> Lesson:
    """A lesson from a file of Live Link Face that begins with the sound of the panel."""
    check_system(settings.system)
    performers.check_free(path)
    full = Path(bpy.path.abspath(motion_file))
    if not full.is_file():
        raise AnyfaceError("file", f"no file at {full}: choose a .csv of Live Link Face")
    source = bake.find_sound(scene, settings, engine)
    decoder = decode.decoder(engine)
    return Lesson(path, full.stem, source, decoder, engine, motion_file=str(full))


def read_face(ob, scene, settings: bake.Settings, engine, path: Path) -> Lesson:
    """A lesson from how `ob` moves while its sound plays, whatever moves it.

    Steps through the frames of the sound and comes back to the present one. Raises `AnyfaceError`.
    """
    check_system(settings.system)
    performers.check_free(path)
    check_visible(ob)
    snapshot = _take_of(ob, scene, settings, engine)
    source = snapshot.source if snapshot is not None else bake.find_sound(scene, settings, engine)
    scene_fps = scene.render.fps / scene.render.fps_base
    fps = snapshot.request.fps if snapshot is not None else scene_fps
    decoder = decode.decoder(engine)
    seconds = strips.duration_s(source)
    if seconds is None:
        voice = source.load(decoder)
        seconds = len(voice.samples) / voice.rate_hz
    at = source.start_frame + np.arange(int(np.ceil(seconds * fps))) * (scene_fps / fps)
    motion = _film(ob, scene, settings, engine, at, fps)
    return Lesson(path, ob.name, source, decoder, engine, motion, snapshot=snapshot)


def _take_of(ob, scene, settings: bake.Settings, engine) -> bake.Snapshot | None:
    """What makes the take on `ob` once more without writing it; None if it has no take of ours.

    A performer that spoke the take is left out, so that the new one learns from it too.
    """
    output = outputs.of_object(ob)
    if output is None:
        return None
    settings.fields["performer"] = ""
    settings.mode, settings.starts_from_pose = output.name, False
    if settings.curves != holding.HELD:
        settings.curves = sparse.EVERY_FRAME
    snapshot = bake.read(ob, scene, settings, engine)
    if output.in_files:
        # Only where the landmarks go is compared.
        snapshot.plan, snapshot.request.error_mm = Plan(), None
    return snapshot


def _film(ob, scene, settings, engine, at: np.ndarray, fps: float) -> FaceMotion:
    """The landmarks of the evaluated mesh of `ob` at scene frames `at` `[T]`."""
    face = bake.read_face(ob, settings, editable=False)
    vertices = finding.find(face, {}, engine.find, Progress()).vertices.astype(np.int64)
    basis = mesh.read_basis(ob.data)
    if vertices.max() >= len(basis):
        text = f"{ob.name}: its mouth is another object: pick the mesh that has the lips"
        raise AnyfaceError("mesh", text)
    rest = basis[vertices].astype(np.float64)
    bench = Bench(ob, [], vertices)
    before = scene.frame_current, scene.frame_subframe
    try:
        with bench.at_rest():
            shown = np.array([_at(scene, frame, bench) for frame in at])
    finally:
        scene.frame_set(before[0], subframe=before[1])
    moved = performers.without_head(shown - rest, rest)
    return FaceMotion(rest, moved, vertices, fps, face.space)


def _at(scene, frame: float, bench: Bench) -> np.ndarray:
    whole = int(np.floor(frame))
    scene.frame_set(whole, subframe=float(frame - whole))
    return bench.read()
