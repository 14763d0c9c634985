"""FaceTalk's speech model: masks, guidance, and codes that are the weights they were made of."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from training.corpus.faces import CHANNELS
from training.corpus.grid import tracked_lids
from training.corpus.windows import Batch
from training.systems.facetalk.config import debug_config as debug_head
from training.systems.facetalk.head import Head
from training.systems.facetalk.motion import (
    Denoiser,
    MotionConfig,
    debug_config,
    paper_config,
    sample,
    sample_from,
)
from training.systems.facetalk.train_motion import UPPER_FACE, Codes, Trainer
from training.tests.test_parity import SHARED, needs_shared


def random_denoiser() -> Denoiser:
    torch.manual_seed(2)
    model = Denoiser(debug_config()).eval()
    with torch.no_grad():
        for parameter in model.parameters():
            parameter.add_(0.1 * torch.randn_like(parameter))
    return model


def one_pass(model: Denoiser, noisy, speech, has_speech=True, r=1.0, t=300) -> torch.Tensor:
    with torch.no_grad():
        return model(noisy, torch.tensor([t]), speech, torch.tensor([has_speech]), torch.tensor([r]))


def test_a_row_sees_itself_and_what_lies_behind_but_not_beyond_the_look_back():
    model, config = random_denoiser(), debug_config()
    noisy, speech = torch.randn(1, 20, config.codes), torch.randn(1, 20, config.speech.channels)
    before = one_pass(model, noisy, speech)
    other = noisy.clone()
    other[0, 9] += 1.0
    changed = (one_pass(model, other, speech) - before).abs().amax(-1)[0] > 1e-6
    assert not changed[:9].any() and changed[9]
    reach = config.blocks * (config.look_back_frames - 1)
    assert changed[9 : 9 + config.look_back_frames].all() and not changed[9 + reach + 1 :].any()


def test_speech_is_heard_in_its_own_frame_alone_and_not_at_all_when_dropped():
    model, config = random_denoiser(), replace(debug_config(), look_back_frames=1)
    model.config = config
    noisy, speech = torch.randn(1, 12, config.codes), torch.randn(1, 12, config.speech.channels)
    other = speech.clone()
    other[0, 5] += 1.0
    changed = (one_pass(model, noisy, other) - one_pass(model, noisy, speech)).abs().amax(-1)[0] > 1e-6
    assert changed.nonzero()[:, 0].tolist() == [5]
    torch.testing.assert_close(one_pass(model, noisy, other, False), one_pass(model, noisy, speech, False))


def test_vividness_and_timestep_are_told():
    model, config = random_denoiser(), debug_config()
    noisy, speech = torch.randn(1, 12, config.codes), torch.randn(1, 12, config.speech.channels)
    usual = one_pass(model, noisy, speech)
    assert (one_pass(model, noisy, speech, r=1.3) - usual).abs().max() > 1e-4
    assert (one_pass(model, noisy, speech, t=700) - usual).abs().max() > 1e-4


def test_guidance_goes_on_beyond_what_speech_adds():
    model, config = random_denoiser(), debug_config()
    speech, noise = torch.randn(15, config.speech.channels), torch.randn(15, config.codes)
    one = replace(config.sampling, steps=1)
    deaf, heard, strong = (
        sample_from(model, noise, speech, replace(one, guidance=w)) for w in (0.0, 1.0, 2.0)
    )
    torch.testing.assert_close(strong - heard, heard - deaf, atol=1e-4, rtol=1e-3)
    assert (heard - deaf).abs().max() > 1e-3


def test_a_seed_gives_the_same_codes_and_another_gives_others():
    model, speech = random_denoiser(), torch.randn(15, debug_config().speech.channels)
    torch.testing.assert_close(sample(model, speech, 3), sample(model, speech, 3))
    assert (sample(model, speech, 3) - sample(model, speech, 4)).abs().max() > 1e-3


def test_speech_of_another_length_is_told():
    model, config = random_denoiser(), debug_config()
    with pytest.raises(ValueError, match="expected 12, got 13"):
        one_pass(model, torch.randn(1, 12, config.codes), torch.randn(1, 13, config.speech.channels))


def test_codes_come_back_as_the_weights_they_were_made_of():
    config = replace(debug_head(), channels=list(CHANNELS), expression_code=64)
    codes = Codes(Head(config))
    weights = torch.rand(7, len(CHANNELS))
    torch.testing.assert_close(codes.weights(codes.of(weights)), weights, atol=1e-4, rtol=1e-4)


def test_a_model_that_goes_on_gives_the_same_codes_with_other_means_and_deviations():
    first, second = random_denoiser(), Denoiser(debug_config()).eval()
    first.mean.copy_(torch.randn(len(first.mean)))
    first.std.copy_(0.5 + torch.rand(len(first.std)))
    second.mean.copy_(torch.randn(len(first.mean)))
    second.std.copy_(0.5 + torch.rand(len(first.std)))
    mean, std = second.mean.clone(), second.std.clone()
    second.go_on_from(first)
    assert torch.equal(second.mean, mean) and torch.equal(second.std, std)
    codes, speech = torch.randn(1, 12, len(mean)), torch.randn(1, 12, debug_config().speech.channels)
    for has_speech in (True, False):
        one, other = (
            m.to_codes(one_pass(m, m.standardise(codes), speech, has_speech)) for m in (first, second)
        )
        torch.testing.assert_close(one, other, atol=1e-4, rtol=1e-4)


def test_rows_without_brows_and_lids_get_those_of_rows_that_have_them():
    trainer = Trainer.__new__(Trainer)
    trainer.by_landmarks, trainer.random = False, torch.Generator().manual_seed(0)
    motion, weight = torch.rand(4, 6, len(CHANNELS)), torch.ones(4, 6, len(CHANNELS))
    weight[1:3, :, UPPER_FACE] = 0.0
    batch = Batch(
        torch.zeros(4, 6, 1), motion, weight, torch.zeros(4, 6), torch.zeros(4, 6, 16), torch.zeros(4)
    )
    weights = trainer.weights(batch)
    others = [i for i in range(len(CHANNELS)) if i not in UPPER_FACE]
    assert torch.equal(weights[..., others], motion[..., others])
    assert torch.equal(weights[[0, 3]], motion[[0, 3]])
    for row in (1, 2):
        assert any(torch.equal(weights[row][:, UPPER_FACE], motion[d][:, UPPER_FACE]) for d in (0, 3))
    weight[..., UPPER_FACE] = 0.0
    assert torch.equal(trainer.weights(batch), motion)


@needs_shared
def test_tracked_lids_rest_at_the_speakers_usual_pose_and_blink():
    lids = tracked_lids(SHARED / "data", ["eyeBlinkLeft", "eyeBlinkRight"])
    sources = {source for source, _ in lids}
    assert sources == {"grid_s1", "grid_five"}
    rows = np.concatenate([rows for (source, _), rows in lids.items() if source == "grid_s1"])
    assert np.abs(np.median(rows, axis=0)).max() < 1e-6 and rows.max() <= 1.0 and rows.min() >= 0.0
    shut = np.diff((rows > 0.4).astype(int), axis=0) > 0
    assert 20 < shut[:, 0].sum() / (len(rows) / 25 / 60) < 60, "blinks a minute"


def test_the_papers_size_walks_all_steps_from_full_noise():
    config = replace(paper_config(), width=16, inner=16, blocks=1, heads=2, feedforward=16, codes=5)
    config.speech.channels, steps = 8, []
    model = Denoiser(config).eval()
    forward = model.forward
    model.forward = lambda x, t, *more: (steps.append((int(t), float(x.std()))), forward(x, t, *more))[1]
    sample(model, torch.randn(20, 8), sampling=replace(config.sampling, guidance=1.0))
    assert [t for t, _ in steps] == list(range(999, -1, -1))
    assert 0.8 < steps[0][1] < 1.2


def test_a_configuration_comes_back():
    config = MotionConfig(band=2, film=False)
    assert MotionConfig.from_json(config.to_json()) == config
