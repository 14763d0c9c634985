"""The causal twin of the ear and the detector of closed lips: they learn what the ear hears, and export."""

import argparse
import json

import pytest
import torch

from training.corpus.lesson_windows import DIMS, LessonSampler
from training.corpus.lessons import Lesson, taught_by
from training.export import export
from training.nn.checkpoint import write_model
from training.speech import train_causal, train_live_closures
from training.speech.causal import StreamNet, debug_config, perform
from training.speech.phones import CLASSES, PhoneConfig, PhoneReadout
from training.speech.train_causal import loss_of, new_model, validate

CHANNELS = 16


def spoken(index: int, generator: torch.Generator) -> Lesson:
    """A clip of noise in two voices. What the ear hears follows the loudness of the noise."""
    mels = torch.randn((2, 4 * 90, 64), generator=generator).half()
    heard = mels[0].float().unflatten(0, (90, 4)).mean(dim=1)[:, :CHANNELS]
    nothing, phones = torch.zeros(90, DIMS), torch.full((4 * 90,), -1, dtype=torch.int16)
    clip = (f"c{index}", "speech", index == 5, mels, nothing, nothing, phones)
    return Lesson(*clip, heard=heard.half())


@pytest.fixture(scope="module")
def heard() -> list[Lesson]:
    """Six lessons, one of them held out."""
    generator = torch.Generator().manual_seed(4)
    return [spoken(index, generator) for index in range(6)]


@pytest.fixture(scope="module")
def lessons(heard) -> list[Lesson]:
    """They teach the features themselves."""
    return taught_by(heard, lambda features: features)


@pytest.fixture(scope="module")
def closing(heard) -> list[Lesson]:
    """They teach when the lips are together."""
    torch.manual_seed(3)
    readout = PhoneReadout(PhoneConfig(channels=CHANNELS, hidden=8)).eval()
    readout.out.weight.data *= 20.0
    return taught_by(heard, train_live_closures.Closures(readout))


def sampler_of(lessons: list[Lesson], config, dims: int) -> LessonSampler:
    """A sampler of these lessons. In silence they teach zeros."""
    return LessonSampler(lessons, {"speech": 1.0}, 0, config, torch.zeros(dims))


def test_closures_are_a_probability_and_even_phones_are_just_closed(closing):
    said = torch.cat([x.motion[:, DIMS:] for x in closing]).float()
    assert said.shape[1] == 1 and (said >= 0).all() and (said <= 1).all() and said.std() > 0.01
    readout = PhoneReadout(PhoneConfig(channels=CHANNELS, hidden=8))
    torch.nn.init.zeros_(readout.out.weight)
    signs = list(CLASSES)
    others = len(signs) - len(train_live_closures.BILABIALS)
    likely = {sign: 1.0 / len(train_live_closures.BILABIALS) for sign in train_live_closures.BILABIALS}
    bias = torch.tensor([likely.get(sign, 1.0 / others) for sign in signs]).log()
    readout.out.bias.data = bias.repeat(4)
    probability = train_live_closures.Closures(readout)(torch.randn(5, CHANNELS))
    assert probability.shape == (5, 1)
    assert torch.allclose(probability, torch.tensor(train_live_closures.CLOSED), atol=0.01)


def test_the_student_comes_nearer_to_what_the_ear_hears(lessons):
    torch.manual_seed(5)
    model = new_model(argparse.Namespace(config="debug"), lessons)
    assert model.config.outputs == CHANNELS and model.config.model == "causal_speech"
    sampler = sampler_of(lessons, model.config, CHANNELS)
    optimiser = torch.optim.Adam(model.parameters(), 3e-3)
    batch, losses = sampler.batch(4, 32), []
    for _ in range(25):
        loss, parts = loss_of(model, batch)
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
        losses.append(parts["features"])
    assert losses[-1] < 0.9 * losses[0]
    assert set(validate(model, lessons, 4)) == {"speech met"}


def test_the_folder_bears_the_name_of_the_model(tmp_path):
    config = debug_config()
    config.model, config.outputs = "causal_speech", 16
    model = StreamNet(config).eval()
    torch.save({"state": model.state_dict(), "config": config.to_json()}, tmp_path / "stream.pt")
    folder = export("stream", tmp_path, run=tmp_path / "stream.pt")[0]
    assert folder.name == "causal_speech"
    assert json.loads((folder / "config.json").read_text())["outputs"] == 16
    assert perform(model, torch.zeros(40, 64), 9).shape == (9, 16)


