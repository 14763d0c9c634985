"""Redoes the frames between two markers of a take; every keyframe outside stays as it is."""

import numpy as np

from ...core import redo, sliders, sparse, wording
from ...core.errors import AnyfaceError
from ...core.job import BEGUN
from ...core.redo_film import FilmRedo
from .. import bake, copies, outputs
from ..animation import bezier, curves
from ..face import mesh
from ..life import head_and_eyes
from ..outputs.output import PREFIX
from ..shape_keys import guard, record, slider_changes
from ..sound import sounds
from . import adjust, corrections, redo_film, together

_NO_TAKE = "no take to redo: press Generate first"
_NO_RANGE = (
    "no stretch to redo: move a word, set a preview range (P), or put a marker (M) before and "
    "behind it"
)
# A smaller change cannot be seen: twice the error of a take, mm.
_NOTHING_MM = 0.2
_REDONE = "a stretch of the take was redone: generate again"


def between(scene, source=None) -> tuple[float, float]:
    """The first and the last frame of the range that *Redo* changes.

    The range is the first of these that exists: the preview range, the range between two selected
    markers, the range in which words of the sound `source` have moved, and the range between the
    markers around the current frame. Raises `AnyfaceError("input")` if there is none.
    """
    if scene.use_preview_range:
        return float(scene.frame_preview_start), float(scene.frame_preview_end)
    chosen = sorted(marker.frame for marker in scene.timeline_markers if marker.select)
    if len(chosen) == 2 and chosen[0] < chosen[1]:
        return float(chosen[0]), float(chosen[1])
    moved = None if source is None else sounds.stretch_of_words(scene, source)
    if moved is not None:
        return float(moved[0]), float(moved[1])
    frames, now = [marker.frame for marker in scene.timeline_markers], scene.frame_current
    before = [frame for frame in frames if frame <= now]
    behind = [frame for frame in frames if frame > now]
    if not before or not behind:
        raise AnyfaceError("input", _NO_RANGE)
    return float(max(before)), float(min(behind))


def why_not(ob) -> str:
    """Why the take of `ob` cannot be redone in part, or ""."""
    return "" if _output_of(ob) is not None else _NO_TAKE


def _output_of(ob):
    """The output whose take is redone: the one that moves the mesh, or else a table."""
    of_mesh = outputs.of_object(ob)
    return of_mesh or next((output for output in outputs.ALL if output.find(ob)), None)


def read(ob, scene, settings, engine) -> redo.Redo | FilmRedo:
    """Reads everything that a redo with the panel's settings needs; raises `AnyfaceError`."""
    copies.settle()
    output = _output_of(ob)
    if output is None:
        raise AnyfaceError("input", _NO_TAKE)
    settings.mode = output.name
    # A stretch continues the motion of the take, so the present pose of the face does not matter.
    settings.starts_from_pose = False
    snapshot = bake.read(ob, scene, settings, engine)
    snapshot.request.error_mm = None
    if not output.redoes:
        return redo_film.read(ob, output, snapshot, between(scene, snapshot.source))
    parts = [ob, *together.others_of(ob)]
    keys = [_keys_of(part) for part in parts if _takes_part(snapshot.face, ob, part)]
    job = redo.Redo(snapshot, range(0), keys)
    stretch, start, step = _stretch(ob, job, scene)
    job.rows = redo.rows_of(stretch, start, step)
    return job


def landing(ob, scene, job: redo.Redo | FilmRedo, result):
    """Writes the result in steps like `bake.landing`; returns one line about what it did."""
    if isinstance(job, FilmRedo):
        text = yield from redo_film.landing(ob, job, result)
        sounds.follow(scene, job.snapshot.source)
        return text
    text = write(ob, scene, job, result)
    yield BEGUN
    return text


def write(ob, scene, job: redo.Redo, result: redo.Redone) -> str:
    """Puts the new stretch into the curves; returns one line about what it did."""
    bake.follow_names(job.snapshot, ())
    stretch, start, step = _stretch(ob, job, scene)
    at = start + step * (job.rows.start + np.arange(result.frames))
    parts = {part.name: part for part in (ob, *together.others_of(ob))}
    by_mm = result.unit_mm * max(_change(parts[k.name], k, result, at, stretch) for k in job.keys)
    limits = {keys.name: _limits(job.snapshot, keys, result.unit_mm) for keys in job.keys}
    engine = job.snapshot.engine
    as_made = [part for part in parts.values() if not corrections.is_corrected(part)]
    changed = [
        _write(parts[name], fit, at, stretch, _Fewer(engine, limits[name]))
        for name, fit in result.fits.items()
    ]
    if not any(changed):
        raise AnyfaceError("mesh", "the take has no keyframe there: has it been moved?")
    if result.life is not None:
        settings = job.snapshot.settings
        head_and_eyes.redo(ob, result.life, settings, at, lambda *c: curves.splice(*c, stretch))
    more = sum(len(fit.more) for fit in result.fits.values())
    for part in as_made:
        corrections.settle(part)
    sounds.follow(scene, job.snapshot.source)
    text = f"frames {stretch.first:g} to {stretch.last:g} redone"
    if by_mm < _NOTHING_MM:
        return f"{text} as they were: change the seed, the emotion or the strips first"
    left_out = max(fit.left_out for fit in result.fits.values())
    by = wording.length(by_mm, mesh.is_of_human_size(ob))
    text += f", up to {by} away from before" + (f", {more} more keys" if more else "")
    return text + (f", keys show {1.0 - left_out:.0%} of it" if left_out > 0.1 else "")


def _takes_part(face, ob, part) -> bool:
    return part == ob or redo.is_of(face, part.name)


