"""Long takes: slow work runs in the thread, the rest in slices that can be cancelled."""

import time
from types import SimpleNamespace

import bpy
import numpy as np
import pytest

import figures
from figures import curves, everything, grid, own_keys, shape, stand_in, tone

START = 5
MINUTES = 3.0


@pytest.fixture
def stage(addon):
    """A `Stage` that replaces the engine."""
    return stand_in(addon)


def snapshot_of(addon, stage, tmp_path, seconds=2.0, side=12):
    """A head with teeth, the snapshot that was read of them, and their take."""
    bpy.context.scene.render.fps = 24
    teeth = grid("Teeth_low", 5, 0.05)
    ob = grid("Head", side)
    ob.anyface.source, ob.anyface.start_frame = "FILE", START
    ob.anyface.sound_file = tone(tmp_path / "tone.wav", seconds)
    part = ob.anyface_face.parts.add()
    part.object, part.name, part.role = teeth, teeth.name, "jaw"
    settings = addon("ui.settings").from_object(ob)
    snapshot = addon("scene.bake").read(ob, bpy.context.scene, settings, stage)
    return ob, snapshot, snapshot.work(addon("core.job").Progress())


def long_take(addon, vertices, keys=56):
    """A take of `MINUTES` minutes as a basis with random weights."""
    take, random = addon("core.take"), np.random.default_rng(1)
    frames = int(MINUTES * 60 * 24)
    weights = random.uniform(-1, 1, (frames, keys)).astype(np.float32)
    vectors = random.normal(size=(keys, vertices, 3)).astype(np.float32) * 1e-3
    return take.Take(24.0, 9.0, "basis", take.Basis(vectors, weights, 0.1))


def test_the_largest_motion_of_each_piece_is_exact(addon):
    measure, take_module = addon("core.measure"), addon("core.take")
    random = np.random.default_rng(3)
    vectors = random.normal(size=(7, 900, 3)).astype(np.float32)
    vectors *= random.uniform(0.01, 1.0, (1, 900, 1)).astype(np.float32) ** 4
    weights = random.uniform(-1, 1, (50, 7)).astype(np.float32)
    displacements = np.tensordot(weights, vectors, axes=1)
    moved = np.linalg.norm(displacements, axis=2)
    take = take_module.Take(24.0, 9.0, "basis", take_module.Basis(vectors, weights, 0.1))
    places = (("a", 0, 600), ("b", 600, 300))
    pieces = [take_module.Piece(*place, np.eye(4)) for place in places]
    silent = addon("core.job").Progress()
    largest = measure.largest(take, pieces, silent)
    expected = [moved[:, :600].max(), moved[:, 600:].max()]
    assert np.abs(np.array(largest) - 9.0 * np.array(expected) / max(expected)).max() < 1e-4
    frames = take_module.Take(24.0, 9.0, "frames", take_module.Frames(displacements))
    assert measure.largest(frames, pieces, silent) == pytest.approx(largest, rel=1e-4)


def test_landing_a_long_take_blocks_for_moments_only(addon, stage, tmp_path):
    ob, snapshot, _ = snapshot_of(addon, stage, tmp_path, side=80)
    take = long_take(addon, 80 * 80 + 25)
    take.largest_of = addon("core.measure").largest(
        take, snapshot.face.pieces, addon("core.job").Progress()
    )
    landing, steps, began = addon("scene.bake").landing(ob, snapshot, take), [], time.perf_counter()
    for _ in landing:
        steps.append(time.perf_counter() - began)
        began = time.perf_counter()
    steps.append(time.perf_counter() - began)
    print(f"{len(steps)} steps, longest {1e3 * max(steps):.0f} ms, all {sum(steps):.2f} s")
    assert len(steps) > 100 and max(steps) < 0.5
    weights = take.motion.weights
    action = ob.data.shape_keys.animation_data.action
    assert len(weights) == 4320 and action.frame_range[1] > START + 4319


def test_keys_curves_and_undo_are_steps_of_their_own_and_none_evaluates_the_scene(
    addon, stage, tmp_path
):
    ob, snapshot, take = snapshot_of(addon, stage, tmp_path)
    evaluated, begun, keys, playing = [], addon("core.job").BEGUN, [], []

    def note(*_):
        evaluated.append(1)

    bpy.app.handlers.depsgraph_update_post.append(note)
    try:
        for step in addon("scene.bake").landing(ob, snapshot, take):
            if step != begun:
                assert ob.data.shape_keys is None, "it can be cancelled until it has begun"
                continue
            shape_keys = ob.data.shape_keys
            keys.append(len(shape_keys.key_blocks))
            playing.append(shape_keys.animation_data is not None)
    finally:
        bpy.app.handlers.depsgraph_update_post.remove(note)
    assert keys[0] > 1 and not playing[0] and playing[-1] and len(keys) >= 4
    assert not evaluated, "Blender evaluates once between the steps, and not within them"


def test_an_action_of_the_artists_gets_its_curves_in_steps(addon, stage, tmp_path):
    ob, snapshot, take = snapshot_of(addon, stage, tmp_path)
    action = bpy.data.actions.new("Own")
    own_keys(ob, "Smile").animation_data_create().action = action
    count = [
        len(curves(action)) for step in addon("scene.bake").landing(ob, snapshot, take) if step
    ]
    assert any(0 < n < count[-1] for n in count) and count[-1] == take.motion.weights.shape[1]


