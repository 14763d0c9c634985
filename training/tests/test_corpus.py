"""Facts about cleaning, splits and the losses; the slow ones need ../shared."""

import numpy as np
import pytest
import torch

from training.align import similarity
from training.corpus.emodb import NAMES, read_acted
from training.corpus.facegood import resample
from training.corpus.mirror import mirror, permutation, symmetrise
from training.corpus.split import facegood_first_held_out, grid_held_out
from training.losses import concordance_loss, motion_loss
from training.tests.test_parity import SHARED, needs_shared


def test_every_tenth_sorted_clip_is_held_out():
    names = [f"clip{i:03d}" for i in range(25)]
    assert grid_held_out(names[::-1]) == {"clip000", "clip010", "clip020"}
    assert facegood_first_held_out(100) == 85


def test_mirror_is_its_own_inverse():
    motion = np.random.default_rng(0).standard_normal((4, 68, 3))
    assert sorted(permutation()) == list(range(68))
    np.testing.assert_allclose(mirror(mirror(motion)), motion)
    np.testing.assert_allclose(symmetrise(motion), mirror(symmetrise(motion)))


def test_a_similarity_recovers_a_known_motion():
    random = np.random.default_rng(1)
    points = random.standard_normal((68, 3))
    turn, _ = np.linalg.qr(random.standard_normal((3, 3)))
    turn *= np.sign(np.linalg.det(turn))
    fitted = similarity(points, points @ turn.T + 2.0)
    np.testing.assert_allclose(fitted.rotation, turn, atol=1e-9)
    np.testing.assert_allclose(fitted.scale, 1.0, atol=1e-9)
    np.testing.assert_allclose(fitted(points), points @ turn.T + 2.0, atol=1e-9)


def test_resampling_keeps_a_slow_wave():
    wave = np.sin(2 * np.pi * np.arange(61) / 30.0)[:, None, None] * np.ones((1, 68, 3))
    out = resample(wave, 30.0, 25.0)
    assert out.shape == (51, 68, 3)
    np.testing.assert_allclose(out[:, 0, 0], np.sin(2 * np.pi * np.arange(51) / 25.0), atol=1e-3)


def test_losses_are_zero_for_the_truth_only():
    truth = torch.sin(torch.linspace(0, 9, 40))[None, :, None].repeat(2, 1, 204)
    weight = torch.ones_like(truth)
    assert motion_loss(truth - truth, weight) == 0
    assert motion_loss(truth * 0.5, weight) > 0
    row = truth[..., 0]
    assert concordance_loss(row, row) < 1e-6
    assert concordance_loss(row * 0.5, row) > 0.1


@needs_shared
@pytest.mark.slow
def test_debug_config_trains_and_exports(tmp_path):
    from training.export import export
    from training.systems.freetalk.stored import load_models
    from training.systems.freetalk.train import parser, train

    paths = {"--data": SHARED / "data", "--out": tmp_path / "run", "--cache": tmp_path / "cache"}
    flat = [str(x) for pair in paths.items() for x in pair]
    run = train(parser().parse_args([*flat, "--config", "debug"]))
    export("ats", tmp_path / "models", run=run)
    encoder, denoiser = load_models(tmp_path / "models", "debug")
    assert denoiser.config.speech.channels == encoder.config.channels
    assert (denoiser.std > 0).all()


@needs_shared
def test_acted_recordings_are_read_with_their_emotions():
    clips = read_acted(SHARED / "data", limit=3)
    assert len(clips) == 6 and {clip.held_out for clip in clips} == {True, False}
    assert {clip.emotion for clip in clips} <= set(NAMES.values())
