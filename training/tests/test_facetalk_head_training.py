"""FaceTalk's head is trained: runs that go on bit for bit, poses of corpus folders, networks in bfloat16."""

import os
from pathlib import Path

import pytest
import torch

from training.corpus.heads import IctHeads
from training.systems.facetalk import train as train_head
from training.tests.made_up import made_up

SHARED = Path(os.environ.get("ANYFACE_SHARED", Path(__file__).resolve().parents[3] / "shared"))
needs_faces = pytest.mark.skipif(
    not (SHARED / "data/faces/ict_facekit.safetensors").exists(), reason="ignored: no faces to learn from"
)
pytestmark = [pytest.mark.slow]


@pytest.fixture(scope="module")
def cache(tmp_path_factory) -> Path:
    return tmp_path_factory.mktemp("cache")


@pytest.fixture(autouse=True)
def few_places(monkeypatch):
    """Few places about the heads, so that they are drawn in seconds, and codes that are not fitted."""
    monkeypatch.setattr(train_head, "set_codes", lambda *_: {})
    monkeypatch.setattr(train_head, "set_directions", lambda *_: None)
    monkeypatch.setattr(train_head, "IctHeads", lambda *places: IctHeads(*places, 3000, 800))


def trained(cache: Path, part: str, out: Path, *more: str | Path) -> dict[str, torch.Tensor]:
    """The state of a head of `debug` size after eight steps."""
    line = [
        part,
        "--config",
        "debug",
        "--data",
        SHARED / "data",
        "--cache",
        cache,
        "--out",
        out,
        "--steps",
        8,
    ]
    line += ["--pool", 6, "--heads", 3, "--points", 32, *more]
    path = train_head.train(train_head.parser().parse_args([str(x) for x in line]))
    return torch.load(path)["state"]


def same(a: dict[str, torch.Tensor], b: dict[str, torch.Tensor]) -> bool:
    return all(torch.equal(value, b[name]) for name, value in a.items())


@needs_faces
@pytest.mark.parametrize("part", ["template", "identity", "expression"])
def test_a_run_that_was_stopped_goes_on_with_the_same_bits(cache, tmp_path, part):
    whole = trained(cache, part, tmp_path / "whole")
    trained(cache, part, tmp_path / "parts", "--stop-at", "5")
    assert same(whole, trained(cache, part, tmp_path / "parts"))


@needs_faces
def test_deformations_learn_the_poses_of_a_corpus(cache, tmp_path):
    corpus = made_up(tmp_path / "corpus", 2.0, "weights")
    of_corpus = trained(cache, "expression", tmp_path / "own", "--corpus", corpus)
    assert same(of_corpus, trained(cache, "expression", tmp_path / "again", "--corpus", corpus))
    assert not same(of_corpus, trained(cache, "expression", tmp_path / "ours"))


@needs_faces
def test_networks_in_bfloat16_are_near_those_in_float32(cache, tmp_path):
    exact = trained(cache, "identity", tmp_path / "exact")
    rough = trained(cache, "identity", tmp_path / "rough", "--precision", "bfloat16")
    assert not same(exact, rough)
    assert all((value - rough[name]).abs().max() < 0.02 for name, value in exact.items())


@pytest.mark.parametrize("part", ["template", "identity"])
def test_a_part_that_knows_no_poses_refuses_a_corpus(tmp_path, part):
    message = f"--corpus: expected the part expression, which alone learns from recordings, got {part}"
    line = [part, "--corpus", str(tmp_path), "--out", str(tmp_path / "out")]
    with pytest.raises(ValueError, match=message):
        train_head.train(train_head.parser().parse_args(line))
