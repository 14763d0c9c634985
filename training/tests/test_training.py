"""Everything trains from a made-up corpus folder, exports, and goes on after an interruption."""

import csv
import json
from pathlib import Path

import numpy as np
import pytest
import torch
from safetensors.torch import load_file

from training.corpus.sequence_meshes import sequence_meshes
from training.deform.static_weights import CONFIGS as STATIC
from training.export import export, main
from training.systems.freetalk.ats import CONFIGS, AtsConfig, AtsDenoiser
from training.systems.freetalk.stm import train as train_stm
from training.systems.freetalk.stm.local_start import effective_landmarks, group_shares, locality
from training.systems.freetalk.stm.paper import CONFIGS as PAPER
from training.systems.freetalk.stm.paper import PaperDecoder
from training.systems.freetalk.stm.train_paper import paper_mesh, prepare_weights
from training.systems.freetalk.train import parser, train
from training.tests.killed import killed
from training.tests.made_up import made_up
from training.tests.test_speech import written


@pytest.fixture(scope="module")
def corpus(tmp_path_factory) -> Path:
    """Six clips of 4 s."""
    return made_up(tmp_path_factory.mktemp("corpus") / "made_up", 4.0)


def run(corpus: Path, out: Path, *more: str) -> Path:
    """Trains ATS for 20 steps."""
    flags = ["--corpus", str(corpus), "--out", str(out), "--steps", "20", "--tokens", "128"]
    return train(parser().parse_args([*flags, "--validation-clips", "0", *more]))


def exported(trained: Path, models: Path, name: str) -> AtsConfig:
    """Writes the model folder, loads it again and returns its config."""
    export("ats", models, run=trained)
    config = AtsConfig.from_json(json.loads((models / f"ats_{name}/config.json").read_text()))
    model = AtsDenoiser(config)
    state = load_file(models / f"ats_{name}/model.safetensors")
    model.load_state_dict({key: value.float() for key, value in state.items()})
    assert all(torch.isfinite(value).all() for value in model.state_dict().values())
    return config


@pytest.mark.slow
@pytest.mark.parametrize("name", list(CONFIGS))
def test_every_ats_trains_and_exports(corpus, tmp_path, name):
    written("hubert_tiny", tmp_path / "hubert")
    more = ["--hubert", str(tmp_path / "hubert")] if name == "paper" else []
    config = exported(run(corpus, tmp_path / "run", "--config", name, *more), tmp_path / "models", name)
    assert config.styles == ["made_up", "any"] and config.emotion == "learned"
    expected = {"debug": ("ear", 192), "compact": ("ear", 192), "paper": ("hubert", 32)}
    assert (config.speech.encoder, config.speech.channels) == expected[name]


@pytest.mark.slow
def test_a_resumed_run_gives_the_same_bits(corpus, tmp_path):
    whole = torch.load(run(corpus, tmp_path / "whole", "--config", "debug"))
    run(corpus, tmp_path / "parts", "--config", "debug", "--stop-at", "7")
    parts = torch.load(run(corpus, tmp_path / "parts", "--config", "debug"))
    assert all(torch.equal(value, parts["state"][key]) for key, value in whole["state"].items())
    other = torch.load(run(corpus, tmp_path / "other", "--config", "debug", "--seed", "1"))
    assert not torch.equal(other["state"]["head.weight"], whole["state"]["head.weight"])


@pytest.mark.slow
def test_scores_of_held_out_clips_stand_in_the_log(corpus, tmp_path):
    run(corpus, tmp_path, "--config", "debug", "--log-every", "10", "--validation-clips", "1")
    with open(tmp_path / "log.csv", newline="") as file:
        rows = list(csv.DictReader(file))
    assert [row["step"] for row in rows] == ["10", "20"]
    assert -1.0 <= float(rows[1]["made_up any gap r"]) <= 1.0


def test_a_checkpoint_of_something_else_is_refused(corpus, tmp_path):
    torch.save({"model": {}}, tmp_path / "last.pt")
    with pytest.raises(ValueError, match="expected model, optimiser, schedule, average, random, got model"):
        run(corpus, tmp_path, "--config", "debug")


def test_two_folders_of_one_name_are_refused(corpus, tmp_path):
    with pytest.raises(ValueError, match="expected folders of different names, got made_up, made_up"):
        run(corpus, tmp_path, "--config", "debug", "--corpus", str(corpus), str(corpus))