def test_a_finished_twin_is_measured(lessons, tmp_path, monkeypatch, capsys):
    config = debug_config()
    config.outputs = CHANNELS
    write_model(tmp_path / "model", StreamNet(config).state_dict(), config.to_json())
    monkeypatch.setattr(train_causal, "prepare", lambda _: (lessons, torch.zeros(CHANNELS)))
    train_causal.main(["--measure", "--finished", str(tmp_path / "model"), "--out", str(tmp_path / "out")])
    size, score = capsys.readouterr().out.splitlines()
    assert "million parameters, look-ahead " in size and score.startswith("speech met ")
    assert not (tmp_path / "out").exists()


def test_the_student_learns_when_lips_are_together(closing):
    torch.manual_seed(6)
    model = train_live_closures.new_model(argparse.Namespace(config="debug", sooner=[]), closing)
    assert (model.config.model, model.config.outputs) == ("live_closures", 1)
    sampler = sampler_of(closing, model.config, 1)
    optimiser = torch.optim.Adam(model.parameters(), 3e-3)
    batch, losses = sampler.batch(4, 32), []
    for _ in range(25):
        loss, parts = train_live_closures.loss_of(model, batch)
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
        losses.append(parts["closed"])
    assert losses[-1] < losses[0]
    shares = train_live_closures.validate(model, closing, 4)
    assert set(shares) == {f"speech {share}" for share in train_live_closures.SHARES}
    assert all(0 <= x <= 1 for x in shares.values())


def test_further_heads_learn_on_a_finished_student_and_shut_lips_as_often(closing, tmp_path):
    torch.manual_seed(6)
    first = train_live_closures.new_model(argparse.Namespace(config="debug", sooner=[]), closing)
    write_model(tmp_path, first.state_dict(), first.config.to_json(), exact=("",))
    arguments = argparse.Namespace(config="debug", sooner=[3, 5], finished=tmp_path)
    model = train_live_closures.new_model(arguments, closing)
    sampler = sampler_of(closing, model.config, 1)
    optimiser = torch.optim.Adam([p for p in model.parameters() if p.requires_grad], 3e-3)
    batch, losses = sampler.batch(4, 32), []
    for _ in range(25):
        loss, parts = train_live_closures.loss_of(model, batch)
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
        losses.append([parts["3 sooner closed"], parts["5 sooner closed"]])
    assert losses[-1][0] < losses[0][0] and losses[-1][1] < losses[0][1]
    for name, value in first.state_dict().items():
        assert torch.equal(model.state_dict()[name], value), name
    train_live_closures.calibrate(model, closing)
    clips = [x for x in closing if not x.held_out]
    for head in range(2):
        shut = [perform(model, x.mels[0].float(), len(x.motion), head)[:, 0].sigmoid() for x in clips]
        main = [perform(model, x.mels[0].float(), len(x.motion))[:, 0].sigmoid() for x in clips]
        share, main_share = (
            (torch.cat(rows) > train_live_closures.CLOSED).float().mean() for rows in (shut, main)
        )
        assert abs(float(share - main_share)) < 0.02


def test_a_finished_student_of_closures_is_measured(closing, tmp_path, monkeypatch, capsys):
    config = debug_config()
    config.outputs, config.sooner = 1, [3]
    write_model(tmp_path, StreamNet(config).state_dict(), config.to_json())
    monkeypatch.setattr(train_live_closures, "prepare", lambda _: (closing, torch.zeros(1)))
    line = ["--measure", "--finished", str(tmp_path)]
    train_live_closures.measure(train_live_closures.parser().parse_args(line))
    heads = [row.split(" | ")[0] for row in capsys.readouterr().out.splitlines()[1:]]
    assert heads == ["| clips", "| speech", "| speech 3 sooner"]


def test_closures_within_a_frame_are_met():
    taught = torch.tensor([0.0, 0.9, 0.9, 0.0, 0.0, 0.0, 0.0, 0.9])
    predicted = torch.tensor([0.9, 0.0, 0.0, 0.0, 0.0, 0.9, 0.0, 0.0])
    counts = train_live_closures.closure_counts(predicted, taught).tolist()
    assert counts == [[1, 2], [1, 2], [2, 8], [3, 8]]


def test_stretches_of_closed_lips_are_found_at_both_ends():
    mask = torch.tensor([True, False, True, True, False, True])
    assert train_live_closures.runs(mask) == [slice(0, 1), slice(2, 4), slice(5, 6)]