def _keys_of(part) -> redo.ObjectKeys:
    """The existing keys of the take on one object."""
    shape_keys = part.data.shape_keys
    take_record = record.read(shape_keys)
    names = list(_curves(part, take_record))
    rest = mesh.read_basis(part.data)
    blocks = [shape_keys.key_blocks[name] for name in names]
    vectors = [mesh.read_key(block) - mesh.read_key(block.relative_key) for block in blocks]
    shapes = [take_record.shown.get(name, name) for name in names]
    free = outputs.of_record(take_record).as_basis
    factors = [
        take_record.factors.get(name, {shape: 1.0})
        for name, shape in zip(names, shapes, strict=True)
    ]
    moves = np.array(vectors).reshape(-1, *rest.shape)
    return redo.ObjectKeys(part.name, shapes, moves, free, factors)


def _stretch(ob, job: redo.Redo, scene) -> tuple[redo.Stretch, float, float]:
    """The stretch, the scene frame at which the take begins, and the spacing of its frames."""
    snapshot, take_record = job.snapshot, record.read(ob.data.shape_keys)
    start = snapshot.source.start_frame + take_record.adjusted.get("shift", 0.0)
    step = snapshot.scene_fps / snapshot.request.fps
    last_frames = [curve.range()[1] for curve in _curves(ob, take_record).values()]
    if not last_frames:
        raise AnyfaceError("mesh", "the take has no curves any more: generate again")
    # The last keyframe is the rest pose, which comes after the last frame of the sound.
    ends = max(last_frames) - curves.EASE_S * snapshot.scene_fps
    stretch = redo.Stretch(*between(scene, snapshot.source), start, ends, snapshot.scene_fps)
    return stretch, start, step


def _curves(part, take_record) -> dict:
    """The curves of a take's keys on one object by name, in the order of the keys."""
    shape_keys = part.data.shape_keys
    names = [
        name for name in (*take_record.keys, *take_record.values) if name in shape_keys.key_blocks
    ]
    paths = {name: curves.value_path(name) for name in names}
    fcurves = {name: curves.find(shape_keys.animation_data, path) for name, path in paths.items()}
    return {name: curve for name, curve in fcurves.items() if curve is not None}


def _change(part, keys: redo.ObjectKeys, result: redo.Redone, at, stretch) -> float:
    """The largest distance by which the new weights move any vertex of an object, object units."""
    take_record = record.read(part.data.shape_keys)
    was = np.array([bezier.sample(curve, at) for curve in _curves(part, take_record).values()]).T
    scale = [adjust.factor(shape, take_record.adjusted) for shape in keys.shapes]
    shares = stretch.shares(at)[:, None]
    return redo.moved_by(keys, shares * (result.fits[keys.name].weights * scale - was))


class _Fewer:
    """Chooses which frames of a stretch get keys; `limits` `[K]` are the tolerances."""

    def __init__(self, engine, limits: np.ndarray):
        self._engine, self._limits = engine, limits

    def of(self, number: int):
        """The function that chooses the frames for curve `number`."""
        limit = self._limits[number : number + 1]
        return lambda values: self._engine.few_keys_each(values[:, None], limit)[0]


def _limits(snapshot, keys: redo.ObjectKeys, unit_mm: float) -> np.ndarray:
    """The tolerance of each curve, `[K]`, that keeps all curves together within the limit."""
    sizes = np.sqrt((keys.vectors**2).sum(axis=2).max(axis=1, initial=0.0)) * unit_mm
    return sparse.ALONE * snapshot.settings.curves_mm / np.maximum(sizes, 1e-9)


def _write(part, fit: redo.Fit, at, stretch: redo.Stretch, fewer: _Fewer) -> bool:
    """Puts new weights into the curves of one object; False if the stretch has no keyframe."""
    guard.unshare(part)
    shape_keys = part.data.shape_keys
    take_record = record.read(shape_keys)
    fcurves, changed = _curves(part, take_record), False
    pairs = zip(fcurves.items(), fit.weights.T, strict=True)
    for number, ((name, curve), column) in enumerate(pairs):
        column = column * adjust.factor(take_record.shown.get(name, name), take_record.adjusted)
        if not curves.splice(curve, at, column, stretch, fewer.of(number)):
            continue
        block, changed = shape_keys.key_blocks[name], True
        block.slider_min = min(block.slider_min, float(column.min()))
        block.slider_max = max(block.slider_max, float(column.max()))
    if changed:
        _add(part, take_record, fit, at, stretch)
        slider_changes.clear(shape_keys, take_record)
        take_record.still = dict.fromkeys(sliders.NAMES, _REDONE)
        record.write(shape_keys, take_record)
        part.data.update()
    return changed


def _add(part, take_record, fit: redo.Fit, at: np.ndarray, stretch: redo.Stretch) -> None:
    """Adds keys for motion that the take's keys cannot show. They rest outside the stretch."""
    if not len(fit.more):
        return
    strength = adjust.factor("", take_record.adjusted)
    bag = curves.key_channels(part, take_record)
    earliest = min(curve.range()[0] for curve in _curves(part, take_record).values())
    frames = curves.with_rest(at, stretch.fps, earliest)
    with guard.object_mode(part), guard.selection_kept(part):
        rest, shares = mesh.read_basis(part.data), stretch.shares(at)
        for vector, column in zip(fit.more, fit.more_weights.T, strict=True):
            block = mesh.add_key(part, f"{PREFIX}.{len(take_record.keys) + 1:03d}", rest + vector)
            block.slider_min = -1.0
            take_record.keys.append(block.name)
            values = curves.from_rest(shares * column * strength, frames)
            curves.write(bag, curves.value_path(block.name), frames, values)