@pytest.fixture(scope="module")
def sequences(tmp_path_factory) -> Path:
    """Six clips of 2 s on a mesh."""
    return made_up(tmp_path_factory.mktemp("corpus") / "made_up", 2.0, "vertices")


def train_decoder(sequences: Path, runs: Path, model: str, config: str, steps: int) -> dict:
    """The state that a decoder has after training."""
    flags = [model, "--corpus", str(sequences), "--config", config, "--steps", str(steps)]
    train_stm.main([*flags, "--runs", str(runs), "--shapes", "80"])
    return torch.load(runs / f"{model}_corpus.pt")


DECODERS = [("static", name) for name in STATIC] + [("paper", name) for name in PAPER]


@pytest.mark.slow
@pytest.mark.parametrize("model,config", DECODERS)
def test_every_decoder_trains_on_sequences_and_exports(sequences, tmp_path, model, config, capsys):
    saved = train_decoder(sequences, tmp_path, model, config, 20)
    out = capsys.readouterr().out
    assert "held out, training-free:" in out and f"held out, {model}:" in out
    main(["stm", "--runs", str(tmp_path), "--models", str(tmp_path / "models"), "--trained", "corpus"])
    folder = tmp_path / "models" / {"static": "static_weights", "paper": "stm_paper"}[model]
    assert json.loads((folder / "config.json").read_text()) == saved["config"]
    stored = load_file(folder / "model.safetensors")
    assert stored.keys() == saved["state"].keys()
    assert all(torch.isfinite(value).all() for value in stored.values())


@pytest.mark.slow
@pytest.mark.parametrize("model", ["static", "paper"])
def test_a_decoder_killed_in_training_goes_on_with_the_same_bits(sequences, tmp_path, model, monkeypatch):
    whole = train_decoder(sequences, tmp_path / "whole", model, "debug", 6)
    with killed(monkeypatch, 3, 4):
        train_decoder(sequences, tmp_path / "parts", model, "debug", 6)
    again = train_decoder(sequences, tmp_path / "parts", model, "debug", 6)
    assert all(torch.equal(value, again["state"][key]) for key, value in whole["state"].items())


def test_attention_of_the_papers_decoder_starts_near_each_vertex(sequences):
    mesh = paper_mesh(sequence_meshes([sequences], held_out=True)[0], PAPER["compact"])
    torch.manual_seed(0)
    model = PaperDecoder(PAPER["compact"])
    attended = lambda: effective_landmarks(model, mesh.inputs, mesh.operators, torch.zeros(1, 68, 3))  # noqa: E731
    assert attended().median() > 60
    prepare_weights(model, [mesh])
    assert attended().median() < 20


def test_attention_that_left_its_vertices_is_led_back(sequences):
    mesh = paper_mesh(sequence_meshes([sequences], held_out=True)[0], PAPER["compact"])
    torch.manual_seed(0)
    model, still = PaperDecoder(PAPER["compact"]), torch.zeros(1, 68, 3)
    geometry = mesh.mesh.geometry

    def to_lips() -> float:
        shares = group_shares(model, mesh.inputs, mesh.operators, still)
        torch.testing.assert_close(sum(shares.values()), torch.ones(len(mesh.inputs)))
        return float(shares["lips"][mesh.mesh.lips].mean())

    def away() -> torch.Tensor:
        features = model.encode(mesh.inputs, mesh.operators)
        return locality(model, features, geometry.positions, still, geometry.landmarks)

    assert to_lips() < 0.35
    far = float(away().detach())
    prepare_weights(model, [mesh])
    near = float(away().detach())
    assert to_lips() > 0.6 and near < 0.65 * far
    with torch.no_grad():
        model.attention.query.weight.mul_(0.2)
    assert away() > 1.5 * near
    optimiser = torch.optim.Adam(model.attention.query.parameters(), 1e-2)
    for _ in range(60):
        optimiser.zero_grad()
        away().backward()
        optimiser.step()
    # The Gaussians themselves give the made-up face's lips a share of 0.54.
    assert away() < 0.6 * near and to_lips() > 0.5


def test_displacements_of_a_sequence_are_those_of_the_file(sequences):
    mesh = sequence_meshes([sequences], held_out=True)[0]
    values, neutral = np.load(sequences / "vertices/cem_0.npy"), mesh.neutral
    lengths = mesh.displacements(0, np.arange(10)).norm(dim=-1).numpy()
    true = np.linalg.norm(values[:10] - neutral, axis=-1)
    np.testing.assert_allclose(lengths / np.linalg.norm(mesh.turn, 2), true, atol=1e-4)
