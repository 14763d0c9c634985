"""Model folders with config.json and weights. Training writes them, the library reads them.

The weights are in model.safetensors. Shipped models have model.planes.gz instead: a safetensors file in gzip
whose large matrices are 8-bit numbers, column after column, with scales.
"""

import gzip
import json
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

import torch
import zopfli.gzip
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
SCALE = ".scale"
"""Ending of the name under which the scales of an 8-bit matrix are stored."""
HALF = ("compact_speech.", "facetalk_compact.identity.", "head_topology.", "stm_paper.")
"""Prefixes of MODEL.ARRAY that stay f16 in shipped models; docs/training.md says why."""
SMALLEST, SHORTEST_ROW = 2048, 16
"""From this size of a matrix, and of its row, on it ships in eight bits."""
Network = TypeVar("Network", bound=nn.Module)


def pack(plain: bytes) -> bytes:
    """Packs the bytes of a safetensors file for shipping: even bytes first, then odd bytes, in gzip.

    The high bytes of f16 weights resemble each other, so side by side they take a third less space. `unpack`
    below and in rust-core undo this.
    """
    return zopfli.gzip.compress(plain[0::2] + plain[1::2], numiterations=5, blocksplittingmax=0)


def unpack(packed: bytes) -> bytes:
    """Undoes `pack`."""
    planes = gzip.decompress(packed)
    plain, middle = bytearray(len(planes)), (len(planes) + 1) // 2
    plain[0::2], plain[1::2] = planes[:middle], planes[middle:]
    return bytes(plain)


def quantised(values: Tensor) -> tuple[Tensor, Tensor]:
    """Matrix or kernel [R, ...] as int8 [..., R], and the scale [R] of each row in bf16.

    The largest magnitude of a row becomes 127. The numbers of a column resemble each other and take 2 % less
    space in gzip when they lie side by side, so the axis of rows comes last. `scaled` in
    rust-core/src/models/weights.rs and `in_floats` undo this. Quantising their result gives the same numbers.
    """
    columns = values.float().movedim(0, -1)
    scales = (columns.abs().flatten(0, -2).amax(0) / 127).bfloat16()
    steps = torch.where(scales > 0, scales, torch.ones_like(scales)).float()
    return (columns / steps).round().clamp(-127, 127).to(torch.int8).contiguous(), scales


def is_large(value: Tensor) -> bool:
    """Whether an array is an f16 matrix or kernel large enough for eight bits."""
    is_matrix = value.dtype == torch.float16 and value.ndim > 1
    return is_matrix and value.numel() >= SMALLEST and value[0].numel() >= SHORTEST_ROW


def in_eight_bits(stored: dict[str, Tensor], model: str = "") -> dict[str, Tensor]:
    """Quantises the large arrays of a file and adds their scales; `HALF` arrays of `model` stay f16."""
    large = {
        name: quantised(value)
        for name, value in stored.items()
        if is_large(value) and not f"{model}.{name}".startswith(HALF)
    }
    numbers = {name: both[0] for name, both in large.items()}
    return stored | numbers | {name + SCALE: both[1] for name, both in large.items()}


def write_model(folder: Path, state: dict[str, Tensor], config: dict, exact: tuple[str, ...] = EXACT) -> Path:
    """Writes weights and `config.json` of a model; below `WEIGHTS` packed, with large matrices in eight bits.

    Other weights are stored as f16. Those named in `exact` stay f32. A name in `exact` that ends with a point
    is a prefix; `""` keeps f32 everywhere.
    """
    folder.mkdir(parents=True, exist_ok=True)
    begins = tuple(name for name in exact if name.endswith(".") or not name)
    stored = {name: value if name in exact or name.startswith(begins) else value.half()
              for name, value in state.items()}  # fmt: skip
    is_shipped = WEIGHTS in folder.resolve().parents
    stored = in_eight_bits(stored, folder.name) if is_shipped else stored
    plain = to_bytes({name: value.contiguous() for name, value in stored.items()})
    (folder / (PACKED if is_shipped else PLAIN)).write_bytes(pack(plain) if is_shipped else plain)
    (folder / "config.json").write_text(json.dumps(config, indent=2) + "\n")
    return folder


def read_bytes(folder: Path) -> bytes:
    """The bytes of a folder's model.safetensors, unpacked if they are packed."""
    if (folder / PLAIN).is_file():
        return (folder / PLAIN).read_bytes()
    if (folder / PACKED).is_file():
        return unpack((folder / PACKED).read_bytes())
    raise FileNotFoundError(f"{folder}: expected {PLAIN} or {PACKED}, got neither")


def in_floats(stored: dict[str, Tensor]) -> dict[str, Tensor]:
    """Arrays of a file in f32; 8-bit ones are multiplied by their scales and have rows first again."""
    eight_bits = {name for name, value in stored.items() if value.dtype == torch.int8}
    scales = {name + SCALE for name in eight_bits}
    arrays = {name: value.float() for name, value in stored.items() if name not in scales}
    for name in eight_bits:
        arrays[name] = (arrays[name] * stored[name + SCALE].float()).movedim(-1, 0).contiguous()
    return arrays


def read_arrays(folder: Path) -> dict[str, Tensor]:
    """Weights of a model folder in f32, by name."""
    return in_floats(load(read_bytes(folder)))


def read_model(folder: Path) -> tuple[dict, dict[str, Tensor]]:
    """Configuration and f32 weights of a folder that `write_model` wrote."""
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
    """Writes one file of a run: weights, the network's configuration and `more`."""
    state = {name: value.cpu() for name, value in network.state_dict().items()}
    torch.save({"state": state, "config": network.config.to_json(), **more}, path)
