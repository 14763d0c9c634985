"""The streaming student trains on corpus folders too, and goes on with the same bits."""

from pathlib import Path

import pytest
import torch

from training.systems.freetalk import train as train_ats
from training.systems.freetalk import train_stream
from training.tests.killed import killed
from training.tests.made_up import made_up

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def corpus(tmp_path_factory) -> Path:
    """Six clips of 2 s."""
    return made_up(tmp_path_factory.mktemp("corpus") / "made_up", 2.0)


def state(trainer, corpus: Path, out: Path, *more: str) -> dict[str, torch.Tensor]:
    """Weights after a training of `debug` size."""
    flags = ["--corpus", str(corpus), "--out", str(out), "--config", "debug", *more]
    return torch.load(trainer.train(trainer.parser().parse_args(flags)))["state"]


@pytest.fixture(scope="module")
def finished(corpus, tmp_path_factory) -> Path:
    """An ats.pt."""
    flags = ["--config", "debug", "--validation-clips", "0", "--steps", "4"]
    state(train_ats, corpus, out := tmp_path_factory.mktemp("ats"), *flags)
    return out / "ats.pt"


def test_a_trainer_killed_goes_on_with_the_same_bits(corpus, finished, tmp_path, monkeypatch):
    more = ("--ats", str(finished))
    whole = state(train_stream, corpus, tmp_path / "whole", *more)
    with killed(monkeypatch, 9, 12):
        state(train_stream, corpus, tmp_path / "parts", *more)
    again = state(train_stream, corpus, tmp_path / "parts", *more)
    assert all(torch.equal(value, again[name]) for name, value in whole.items())
    assert "made_up gap r" in (tmp_path / "parts/log.csv").read_text().splitlines()[0]
