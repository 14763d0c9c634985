"""Model folders: plain where a user writes them, packed where they are shipped."""

import json

import pytest
import torch
from safetensors.torch import load

from training import WEIGHTS
from training.nn import checkpoint
from training.nn.checkpoint import (
    HALF,
    PACKED,
    PLAIN,
    as_shipped,
    in_floats,
    pack,
    quantised,
    read_arrays,
    read_bytes,
    read_model,
    unpack,
    write_model,
)


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


def test_a_shipped_matrix_is_in_eight_bits_unless_its_model_cannot_bear_it(tmp_path, monkeypatch):
    monkeypatch.setattr(checkpoint, "WEIGHTS", tmp_path)
    state = {"mean": torch.rand(64, 64), "matrix": torch.randn(64, 64), "table": torch.randn(1024, 4)}
    for name, dtype in (("small", torch.int8), (HALF[0].rstrip("."), torch.float16)):
        folder = write_model(tmp_path / "shared" / name, state, {})
        stored, arrays = load(read_bytes(folder)), read_arrays(folder)
        assert arrays.keys() == state.keys()
        assert stored["matrix"].dtype == dtype
        assert stored["table"].dtype == torch.float16, "rows of four numbers are too short for a scale"
        assert torch.equal(arrays["mean"], state["mean"])


def test_eight_bits_are_within_half_a_step_and_stay_what_they_are():
    matrix = (torch.randn(96, 40, 3) * torch.logspace(-5, 2, 96)[:, None, None]).half()
    matrix[5] = 0
    eight, scales = quantised(matrix)
    assert eight.shape == (40, 3, 96) and (eight[:, :, 5] == 0).all()
    assert (eight.flatten(0, 1).abs().amax(0) == 127).sum() == 95
    stored = as_shipped({"matrix": matrix})
    again = in_floats(stored)["matrix"]
    allowed = 0.51 * matrix.float().flatten(1).abs().amax(1) / 127
    assert ((again - matrix.float()).flatten(1).abs().amax(1) <= allowed).all()
    back, same = quantised(again)
    assert torch.equal(back, eight) and torch.equal(same, scales)


def test_vectors_of_words_have_fewer_levels():
    matrix = torch.randn(64, 64).half()
    name, levels = next(iter(checkpoint.LEVELS.items()))
    model, array = name.split(".")
    for folder, largest in ((model, levels), ("another", 127)):
        stored = as_shipped({array: matrix}, folder)
        assert stored[array].abs().max() == largest
        off = (in_floats(stored)[array] - matrix.float()).abs().amax(1)
        assert (off <= 0.51 * matrix.float().abs().amax(1) / largest).all()


@pytest.mark.parametrize("largest", [1, 40, 2048, 32752])
def test_whole_numbers_keep_every_bit(largest):
    whole = (torch.rand(64, 40) * 2 * largest - largest).half().round()
    whole[0, 0], whole[0, 1], whole[0, 2] = largest, -largest, 0
    stored = as_shipped({"whole": whole}, "another")
    assert stored.keys() == {"whole"} and stored["whole"].dtype == torch.uint16
    assert torch.equal(in_floats(stored)["whole"], whole.float())


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
