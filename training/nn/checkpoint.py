"""Model folders, config.json beside weights: what training writes and the library reads.

The weights are model.safetensors, or for shipped models model.planes.gz, which holds the same bytes.
"""

import gzip
import json
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

import torch
from safetensors.torch import load
from safetensors.torch import save as to_bytes
from torch import Tensor, nn

from training import WEIGHTS

PLAIN, PACKED = "model.safetensors", "model.planes.gz"
EXACT = (
    "mean", "std", "vertices", "triangles", "spirals",
    "feature_mean", "feature_scale", "shape_mean", "shape_basis",
)  # fmt: skip
"""What stays f32 in every model: statistics, and numbers of vertices."""
Network = TypeVar("Network", bound=nn.Module)


def pack(plain: bytes) -> bytes:
    """The bytes of a safetensors file for shipping: those at even places, then those at odd ones, in gzip.

    The high bytes of weights in f16 are much alike: beside each other they take a third less. `unpack` in
    rust-core is the way back, too.
    """
    return gzip.compress(plain[0::2] + plain[1::2], 9, mtime=0)


def unpack(packed: bytes) -> bytes:
    """The bytes that `pack` was called with."""
    planes = gzip.decompress(packed)
    plain, middle = bytearray(len(planes)), (len(planes) + 1) // 2
    plain[0::2], plain[1::2] = planes[:middle], planes[middle:]
    return bytes(plain)


def write_model(folder: Path, state: dict[str, Tensor], config: dict, exact: tuple[str, ...] = EXACT) -> Path:
    """Weights and `config.json` of one model; the weights are packed in a folder below `WEIGHTS`.

    Weights are f16, but for the names in `exact` and those that begin as the ones in it with a point at their
    end; `""` keeps f32 everywhere.
    """
    folder.mkdir(parents=True, exist_ok=True)
    begins = tuple(name for name in exact if name.endswith(".") or not name)
    stored = {name: value if name in exact or name.startswith(begins) else value.half()
              for name, value in state.items()}  # fmt: skip
    plain = to_bytes({name: value.contiguous() for name, value in stored.items()})
    if WEIGHTS in folder.resolve().parents:
        (folder / PACKED).write_bytes(pack(plain))
    else:
        (folder / PLAIN).write_bytes(plain)
    (folder / "config.json").write_text(json.dumps(config, indent=2) + "\n")
    return folder


def read_bytes(folder: Path) -> bytes:
    """The bytes of a folder's model.safetensors, packed or not."""
    if (folder / PLAIN).is_file():
        return (folder / PLAIN).read_bytes()
    if (folder / PACKED).is_file():
        return unpack((folder / PACKED).read_bytes())
    raise FileNotFoundError(f"{folder}: expected {PLAIN} or {PACKED}, got neither")


def read_arrays(folder: Path) -> dict[str, Tensor]:
    """Weights of a model folder in f32, by name."""
    return {name: value.float() for name, value in load(read_bytes(folder)).items()}


def read_model(folder: Path) -> tuple[dict, dict[str, Tensor]]:
    """What `write_model` wrote: configuration, and weights in f32."""
    if not (folder / "config.json").is_file():
        raise FileNotFoundError(f"{folder}: expected config.json, it is missing")
    return json.loads((folder / "config.json").read_text()), read_arrays(folder)


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
