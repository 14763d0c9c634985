"""New keys are named after what they do, and make the same take."""

import bpy
import numpy as np
import pytest

from figures import babble

FRAMES = 120


def face():
    """Landmarks of a face in metres, +x left, +y up, +z forward, and vertices around them."""
    random = np.random.default_rng(3)
    marks = np.zeros((68, 3))
    turn = np.linspace(np.pi, 2.0 * np.pi, 17)
    marks[:17, :2] = np.column_stack([0.07 * np.cos(turn), 0.02 + 0.09 * np.sin(turn)])
    marks[17:22, :2] = np.column_stack([np.linspace(-0.05, -0.015, 5), np.full(5, 0.055)])
    marks[22:27, :2] = np.column_stack([np.linspace(0.015, 0.05, 5), np.full(5, 0.055)])
    marks[27:31, 1] = np.linspace(0.03, 0.0, 4)
    marks[31:36, :2] = np.column_stack([np.linspace(-0.012, 0.012, 5), np.full(5, -0.008)])
    for first, x in ((36, -0.032), (42, 0.032)):
        angle = np.radians([180, 120, 60, 0, -60, -120])
        marks[first : first + 6, :2] = np.column_stack(
            [x + 0.014 * np.cos(angle), 0.03 + 0.006 * np.sin(angle)]
        )
    for first, count, size in ((48, 12, 1.0), (60, 8, 0.7)):
        angle = np.linspace(np.pi, -np.pi, count, endpoint=False)
        marks[first : first + count, :2] = np.column_stack(
            [0.025 * size * np.cos(angle), -0.035 + 0.008 * size * np.sin(angle)]
        )
    near = np.repeat(marks, 12, axis=0) + random.normal(0.0, 0.0015, (816, 3))
    return marks, np.concatenate([marks, near]).astype(np.float32)


def pulses(*frames):
    """A control that pulses at some frames."""
    at = np.arange(FRAMES)[:, None]
    return np.exp(-((at - np.array(frames)) ** 2) / 12.0).sum(axis=1)


def take(take_module, slider_module, marks, positions, seed, left_blink=1.0):
    """A basis that mixes jaw, blinks and brows. Returns it and each control's weights over time."""
    number = np.concatenate([np.arange(68), np.repeat(np.arange(68), 12)])
    chin = np.isin(number, [*range(4, 13), *range(55, 60), *range(65, 68)])
    right, left = np.isin(number, [37, 38]), np.isin(number, [43, 44])
    patterns = np.zeros((4, len(positions), 3))
    patterns[0, chin, 1] = -0.015
    patterns[1, right, 1] = -0.008
    patterns[1, left, 1] = -0.008 * left_blink
    patterns[2, np.isin(number, range(17, 27)), 1] = 0.004
    patterns[3, :, 2] = 1e-5 * np.cos(80.0 * positions[:, 0])
    over_time = np.column_stack(
        [pulses(10, 25, 50, 80, 100), pulses(40, 90), pulses(60), np.cos(np.arange(FRAMES) / 7.0)]
    )
    mix = np.linalg.qr(np.random.default_rng(seed).normal(size=(4, 4)))[0]
    weights, vectors = over_time @ mix, np.tensordot(mix.T, patterns, axes=1)
    peak = np.abs(weights).max(axis=0)
    weights, vectors = weights / peak, vectors * peak[:, None, None]
    change = slider_module.SliderChange(np.array([0.0]), -weights[None].astype(np.float32))
    basis = take_module.Basis(vectors.astype(np.float32), weights.astype(np.float32), 0.1)
    basis.sliders = {"articulation": change}
    return basis, over_time


def moved(basis, weights):
    return np.tensordot(weights, basis.vectors, axes=1)


@pytest.fixture
def parts(addon):
    return addon("core.take"), addon("core.sliders")


