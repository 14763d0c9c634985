"""Model folders: plain where a user writes them, packed where they are shipped."""

import json

import pytest
import torch

from training import WEIGHTS
from training.nn import checkpoint
from training.nn.checkpoint import PACKED, PLAIN, pack, read_arrays, read_model, unpack, write_model


@pytest.mark.parametrize("plain", [b"", b"a", b"abc", bytes(range(256))])
def test_packing_keeps_every_byte(plain):
    assert unpack(pack(plain)) == plain


def test_a_shipped_folder_is_packed_and_reads_like_a_plain_one(tmp_path, monkeypatch):
    state, config = {"mean": torch.tensor([1 / 3]), "layer": torch.rand(5, 3)}, {"width": 3}
    plain = write_model(tmp_path / "mine" / "small", state, config)
    monkeypatch.setattr(checkpoint, "WEIGHTS", tmp_path / "weights")
    shipped = write_model(tmp_path / "weights" / "shared" / "small", state, config)
    assert (plain / PLAIN).is_file() and not (plain / PACKED).exists()
    assert (shipped / PACKED).is_file() and not (shipped / PLAIN).exists()
    for folder in (plain, shipped):
        written, arrays = read_model(folder)
        assert written == config
        assert torch.equal(arrays["mean"], state["mean"])
        assert torch.equal(arrays["layer"], state["layer"].half().float())


def test_every_shipped_model_can_be_read():
    folders = [path.parent for path in WEIGHTS.glob(f"*/*/{PACKED}")]
    assert len(folders) > 10
    for folder in folders:
        json.loads((folder / "config.json").read_text())
        assert all(array.isfinite().all() for array in read_arrays(folder).values())


def test_a_folder_without_weights_is_named(tmp_path):
    (tmp_path / "config.json").write_text("{}")
    with pytest.raises(FileNotFoundError, match=r"expected model\.safetensors or model\.planes\.gz"):
        read_model(tmp_path)
