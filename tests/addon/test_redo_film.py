"""Redo of takes stored frame by frame (caches, every frame, tables) and of takes on rigs."""

from pathlib import Path

import bpy
import numpy as np
import pytest

from figures import FPS, curves, duplicate, film, grid, motion, shape, stand_in, tone
from test_control_takes import Waves, face, rig_of, stage  # noqa: F401 - fixtures

START, FIRST, LAST = 11, 20, 40
SECONDS = 2.0
OUTSIDE = [*range(1, FIRST + 1), *range(LAST, 75)]


@pytest.fixture
def engine(addon):
    """A `Stage` that replaces the engine."""
    return stand_in(addon)


def mark(first=FIRST, last=LAST):
    """Sets the preview range."""
    scene = bpy.context.scene
    scene.use_preview_range = True
    scene.frame_preview_end, scene.frame_preview_start = last, first


def spoken(tmp_path, mode, parts=True):
    """A face with teeth and a take of a tone. A stretch of it is marked for redo."""
    bpy.context.scene.render.fps = FPS
    ob = grid()
    ob.anyface.source, ob.anyface.start_frame = "FILE", START
    ob.anyface.sound_file = tone(tmp_path / "tone.wav", SECONDS)
    if parts:
        teeth = grid("Teeth_low", 5, 0.05)
        part = ob.anyface_face.parts.add()
        part.object, part.name, part.role = teeth, teeth.name, "jaw"
    ob.anyface.mode = mode
    bpy.context.view_layer.objects.active = ob
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "shot.blend"))
    ob = bpy.data.objects["Head"]
    assert bpy.ops.anyface.generate() == {"FINISHED"}
    mark()
    return ob


def asked_for(engine, vertices):
    """The motion that the stage makes with seed 5."""
    return motion(int(SECONDS * FPS), vertices, engine.rank, engine.size, 5)


@pytest.mark.parametrize("mode", ["cache", "frames"])
def test_frames_outside_stay_to_the_bit_and_those_inside_are_the_new_ones(engine, tmp_path, mode):
    ob = spoken(tmp_path, mode)
    teeth = bpy.data.objects["Teeth_low"]
    before = film(ob, OUTSIDE), film(teeth, OUTSIDE)
    ob.anyface.seed = 5
    assert bpy.ops.anyface.redo() == {"FINISHED"}
    assert np.array_equal(before[0], film(ob, OUTSIDE))
    assert np.array_equal(before[1], film(teeth, OUTSIDE))
    count = len(ob.data.vertices)
    moved = asked_for(engine, count + len(teeth.data.vertices))
    for frame in (26, 30, 34):
        error = shape(ob, frame) - shape(ob, 1) - moved[frame - START, :count]
        assert np.abs(error).max() < 1e-6, frame
        error = shape(teeth, frame) - shape(teeth, 1) - moved[frame - START, count:]
        assert np.abs(error).max() < 1e-6, frame


@pytest.mark.parametrize("mode", ["cache", "frames"])
def test_the_begin_of_a_take_is_redone_with_the_way_to_it(engine, tmp_path, mode):
    ob = spoken(tmp_path, mode, parts=False)
    mark(1, 30)
    ob.anyface.seed = 5
    assert bpy.ops.anyface.redo() == {"FINISHED"}
    moved = asked_for(engine, len(ob.data.vertices))
    assert np.abs(shape(ob, START) - shape(ob, 1) - moved[0]).max() < 1e-6
    way = shape(ob, START - 1) - shape(ob, 1)
    assert 0.1 < np.abs(way).max() / np.abs(moved[0]).max() < 0.95
    share = (way * moved[0]).sum() / (moved[0] ** 2).sum()
    assert np.abs(way - share * moved[0]).max() < 1e-6


def test_a_redone_cache_is_a_new_file_and_undo_plays_the_old_one(engine, tmp_path):
    ob = spoken(tmp_path, "cache")
    folder = tmp_path / "anyface_cache"
    old = {path.name: path.read_bytes() for path in folder.iterdir()}
    played = ob.modifiers["Anyface Cache"].filepath
    bpy.ops.ed.undo_push(message="before")
    ob.anyface.seed = 5
    assert bpy.ops.anyface.redo() == {"FINISHED"}
    bpy.ops.ed.undo_push(message="Redo")
    assert ob.modifiers["Anyface Cache"].filepath != played
    now = {path.name: path.read_bytes() for path in folder.iterdir()}
    assert len(old) == 2 and len(now) == 4
    assert all(now[name] == content for name, content in old.items())
    bpy.ops.ed.undo()
    assert bpy.data.objects["Head"].modifiers["Anyface Cache"].filepath == played


