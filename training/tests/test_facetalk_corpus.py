"""FaceTalk's speech model trains on corpus folders: their motion becomes codes of the head."""

from pathlib import Path

import numpy as np
import pytest
import torch

from training import shipped
from training.corpus import arkit, bank
from training.corpus.faces import CHANNELS
from training.corpus.writer import CorpusWriter
from training.systems.facetalk import evaluate_motion, train_motion
from training.systems.facetalk.stored import load_motion
from training.tests.made_up import RATE_HZ, made_up, spoken

JAW, SMILE = CHANNELS.index("jawOpen"), CHANNELS.index("mouthSmileLeft")


def trained(corpus: Path, out: Path, *more: str) -> Path:
    """A motion.pt of `debug` size."""
    line = ["--corpus", corpus, "--out", out, "--config", "debug", "--steps", 6]
    line += ["--windows", 4, "--frames", 24, *more]
    return train_motion.train(train_motion.parser().parse_args([str(x) for x in line]))


def state(path: Path) -> dict[str, torch.Tensor]:
    """Weights of a run."""
    return torch.load(path)["state"]


def recorded(path: Path, splits: dict[str, str], level: float = 1.0) -> Path:
    """Clips of ARKit weights: the jaw swings, the left corner of the mouth stands at a half."""
    writer = CorpusWriter(path, path.name, "m", fps={})
    times = np.arange(120) / 60.0
    for number, (speaker, split) in enumerate(splits.items()):
        writer.clip(f"{speaker}_0", speaker, split, "happy", 1.0)
        writer.sound(f"{speaker}_0", spoken(2.0, number), RATE_HZ)
        open_ = level * (0.5 - 0.5 * np.cos(6.0 * times))
        values = np.stack([open_, np.full(120, 0.5)], 1)
        writer.weights(f"{speaker}_0", ["jawOpen", "mouthSmileLeft"], values, times)
    return writer.close()


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["landmarks", "vertices", "weights"])
def test_what_a_corpus_shows_is_what_a_model_learns(tmp_path, kind):
    corpus = made_up(tmp_path / "corpus", 2.0, kind)
    again, first = (state(trained(corpus, tmp_path / out)) for out in ("again", "first"))
    assert all(torch.equal(value, again[name]) for name, value in first.items())
    model = load_motion(tmp_path / "first/motion.pt")
    codes = train_motion.Codes(train_motion.head_of(shipped("facetalk_compact")))
    entries = [e for e in arkit.of_folders([corpus], 1) if not e.held_out]
    weights = torch.cat([e.motion for e in entries])
    assert codes.weights(model.mean)[JAW] == pytest.approx(weights[:, JAW].mean().item(), abs=0.1)
    assert weights[:, JAW].std() > 0.1


@pytest.mark.slow
def test_another_corpus_gives_another_model(tmp_path):
    quiet, loud = (
        recorded(tmp_path / name, {"ann": "train"}, level) for name, level in (("quiet", 0.2), ("loud", 0.9))
    )
    models = [load_motion(trained(corpus, tmp_path / f"of_{corpus.name}")) for corpus in (quiet, loud)]
    codes = train_motion.Codes(train_motion.head_of(shipped("facetalk_compact")))
    jaws = [codes.weights(model.mean)[JAW].item() for model in models]
    assert jaws[1] > jaws[0] + 0.2


def test_recorded_weights_are_taken_as_they_are(tmp_path):
    corpus = recorded(tmp_path / "mine", {"ann": "train"})
    entry = arkit.as_weights(bank.of_folders([corpus], 1), folders=[corpus])[0]
    at = torch.arange(len(entry.motion)) / 25.0
    torch.testing.assert_close(entry.motion[:, JAW], 0.5 - 0.5 * torch.cos(6.0 * at), atol=5e-3, rtol=0.0)
    torch.testing.assert_close(entry.motion[:, SMILE], torch.full_like(at, 0.5))
    rest = [i for i in range(len(CHANNELS)) if i not in (JAW, SMILE)]
    assert not entry.motion[:, rest].any() and not entry.weight[:, rest].any()
    assert entry.weight[:, [JAW, SMILE]].all()


@pytest.mark.slow
def test_a_run_that_was_stopped_goes_on_with_the_same_bits(tmp_path):
    corpus = made_up(tmp_path / "corpus", 2.0)
    whole = state(trained(corpus, tmp_path / "whole"))
    trained(corpus, tmp_path / "parts", "--stop-at", "3")
    again = state(trained(corpus, tmp_path / "parts"))
    assert all(torch.equal(value, again[name]) for name, value in whole.items())


@pytest.mark.slow
def test_held_out_clips_of_a_corpus_are_measured(tmp_path, capsys):
    corpus = made_up(tmp_path / "corpus", 2.0)
    motion = trained(corpus, tmp_path / "run")
    evaluate_motion.main(["--corpus", str(corpus), "--motion", str(motion), "--steps", "1"])
    lines = capsys.readouterr().out.splitlines()
    measured = next(line for line in lines if line.startswith("1 steps: "))
    assert "made_up gap r" in measured and "made_up jawOpen r" in measured
    assert any(line.startswith("five seeds: ") for line in lines)


def test_a_corpus_without_held_out_clips_is_told_so(tmp_path):
    corpus = recorded(tmp_path / "mine", {"ann": "train"})
    message = r"--corpus .*mine: expected held-out clips \(split val or test in clips.tsv\), got none"
    with pytest.raises(ValueError, match=message):
        evaluate_motion.main(["--corpus", str(corpus)])


def test_a_corpus_that_is_all_held_out_is_told_so(tmp_path):
    corpus = recorded(tmp_path / "mine", {"ann": "test"})
    with pytest.raises(ValueError, match="expected training clips, got none"):
        trained(corpus, tmp_path / "out")


@pytest.mark.slow
def test_the_recipe_of_the_paper_is_eq_4_alone_at_a_rate_that_stays(tmp_path):
    path = trained(made_up(tmp_path / "corpus", 2.0), tmp_path / "out", "--recipe", "paper")
    said = torch.load(path)["recipe"]
    assert (said["rate"], said["weight_decay"], said["annealed"]) == (1e-4, 0.0, False)
    assert said["plain"] and said["velocity"] == said["acceleration"] == 0.0
    last = torch.load(tmp_path / "out/last.pt", weights_only=False)
    assert last["optimiser"]["param_groups"][0]["lr"] == 1e-4
    heads = (tmp_path / "out/log.csv").read_text().splitlines()[0].split(",")
    assert "simple" in heads and "landmarks" not in heads
