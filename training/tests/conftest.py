"""What all tests of training share."""

import pytest
import torch

from training import machine

# They test what bfloat16 itself does.
_OF_PRECISION = ("test_machine", "test_facetalk_head_training", "test_stream")


@pytest.fixture(autouse=True)
def fast_products(request, monkeypatch):
    """Products in float32 on processors that would emulate bfloat16: it takes ten times as long."""
    module = request.module.__name__.rpartition(".")[2]
    if module not in _OF_PRECISION and not torch.cpu._is_avx512_bf16_supported():
        monkeypatch.setitem(machine.PRECISIONS, "bfloat16", None)