def test_esc_comes_too_late_once_writing_has_begun_but_an_undo_does_not(addon, operator_on):
    operator, context, timer, escape = operator_on
    operator.yields = addon("core.job").BEGUN
    operator.invoke(context, timer)
    operator._job.result()
    assert operator.modal(context, timer) == {"PASS_THROUGH"} and operator.steps == 1
    assert operator.modal(context, escape) == {"PASS_THROUGH"} and not operator.closed
    addon("ui.running")._on_undo()
    assert operator.modal(context, timer) == {"CANCELLED"} and operator.closed


def test_eyes_that_follow_something_are_read_in_steps(addon):
    life, look = addon("scene.life.settings"), addon("scene.life.head_and_eyes").look
    ball = grid("Ball", 3)
    for frame, place in ((1, 0.0), (201, 2.0)):
        ball.location.x = place
        ball.keyframe_insert("location", frame=frame)
    bpy.context.scene.frame_set(7)
    still = addon("core.take").Life(np.zeros((200, 3)), np.zeros((200, 2, 2)), np.eye(3, 4))
    settings = SimpleNamespace(life=life.LifeSettings(gaze="PARTS", look_at="Ball"))
    frames = addon("core.take").Frames(np.zeros((200, 1, 3)))
    take = addon("core.take").Take(24.0, 9.0, "frames", frames, life=still)
    steps = 0
    for _ in look(take, settings, 1.0, 24.0):
        steps += 1
        assert bpy.context.scene.frame_current == 7
    assert steps >= 40 and still.looked_at.shape == (200, 3)
    assert (np.diff(still.looked_at[:, 0]) > 0).all()


def test_in_slices_it_is_the_same_take(addon, stage, tmp_path):
    ob, snapshot, take = snapshot_of(addon, stage, tmp_path)
    bake = addon("scene.bake")
    own_keys(ob, "Smile")
    bpy.context.scene.frame_set(1)
    before = everything()
    bake.write(ob, snapshot, take)
    whole, moved = everything(), shape(ob, START + 20)
    bpy.context.scene.frame_set(1)
    bpy.ops.anyface.remove()
    bpy.context.scene.frame_set(1)
    assert everything() == before
    for _ in bake.landing(ob, snapshot, take):
        pass
    assert np.array_equal(shape(ob, START + 20), moved)
    bpy.context.scene.frame_set(1)
    assert len(everything()) == len(whole)
    bpy.ops.anyface.remove()
    bpy.context.scene.frame_set(1)
    assert everything() == before


@pytest.mark.parametrize("again", [False, True])
def test_cancelled_while_it_lands_nothing_has_changed(addon, stage, tmp_path, again):
    ob, snapshot, take = snapshot_of(addon, stage, tmp_path)
    bake = addon("scene.bake")
    if again:
        bake.write(ob, snapshot, take)
    bpy.context.scene.frame_set(1)
    before = everything()
    landing = bake.landing(ob, snapshot, take)
    for _ in range(5):
        next(landing)
    landing.close()
    bpy.context.scene.frame_set(1)
    assert everything() == before


def test_esc_while_it_lands_leaves_the_face_as_it_was(addon, operator_on):
    operator, context, timer, escape = operator_on
    operator.invoke(context, timer)
    operator._job.result()
    assert operator.modal(context, timer) == {"PASS_THROUGH"}
    assert operator.steps and addon("ui.running").is_running()
    assert operator.modal(context, escape) == {"CANCELLED"}
    assert operator.closed and not addon("ui.running").is_running()
    assert context.window_manager.timers == 0


@pytest.fixture
def operator_on(addon, monkeypatch):
    """An operator that lands in endless slices, its window's stand-in, a timer and an Esc event."""
    operators = addon("ui.operators")
    window = SimpleNamespace(app=SimpleNamespace(background=False), data=bpy.data)
    monkeypatch.setattr(operators, "bpy", window)

    class Operator(operators.InThread):
        bl_label = "Test"

        def __init__(self):
            self.steps, self.closed, self.yields = 0, False, None

        def report(self, kind, text):
            """Says nothing."""

        def read(self, context, ob):
            return SimpleNamespace(work=lambda progress: 7)

        def land(self, ob, read, worked):
            try:
                while True:
                    self.steps += 1
                    time.sleep(0.002)
                    yield self.yields
            finally:
                self.closed = True

    context = figures.window()
    timer = SimpleNamespace(type="TIMER", value="NOTHING")
    return Operator(), context, timer, SimpleNamespace(type="ESC", value="PRESS")


def test_what_was_prepared_goes_where_it_cannot_be_used(stage, tmp_path):
    ob = grid()
    ob.anyface.source, ob.anyface.sound_file = "FILE", tone(tmp_path / "tone.wav")
    ob.anyface.mode = "frames"
    bpy.ops.anyface.generate()
    bpy.context.scene.frame_set(1)
    before = everything()
    ob.anyface.mode, ob.anyface_output.new_take = "basis", True
    with pytest.raises(RuntimeError, match="cannot wait"):
        bpy.ops.anyface.generate()
    bpy.context.scene.frame_set(1)
    assert everything() == before
    ob.anyface_output.new_take = False
    action = bpy.data.actions.new("Own")
    bpy.ops.anyface.remove()
    own_keys(ob, "Smile").animation_data_create().action = action
    count = len(bpy.data.actions)
    bpy.ops.anyface.generate()
    assert len(bpy.data.actions) == count, "the curves lie in the artist's action"
