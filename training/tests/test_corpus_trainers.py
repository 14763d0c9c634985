"""Encoder, student and closures train on corpus folders too, and go on with the same bits."""

from pathlib import Path

import pytest
import torch

from training.speech import train as train_speech
from training.speech import train_closure
from training.speech.compact import load_encoder
from training.systems.freetalk import train as train_ats
from training.systems.freetalk import train_stream
from training.tests.killed import killed
from training.tests.made_up import made_up

pytestmark = pytest.mark.slow
SYLLABLE_S = 0.25


@pytest.fixture(scope="module")
def corpus(tmp_path_factory) -> Path:
    """Six clips of 2 s that say ba ba ba."""
    folder = made_up(tmp_path_factory.mktemp("corpus") / "made_up", 2.0)
    (folder / "phones").mkdir()
    lines = [f"{i * SYLLABLE_S}\t{SYLLABLE_S}\t{'ba'[i % 2]}" for i in range(8)]
    for sound in (folder / "audio").iterdir():
        text = "\n".join(["start_s\tduration_s\tphone", *lines])
        (folder / "phones" / f"{sound.stem}.tsv").write_text(text + "\n")
    return folder


def state(trainer, corpus: Path, out: Path, *more: str) -> dict[str, torch.Tensor]:
    """Weights after a training of `debug` size."""
    flags = ["--corpus", str(corpus), "--out", str(out), "--config", "debug", *more]
    return torch.load(trainer.train(trainer.parser().parse_args(flags)))["state"]


@pytest.fixture(scope="module")
def finished(corpus, tmp_path_factory) -> Path:
    """An ats.pt with its encoder."""
    flags = ["--config", "debug", "--validation-clips", "0", "--steps", "4"]
    state(train_ats, corpus, out := tmp_path_factory.mktemp("ats"), *flags)
    return out / "ats.pt"


@pytest.mark.parametrize("trainer", [train_speech, train_stream])
def test_a_trainer_killed_goes_on_with_the_same_bits(corpus, finished, tmp_path, monkeypatch, trainer):
    more = ("--batch", "4", "--frames", "24") if trainer is train_speech else ("--ats", str(finished))
    whole = state(trainer, corpus, tmp_path / "whole", *more)
    with killed(monkeypatch, 9, 12):
        state(trainer, corpus, tmp_path / "parts", *more)
    again = state(trainer, corpus, tmp_path / "parts", *more)
    assert all(torch.equal(value, again[name]) for name, value in whole.items())
    assert "made_up gap r" in (tmp_path / "parts/log.csv").read_text().splitlines()[0]


def test_an_encoder_of_a_corpus_is_taken_by_the_denoiser(corpus, tmp_path):
    state(train_speech, corpus, tmp_path / "speech", "--batch", "4", "--frames", "24")
    encoder = load_encoder(tmp_path / "speech/speech.pt")
    assert encoder.config.channels == 16


def test_closures_are_read_from_phones_of_a_corpus(corpus, finished, tmp_path):
    run = tmp_path / "ats.pt"
    run.write_bytes(finished.read_bytes())
    flags = ["--run", str(run), "--steps", "4", "--batch", "4"]
    train_closure.main(["--corpus", str(corpus), *flags])
    before, after = (torch.load(path)["encoder"] for path in (finished, run))
    changed = {name for name, value in before.items() if not torch.equal(value, after[name])}
    assert changed == {"closure.weight", "closure.bias"}
    mute = made_up(tmp_path / "mute", 2.0)
    with pytest.raises(ValueError, match="expected phones/CLIP.tsv of one training clip or more, got none"):
        train_closure.main(["--corpus", str(mute), *flags])
