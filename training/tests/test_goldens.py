"""The committed goldens are what the code writes today."""

import importlib
from pathlib import Path

import pytest
import torch
from safetensors.torch import load_file

from training.goldens import GOLDENS

COMMITTED = Path(__file__).resolve().parents[2] / "tests" / "goldens"


@pytest.mark.parametrize("name", ["eight_bits", "log_mel", "ats_compact", "stream", "text_units"])
def test_committed_golden_is_current(name: str, tmp_path: Path):
    path = importlib.import_module(GOLDENS[name]).write(tmp_path, tmp_path)
    fresh, committed = load_file(path), load_file(COMMITTED / path.name)
    assert fresh.keys() == committed.keys()
    for key, value in fresh.items():
        torch.testing.assert_close(value, committed[key], atol=1e-4, rtol=1e-4)
