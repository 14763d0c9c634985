"""Poses on twos, threes and fours: held keyframes, closures kept."""

import bpy
import numpy as np
import pytest

from figures import Stage, basis, grid, motion, stand_in, tone


class SpeakingStage(Stage):
    """A stage whose lips touch in some frames."""

    def animate(self, *arguments):
        """Adds the frames in which the lips touch."""
        animation = super().animate(*arguments)
        if animation.basis is not None:
            count = len(animation.basis.weights)
            animation.touching = np.isin(np.arange(count), [7])
        return animation


@pytest.fixture
def face(addon, tmp_path):
    """A face that speaks for one second (24 frames) in held poses."""
    bpy.context.scene.render.fps = 24
    stand_in(addon, SpeakingStage(addon("core.take")))
    ob = grid("Head")
    ob.anyface.source, ob.anyface.sound_file = "FILE", tone(tmp_path / "a.wav", seconds=1.0)
    ob.anyface.start_frame, ob.anyface.curves = 11, "HELD"
    return ob


def values(ob, frame):
    bpy.context.scene.frame_set(frame)
    return np.array([block.value for block in ob.data.shape_keys.key_blocks[1:]])


@pytest.mark.parametrize("on", [2, 3, 4])
def test_poses_change_at_every_so_many_frames_alone(face, on):
    face.anyface.pose_on, face.anyface.pose_closures, face.anyface.pose_vowels = on, 0, 0
    assert bpy.ops.anyface.generate() == {"FINISHED"}
    every = np.array([values(face, frame) for frame in range(11, 35)])
    changes = np.flatnonzero(np.abs(np.diff(every, axis=0)).max(axis=1) > 1e-6) + 1
    assert len(changes) > 4 and (changes % on == 0).all()
    bpy.context.scene.frame_set(12, subframe=0.5)
    key_values = [block.value for block in face.data.shape_keys.key_blocks[1:]]
    np.testing.assert_allclose(key_values, every[1], atol=1e-6)


def test_a_pose_in_which_lips_touch_is_theirs_and_lasts(face):
    face.anyface.curves = "EVERY"
    bpy.ops.anyface.generate()
    closed = values(face, 11 + 7)
    face.anyface.curves, face.anyface.pose_on = "HELD", 2
    for least, frames in [(0, 2), (2, 2), (3, 4), (6, 6)]:
        face.anyface.pose_closures = least
        bpy.ops.anyface.generate()
        alike = [np.allclose(values(face, at), closed, atol=1e-6) for at in range(11, 35)]
        assert alike[7] and sum(alike) == frames, least


def test_a_slider_and_remove_work_on_held_poses(face):
    bpy.ops.anyface.generate()
    before = np.array([values(face, frame) for frame in range(11, 35)])
    face.anyface_output.strength = 0.5
    after = np.array([values(face, frame) for frame in range(11, 35)])
    np.testing.assert_allclose(after, 0.5 * before, atol=1e-6)
    assert "poses held" in face.anyface.report_details
    bpy.ops.anyface.remove()
    assert face.data.shape_keys is None


def test_made_keys_are_held_too(face):
    face.anyface.mode = "arkit"
    face.anyface.pose_on = 3
    assert bpy.ops.anyface.generate() == {"FINISHED"}
    every = np.array([values(face, frame) for frame in range(11, 35)])
    changes = np.flatnonzero(np.abs(np.diff(every, axis=0)).max(axis=1) > 1e-6) + 1
    assert len(changes) and (changes % 3 == 0).all()


def test_closures_and_wide_mouths_stand_for_their_own_time(addon):
    holding = addon("core.holding")
    opening = np.full(24, 1.0)
    opening[10], opening[5], opening[18] = 0.0, 4.0, 9.0
    touching = opening == 0.0
    poses = holding.poses(opening, touching, holding.Holds(1, 4, 3))
    assert (poses == 10).sum() == 4 and poses[10] == 10
    assert (poses == 18).sum() == 3 and (poses == 5).sum() == 3
    plain = holding.poses(opening, touching, holding.Holds(1, 0, 0))
    assert (plain == np.arange(24)).all()


def test_sliders_change_what_is_shown(addon):
    take, holding, sliders = addon("core.take"), addon("core.holding"), addon("core.sliders")
    motion_basis = basis(take, motion(12, 20))
    weights = motion_basis.weights.copy()
    motion_basis.sliders = {"blinks": sliders.SliderChange(np.array([0.0]), -weights[None])}
    whole = take.Take(24.0, 1.0, "basis", motion_basis)
    assert holding.hold(whole, holding.Holds(3, 0, 0))
    np.testing.assert_allclose(
        motion_basis.weights + motion_basis.sliders["blinks"].changes[0], 0.0, atol=1e-6
    )
    assert [len(keys.rows) for keys in motion_basis.keys_of_curves] == [4] * weights.shape[1]


def test_head_and_eyes_stand_with_the_poses(addon):
    take, holding = addon("core.take"), addon("core.holding")
    random, count = np.random.default_rng(3), 24
    weights = random.uniform(size=(count, 2)).astype(np.float32)
    head, gaze = random.normal(size=(count, 3)), random.normal(size=(count, 2, 2))
    motion = take.Basis(np.ones((2, 4, 3), dtype=np.float32), weights, 0.1)
    life = take.Life(head, gaze, np.eye(3, 4), looked_at=head + 1.0)
    new_take = take.Take(24.0, 9.0, "basis", motion, life)
    new_take.opening = random.uniform(size=count)
    assert holding.hold(new_take, holding.Holds(3, 0, 0))
    # For each frame, the frame whose pose it shows.
    shown = [int(np.flatnonzero((weights == row).all(axis=1))[0]) for row in motion.weights]
    assert len(set(shown)) == count // 3
    np.testing.assert_array_equal(new_take.life.head, head[shown])
    np.testing.assert_array_equal(new_take.life.gaze, gaze[shown])
    np.testing.assert_array_equal(new_take.life.looked_at, head[shown] + 1.0)
    assert new_take.life.tongue is None
