"""Facts about the streaming student and its lessons."""

from dataclasses import replace

import pytest
import torch

from training.corpus.bank import Entry
from training.corpus.lesson_windows import DIMS, LessonSampler
from training.corpus.lessons import Lesson, taught_by
from training.losses import FEATURES, landmark_weights
from training.machine import Machine
from training.nn.checkpoint import save, write_model
from training.speech.causal import (
    StreamConfig,
    StreamNet,
    debug_config,
    normalise_running,
    nothing_heard,
    speak,
)
from training.speech.log_mel import log_mel, normalise
from training.systems.freetalk import train_stream
from training.systems.freetalk.ats import AtsDenoiser
from training.systems.freetalk.ats import debug_config as debug_ats
from training.systems.freetalk.stored import load_models
from training.systems.freetalk.strangers import full_model
from training.systems.freetalk.train_stream import FullModel, loss_of


@pytest.fixture
def model() -> StreamNet:
    """A random debug model."""
    torch.manual_seed(3)
    return StreamNet(debug_config()).eval()


def voice(seconds: float, seed: int = 0) -> torch.Tensor:
    """Noise that swells and fades like syllables, [S]."""
    generator = torch.Generator().manual_seed(seed)
    noise = torch.randn(int(16000 * seconds), generator=generator)
    time = torch.arange(len(noise)) / 16000
    return 0.2 * noise * (0.02 + (4.0 * time).sin().square())


def test_config_survives_json():
    for config in (StreamConfig(), debug_config()):
        assert StreamConfig.from_json(config.to_json()) == config


def test_size_and_look_ahead_are_within_their_bounds():
    config = StreamConfig()
    assert sum(p.numel() for p in StreamNet(config).parameters()) <= 0.9e6
    assert config.look_ahead_s() <= 0.2
    assert config.look_ahead_samples() == 160 * 18 + 200


def test_sound_after_the_look_ahead_changes_nothing(model):
    samples = voice(1.5)
    before = speak(model, samples, 38)
    for frame in (0, 9, 20):
        edge = 640 * frame + model.config.look_ahead_samples()
        other = samples.clone()
        other[edge:] += 0.5
        after = speak(model, other, 38)
        torch.testing.assert_close(after[: frame + 1], before[: frame + 1], atol=1e-6, rtol=0)
        assert not torch.allclose(after[frame + 1], before[frame + 1], atol=1e-5)


def test_wrong_number_of_mel_frames_is_refused(model):
    with pytest.raises(ValueError, match="expected"):
        model(torch.zeros(1, 40, 64))


def test_running_normalisation_hears_the_past_only():
    mel = log_mel(voice(2.0))[None]
    config = StreamConfig().normaliser
    whole = normalise_running(mel, config)
    part = normalise_running(mel[:, :77], config)
    torch.testing.assert_close(whole[:, :77], part)


def test_running_normalisation_approaches_that_of_the_whole_clip():
    config = StreamConfig().normaliser
    for gain in (1.0, 0.2):
        mel = log_mel(voice(12.0) * gain)
        late = slice(800, 1200)
        difference = normalise_running(mel[None], config)[0, late] - normalise(mel)[late]
        assert difference.mean(dim=1).abs().max() < 0.25


def test_near_silence_is_not_blown_up():
    hiss = 1e-4 * torch.randn(160000, generator=torch.Generator().manual_seed(1))
    assert (normalise_running(log_mel(hiss)[None], StreamConfig().normaliser) < -0.5).all()


def test_voices_of_a_batch_do_not_hear_each_other():
    config = StreamConfig().normaliser
    loud, quiet = log_mel(voice(1.0)), log_mel(0.05 * voice(1.0, seed=1))
    both = normalise_running(torch.stack([loud, quiet]), config, nothing_heard(config, 2))
    alone = normalise_running(quiet[None], config)
    torch.testing.assert_close(both[1:], alone)


@pytest.fixture(scope="module")
def lessons() -> list[Lesson]:
    """Two clips with capture and one without, taught by a random model."""
    torch.manual_seed(5)
    torch.set_num_threads(1)
    denoiser = AtsDenoiser(debug_ats())
    denoiser.std.fill_(1e-3)
    clips = [lesson("grid_s1", 1.0), lesson("grid_s1", 1.0), lesson("voices", 0.0)]
    return taught_by(clips, FullModel(denoiser))


def lesson(source: str, weight: float) -> Lesson:
    """A clip of 40 frames whose lips move as random numbers do."""
    mels = torch.stack([log_mel(voice(1.6, seed))[:160] for seed in (0, 1)]).half()
    motion = 1e-3 * torch.randn(40, DIMS) * (weight > 0)
    phones = torch.full((mels.shape[1],), -1, dtype=torch.int16)
    heard = torch.randn(40, debug_ats().speech.channels).half()
    clip = ("clip", source, False, mels, motion, torch.full((40, DIMS), weight), phones)
    return Lesson(*clip, heard=heard)


