"""Golden of the head of quads: the shipped model under random numbers."""

import json
from pathlib import Path

import torch

from training import shipped
from training.goldens import write_golden
from training.head.topology import shape
from training.nn.checkpoint import read_arrays

EVERY = 23
"""The golden keeps one vertex in this many."""


def write(out: Path, shared: Path) -> Path:
    """Writes `numbers` [100 + T] and the `places` [V / 23, 3] of every 23rd vertex. `shared` is not used."""
    torch.manual_seed(7)
    folder = shipped("head_topology")
    config = json.loads((folder / "config.json").read_text())
    state = {name: value.double().numpy() for name, value in read_arrays(folder).items()}
    numbers = torch.randn(100 + len(config["traits"]))
    places = shape(state, config, numbers[:100].double().numpy(), numbers[100:].double().numpy())
    tensors = {"numbers": numbers, "places": torch.from_numpy(places[::EVERY]).float()}
    return write_golden(out / "head_topology.safetensors", tensors, "head_topology")