def test_the_same_take_comes_in_keys_that_follow_their_controls(addon, parts):
    marks, positions = face()
    basis, over_time = take(*parts, marks, positions, 0)
    whole = moved(basis, basis.weights)
    changed = moved(basis, basis.sliders["articulation"].at(0.0))
    addon("core.basis_names").arrange(basis, positions, marks)
    assert basis.names == ["jaw", "brows", "blink", "rest"]
    np.testing.assert_allclose(moved(basis, basis.weights), whole, atol=2e-7)
    after = moved(basis, basis.sliders["articulation"].at(0.0))
    np.testing.assert_allclose(after, changed, atol=2e-7)
    np.testing.assert_allclose(np.abs(basis.weights).max(axis=0), 1.0, atol=1e-6)
    for name, column in (("jaw", 0), ("blink", 1), ("brows", 2)):
        weights = basis.weights[:, basis.names.index(name)]
        assert np.corrcoef(weights, over_time[:, column])[0, 1] > 0.99, name
    # The jaw key hardly moves the lids, and the blink key hardly moves the chin.
    far = np.abs(basis.vectors).max(axis=2)
    lids, chin = np.isin(np.arange(68), [37, 43]), np.isin(np.arange(68), [8])
    assert far[0, :68][lids].max() < 0.05 * far[0, :68][chin].max()
    assert far[2, :68][chin].max() < 0.05 * far[2, :68][lids].max()


def test_names_do_not_depend_on_how_the_basis_was_mixed(addon, parts):
    marks, positions = face()
    bases = []
    for seed in range(6):
        basis, _ = take(*parts, marks, positions, seed)
        addon("core.basis_names").arrange(basis, positions, marks)
        bases.append((basis.names, basis.vectors))
    for names, vectors in bases[1:]:
        assert names == bases[0][0]
        np.testing.assert_allclose(vectors[:3], bases[0][1][:3], atol=2e-5)


def test_a_turned_and_scaled_face_has_the_same_names(addon, parts):
    marks, positions = face()
    basis, _ = take(*parts, marks, positions, 0)
    turn = np.linalg.qr(np.random.default_rng(5).normal(size=(3, 3)))[0]
    turn *= 40.0 * np.sign(np.linalg.det(turn))
    basis.vectors = (basis.vectors @ turn.T).astype(np.float32)
    turned = (positions @ turn.T + 7.0).astype(np.float32)
    addon("core.basis_names").arrange(basis, turned, marks @ turn.T + 7.0)
    assert basis.names == ["jaw", "brows", "blink", "rest"]


def test_eyes_that_blink_apart_have_a_key_each(addon, parts):
    marks, positions = face()
    basis, _ = take(*parts, marks, positions, 0, left_blink=0.0)
    addon("core.basis_names").arrange(basis, positions, marks)
    assert basis.names[:3] == ["jaw", "brows", "blink right"]


def test_layers_stay_apart(addon, parts):
    marks, positions = face()
    basis, _ = take(*parts, marks, positions, 0)
    other, _ = take(*parts, marks, positions, 1)
    joined = addon("core.layers").joined(basis, other)
    whole = moved(joined, joined.weights)
    addon("core.basis_names").arrange(joined, positions, marks)
    assert joined.names[4:] == [f"emotion {name}" for name in joined.names[:4]]
    np.testing.assert_allclose(moved(joined, joined.weights), whole, atol=4e-7)


def test_what_cannot_be_named_stays(addon, parts):
    marks, positions = face()
    basis, _ = take(*parts, marks, positions, 0)
    before = basis.vectors.copy()
    addon("core.basis_names").arrange(basis, positions, np.zeros((68, 3)))
    assert basis.names == [] and np.array_equal(basis.vectors, before)


def test_generate_names_the_keys_of_the_default_head(addon, tmp_path):
    sound = babble(tmp_path / "a.wav", seconds=3.0)
    bpy.context.scene.render.fps = 24
    bpy.ops.anyface.add_sample_head()
    ob = bpy.context.object
    ob.anyface.source, ob.anyface.sound_file = "FILE", sound
    assert bpy.ops.anyface.generate() == {"FINISHED"}
    first = [block.name for block in ob.data.shape_keys.key_blocks]
    assert first[1] == "Anyface.jaw" or "Anyface.blink" in first, first
    assert all(name.startswith("Anyface.") for name in first[1:])
    assert bpy.ops.anyface.generate() == {"FINISHED"}
    assert [block.name for block in ob.data.shape_keys.key_blocks] == first
    ob.anyface.named_keys = False
    assert bpy.ops.anyface.generate() == {"FINISHED"}
    assert ob.data.shape_keys.key_blocks[1].name == "Anyface.001"
    assert bpy.ops.anyface.remove() == {"FINISHED"}
    assert ob.data.shape_keys is None