def sampler_of(lessons: list[Lesson], config) -> LessonSampler:
    """A sampler of these lessons. In silence the face rests."""
    return LessonSampler(lessons, {"grid_s1": 0.5, "voices": 0.5}, 0, config, torch.zeros(DIMS))


def test_windows_hold_sound_up_to_the_look_ahead(lessons):
    config = debug_config()
    batch = sampler_of(lessons, config).batch(12, 24)
    assert batch.mel.shape == (12, config.mel_rows(24), 64)
    assert batch.captured.shape == batch.taught.shape == batch.weight.shape == (12, 24, 204)
    uncaptured = batch.weight.sum(dim=(1, 2)) == 0
    assert uncaptured.any() and not uncaptured.all()
    assert batch.captured[uncaptured].abs().max() == 0.0 and batch.taught[uncaptured].std() > 0


def test_the_student_learns_from_a_batch(lessons, model):
    sampler = sampler_of(lessons, model.config)
    model.std.fill_(1e-3)
    batch = sampler.batch(6, 24)
    optimiser = torch.optim.AdamW(model.train().parameters(), lr=3e-3)
    losses = []
    for _ in range(12):
        optimiser.zero_grad()
        heard = replace(batch, heard=sampler._heard(batch.mel))
        loss, _ = loss_of(model, heard, landmark_weights(), Machine("cpu", "bfloat16"))
        loss.backward()
        optimiser.step()
        losses.append(loss.item())
    assert losses[-1] < 0.8 * losses[0]


def test_a_silent_window_joins_the_batch(lessons):
    config = debug_config()
    sampler = sampler_of(lessons, config)
    sampler.augment.silent_share = 1.0
    assert sampler.batch(2, 24).captured.abs().max() == 0.0


def test_a_finished_student_is_measured(lessons, model, tmp_path, monkeypatch, capsys):
    folder = write_model(tmp_path / "stream", model.state_dict(), model.config.to_json())
    held_out = [replace(x, held_out=True) for x in lessons[1:]]
    prepared = ([lessons[0], *held_out], torch.zeros(DIMS))
    monkeypatch.setattr(train_stream, "prepare", lambda _: prepared)
    train_stream.measure(train_stream.parser().parse_args(["--measure", "--finished", str(folder)]))
    rows = [row.split(" | ") for row in capsys.readouterr().out.splitlines()]
    assert rows[0] == ["0.02 million parameters, look-ahead 192.5 ms"]
    assert [row[0] for row in rows[1:]] == ["| clips", "| grid_s1", "| voices"]
    assert all(len(row) == 5 for row in rows[1:])


def test_a_run_without_a_speaker_is_sampled_as_the_shipped_model(tmp_path):
    save(tmp_path / "ats.pt", AtsDenoiser(debug_ats()))
    sampling = full_model(tmp_path / "ats.pt").denoiser.config.sampling
    assert sampling == load_models()[1].config.sampling


def test_a_stranger_is_left_out_whole_and_scored_against_rulers():
    from training.systems.freetalk import strangers

    clips = []
    for number in range(8):
        random = torch.Generator().manual_seed(number)
        mels = torch.randn(1, 160, 64, generator=random).half() - 5.0
        motion = torch.zeros(40, DIMS)
        motion[:, 3 * 66 + 1] = -4e-3 * mels[0].float().unflatten(0, (-1, 4)).mean((1, 2))
        still = torch.ones(40, DIMS)
        name = f"s{4 if number < 2 else 26}_{number}"
        phones = torch.zeros(160, dtype=torch.int16)
        clips.append(Entry(name, "grid_five", False, mels, motion, still, phones))
    stranger = strangers.STRANGERS["s4"]
    assert [stranger.has(clip) for clip in clips] == [True] * 2 + [False] * 6
    assert stranger.flags() == ["--leave-clips", "s4_"]
    assert strangers.STRANGERS["grid_s1"].flags() == ["--leave-out", "grid_s1"]
    ruler = strangers.Ruler(clips[2:], "gap")
    scores = strangers.Scores()
    true = FEATURES["gap"](clips[0].motion)
    scores.add(ruler(clips[0]), true, strangers.loudness(clips[0].mels[0]))
    scores.add(true, true, strangers.loudness(clips[0].mels[0]))
    summary = scores.summary()
    assert scores.r[0] > 0.5 and abs(scores.r[1] - 1.0) < 1e-4
    assert summary["interval"][0] <= summary["r"] <= summary["interval"][1]