def test_a_cache_that_is_gone_or_cut_says_so_and_leaves_nothing(engine, tmp_path):
    ob = spoken(tmp_path, "cache", parts=False)
    folder = tmp_path / "anyface_cache"
    (path,) = folder.iterdir()
    path.write_bytes(path.read_bytes()[:-5])
    with pytest.raises(RuntimeError, match="generate again"):
        bpy.ops.anyface.redo()
    assert [path] == list(folder.iterdir())
    path.unlink()
    with pytest.raises(RuntimeError, match="no cache that can be read"):
        bpy.ops.anyface.redo()
    assert ob.modifiers["Anyface Cache"].filepath.endswith(path.name)


def test_a_table_keeps_every_row_outside_to_the_letter(engine, tmp_path):
    ob = spoken(tmp_path, "csv")
    path = tmp_path / "shot_Head.csv"
    before = path.read_text().splitlines()
    ob.anyface.seed = 5
    assert bpy.ops.anyface.redo() == {"FINISHED"}
    after = path.read_text().splitlines()
    changed = [row for row, (a, b) in enumerate(zip(before, after, strict=True)) if a != b]
    inside = range(FIRST - START + 2, LAST - START + 1)
    assert changed and set(changed) <= set(inside) and len(changed) > 15
    assert bpy.ops.anyface.remove() == {"FINISHED"} and not path.exists()
    assert [p for p in tmp_path.iterdir() if ".part" in p.name] == []


def test_a_table_that_somebody_changed_is_not_written_over(engine, tmp_path):
    spoken(tmp_path, "csv")
    path = tmp_path / "shot_Head.csv"
    mine = path.read_text() + "mine\n"
    path.write_text(mine)
    with pytest.raises(RuntimeError, match="exists already"):
        bpy.ops.anyface.redo()
    assert path.read_text() == mine


def rig_keyframes(ob):
    """Frames and values of all curves of the rig, by path and index."""
    rows = {}
    for curve in curves(rig_of(ob).animation_data.action):
        points = np.empty(2 * len(curve.keyframe_points), dtype=np.float32)
        curve.keyframe_points.foreach_get("co", points)
        rows[curve.data_path, curve.array_index] = points.reshape(-1, 2)
    return rows


class Other(Waves):
    """`Waves` that can also animate a stretch. Seed 5 reverses its direction."""

    def animate_stretch(self, positions, *arguments, rows):
        """The frames `rows` of `animate`."""
        *rest, sound, request, progress = arguments
        animation = self.animate(positions, *rest, sound, request, progress)
        sign = -1.0 if request.fields["seed"] == 5 else 1.0
        animation.displacements = sign * animation.displacements[rows.start : rows.stop]
        return animation


def test_a_rig_keeps_every_keyframe_outside(addon, face):  # noqa: F811
    stand_in(addon, Other(addon("core.take")))
    assert bpy.ops.anyface.generate() == {"FINISHED"}
    before, poses = rig_keyframes(face), film(face, range(1, 70))
    mark()
    assert bpy.ops.anyface.redo() == {"FINISHED"}
    same = film(face, range(1, 70))
    assert np.abs(same - poses).max() < 3e-4, "the same settings give nearly the same"
    face.anyface.seed = 5
    assert bpy.ops.anyface.redo() == {"FINISHED"}
    after = rig_keyframes(face)
    assert before.keys() == after.keys()
    for path, points in before.items():
        out = (points[:, 0] <= FIRST) | (points[:, 0] >= LAST)
        assert np.array_equal(points[out], after[path][out]), path
    now = film(face, range(1, 70))
    assert np.array_equal(now[:FIRST], poses[:FIRST])
    assert np.array_equal(now[LAST - 1 :], poses[LAST - 1 :])
    assert np.abs(now[29] - poses[29]).max() > 1e-3
    assert bpy.ops.anyface.remove() == {"FINISHED"}
    assert rig_of(face).animation_data is None


def test_a_copy_is_redone_on_its_own(engine, tmp_path):
    ob = spoken(tmp_path, "cache", parts=False)
    before = film(ob, range(1, 70))
    (copy,) = duplicate(ob)
    copy.anyface.seed = 5
    assert bpy.ops.anyface.redo() == {"FINISHED"}
    assert np.array_equal(film(ob, range(1, 70)), before)
    assert np.abs(film(copy, [30]) - before[29]).max() > 1e-4
    assert len(list(Path(tmp_path / "anyface_cache").iterdir())) == 2
