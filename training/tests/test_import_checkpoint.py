"""Checkpoints of others become weights of our networks, or it is said what does not fit."""

import pytest
import torch
from safetensors.torch import save_file
from torch import nn

from training.export import main as export
from training.import_checkpoint import SYSTEMS, fitted, main, of_faceformer, read_state, renamed, table
from training.nn.diffusion_net import DiffusionNet
from training.systems.emoface.model import Branch, EmoFaceConfig
from training.systems.freetalk.stm.paper import CONFIGS, PaperDecoder
from training.tests.test_parity import needs_shared, read


def altered(network: nn.Module) -> dict[str, torch.Tensor]:
    """The weights of a network as another run would have them."""
    torch.manual_seed(7)
    return {name: value + 0.1 * torch.randn_like(value) for name, value in network.state_dict().items()}


@pytest.mark.parametrize("ending", ["pth", "safetensors"])
@pytest.mark.parametrize("system", [name for name in SYSTEMS if name != "emoface-branches"])
def test_a_checkpoint_in_wrappers_becomes_a_run(tmp_path, system, ending):
    network = SYSTEMS[system]("debug")
    state = altered(network)
    others = {f"module.denoiser.{name}": value for name, value in state.items()}
    path, out = tmp_path / f"theirs.{ending}", tmp_path / "run.pt"
    if ending == "pth":
        torch.save({"epoch": 3, "state_dict": others, "optimizer": {"lr": 1.0}}, path)
    else:
        save_file(others, path)
    assert main([system, str(path), "--out", str(out), "--config", "debug"]) == 0
    saved = torch.load(out)
    assert saved["config"] == network.config.to_json()
    assert all(torch.equal(value, saved["state"][name]) for name, value in state.items())


def test_a_decoder_that_was_imported_is_exported(tmp_path):
    state = altered(PaperDecoder(CONFIGS["debug"]))
    torch.save(state, tmp_path / "theirs.pt")
    line = ["freetalk-stm", tmp_path / "theirs.pt", "--out", tmp_path / "paper_both.pt", "--config", "debug"]
    assert main(list(map(str, line))) == 0
    export(["stm", "--runs", str(tmp_path), "--models", str(tmp_path / "models")])
    stored = read_state(tmp_path / "models/stm_paper/model.safetensors")
    for name, value in state.items():
        torch.testing.assert_close(stored[name].float(), value, atol=2e-3, rtol=2e-3)


def test_what_does_not_fit_is_said_with_shapes_and_the_next_step(tmp_path, capsys):
    state = altered(PaperDecoder(CONFIGS["debug"]))
    state["attention.query.weight"] = torch.zeros(3, 8)
    state["attention.q_proj.bias"] = state.pop("attention.query.bias")
    torch.save({"model": state}, tmp_path / "theirs.pt")
    line = ["freetalk-stm", str(tmp_path / "theirs.pt"), "--out", str(tmp_path / "x.pt"), "--config", "debug"]
    with pytest.raises(SystemExit):
        main(line)
    message = capsys.readouterr().err
    assert "attention.query.weight: expected [8, 8], got [3, 8]" in message
    assert "attention.query.bias: expected [8], got none" in message
    assert "of no use here: attention.q_proj.bias" in message and "--table" in message
    assert not (tmp_path / "x.pt").exists()
    torch.save({"epoch": 1}, tmp_path / "theirs.pt")
    with pytest.raises(ValueError, match="expected the arrays of a network"):
        read_state(tmp_path / "theirs.pt")
    torch.save(nn.Linear(2, 2), tmp_path / "theirs.pt")
    with pytest.raises(ValueError, match="expected numbers alone"):
        read_state(tmp_path / "theirs.pt")


def test_the_table_lists_every_array(capsys):
    for system in SYSTEMS:
        assert main([system, "--table", "--config", "debug"]) == 0
        assert len(capsys.readouterr().out.splitlines()) == len(SYSTEMS[system]("debug").state_dict())
    assert "first_lin.weight  [8, 6]" in table(PaperDecoder(CONFIGS["debug"])).replace("mesh_encoder.", "")


@needs_shared
@pytest.mark.parametrize("name", ["diffusion_net", "diffusion_net_random"])
def test_weights_of_the_authors_diffusion_net_fit(tmp_path, name):
    tensors, _ = read(name)
    theirs = {k.removeprefix("weights."): v for k, v in tensors.items() if k.startswith("weights.")}
    width, inputs = theirs["first_lin.weight"].shape
    blocks = sum(key.endswith("diffusion_time") for key in theirs)
    network = DiffusionNet(inputs, len(theirs["last_lin.weight"]), width, blocks)
    network = fitted(tmp_path, theirs, network)
    assert theirs.keys() == network.state_dict().keys()


class FaceFormer(nn.Module):
    """FaceFormer's decoder as its public code builds it, from PyTorch's own layers, but with GELU."""

    def __init__(self, width: int, size: int):
        super().__init__()
        self.vertice_map, self.vertice_map_r = nn.Linear(size, width), nn.Linear(width, size)
        layer = nn.TransformerDecoderLayer(width, 4, 2 * width, activation="gelu", batch_first=True)
        self.transformer_decoder = nn.TransformerDecoder(layer, num_layers=1)

    def forward(self, before, heard, positions, bias):
        """Motion before each frame [1, T, D] and sound [1, T, d] → motion [1, T, D]."""
        x = self.vertice_map(before) + positions
        alone = ~torch.eye(x.shape[1], dtype=torch.bool)
        x = self.transformer_decoder(x, heard, tgt_mask=bias, memory_mask=alone)
        return self.vertice_map_r(x)


@torch.no_grad()
def test_a_branch_with_the_weights_of_faceformers_decoder_does_what_that_does(tmp_path):
    torch.manual_seed(0)
    config = EmoFaceConfig(vertices=5, width=32, channels=32)
    theirs, ours = FaceFormer(32, 15).eval(), Branch(config)
    state = {name: value + 0.05 * torch.randn_like(value) for name, value in theirs.state_dict().items()}
    theirs.load_state_dict(state)
    ours = fitted(tmp_path, renamed(state, "emoface-branches"), ours)
    frames, period = 60, config.period
    behind = torch.arange(frames)[:, None] - torch.arange(frames)
    slopes = torch.tensor([2.0**-2, 2.0**-4, 2.0**-6, 2.0**-8])
    bias = -slopes[:, None, None] * (behind // period)
    bias = bias.masked_fill(behind < 0, -torch.inf)
    at = (torch.arange(frames) % period)[:, None] * 10000.0 ** (-torch.arange(0, 32, 2) / 32)
    positions = torch.stack([at.sin(), at.cos()], dim=-1).flatten(1)
    metres, heard = 1e-2 * torch.randn(1, frames, 15), torch.randn(1, frames, 32)
    expected = theirs(metres, heard, positions, bias)
    moved = config.scale_m * ours(metres / config.scale_m, heard, torch.zeros(1, 1, 32))
    torch.testing.assert_close(moved, expected, atol=1e-5, rtol=1e-5)
    assert of_faceformer({}, config.scale_m) == {}
