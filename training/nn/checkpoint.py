"""Model folders, config.json beside model.safetensors: what training writes and the library reads."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

import torch
from safetensors.torch import load_file, save_file
from torch import Tensor, nn

EXACT = (
    "mean", "std", "vertices", "triangles", "spirals",
    "feature_mean", "feature_scale", "shape_mean", "shape_basis",
)  # fmt: skip
"""What stays f32 in every model: statistics, and numbers of vertices."""
Network = TypeVar("Network", bound=nn.Module)


def write_model(folder: Path, state: dict[str, Tensor], config: dict, exact: tuple[str, ...] = EXACT) -> Path:
    """`model.safetensors` and `config.json` of one model.

    Weights are f16, but for the names in `exact` and those that begin as the ones in it with a point at their
    end; `""` keeps f32 everywhere.
    """
    folder.mkdir(parents=True, exist_ok=True)
    begins = tuple(name for name in exact if name.endswith(".") or not name)
    stored = {name: value if name in exact or name.startswith(begins) else value.half()
              for name, value in state.items()}  # fmt: skip
    file = folder / "model.safetensors"
    save_file({name: value.contiguous() for name, value in stored.items()}, file)
    file.chmod(0o644)
    (folder / "config.json").write_text(json.dumps(config, indent=2) + "\n")
    return folder


def read_model(folder: Path) -> tuple[dict, dict[str, Tensor]]:
    """What `write_model` wrote: configuration, and weights in f32."""
    for name in ("config.json", "model.safetensors"):
        if not (folder / name).is_file():
            raise FileNotFoundError(
                f"{folder}: expected config.json and model.safetensors, {name} is missing"
            )
    state = {name: value.float() for name, value in load_file(folder / "model.safetensors").items()}
    return json.loads((folder / "config.json").read_text()), state


def restored(network: Network, state: dict[str, Tensor]) -> Network:
    """A network with its weights, ready for inference."""
    network.load_state_dict(state)
    return network.eval()


def load_model(folder: Path, make: Callable[[dict], Network]) -> Network:
    """The network of a model folder; `make` builds it from its configuration."""
    config, state = read_model(folder)
    return restored(make(config), state)


def save(path: Path, network: nn.Module, **more: object) -> None:
    """One file of a run: weights, the network's configuration, and `more` beside them."""
    state = {name: value.cpu() for name, value in network.state_dict().items()}
    torch.save({"state": state, "config": network.config.to_json(), **more}, path)
