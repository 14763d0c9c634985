"""Model folders with config.json and weights. Training writes them, the library reads them.

The weights are in model.safetensors. Shipped models have model.planes.gz instead: a safetensors file in gzip
whose large matrices are 8-bit numbers, column after column, with scales. Large arrays of whole numbers are
zigzag codes.
"""

import gzip
import json
import zlib
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
_GZIP = 31
"""Tells zlib to write a gzip header with the largest window."""
EXACT = (
    "mean", "std", "vertices", "triangles", "spirals",
    "feature_mean", "feature_scale", "shape_mean", "shape_basis",
)  # fmt: skip
"""Names of arrays that stay f32 in every model: statistics, and vertex numbers."""
SCALE = ".scale"
"""The scales of an 8-bit matrix are stored under the matrix's name with this ending."""
HALF = ("facetalk_compact.identity.", "head_topology.", "stm_paper.")
"""Arrays whose name MODEL.ARRAY begins with one of these stay f16 in shipped models.

docs/training.md says why.
"""
SMALLEST, SHORTEST_ROW = 2048, 16
"""A matrix ships in eight bits if it has at least this many values, and this many in a row."""
LEVELS = {"text_units.vectors": 15, "text_units.ngrams": 15, "whisper_trunk.": 15}
"""Largest magnitude of the whole numbers in an 8-bit matrix, by the beginning of MODEL.ARRAY. Others have
`ALL_LEVELS`.

Fewer levels take less space in gzip. The vectors of words come from random walks, and their noise is
larger than the rounding: `text_units` recognises as many units with 15 levels as with 127. With 15 levels in
Whisper's layers, r of the mouth changes by less than 0.005 on voices left out of the training.
"""
ALL_LEVELS = 127
Network = TypeVar("Network", bound=nn.Module)


def pack(plain: bytes) -> bytes:
    """Packs the bytes of a safetensors file for shipping: even bytes first, then odd bytes, in gzip.

    The high bytes of f16 weights resemble each other, so side by side they take a third less space. In most
    8-bit weights nothing repeats but single bytes. A stream of these alone (zlib's Z_RLE) is unpacked faster,
    so it is taken if the thorough search saves no more than 1.5 %. `unpack` below and in rust-core undo this.
    """
    planes = plain[0::2] + plain[1::2]
    thorough = zopfli.gzip.compress(planes, numiterations=5, blocksplittingmax=0)
    runs = zlib.compressobj(9, zlib.DEFLATED, _GZIP, 9, zlib.Z_RLE)
    quick = runs.compress(planes) + runs.flush()
    return quick if len(quick) <= 1.015 * len(thorough) else thorough


def unpack(packed: bytes) -> bytes:
    """Undoes `pack`."""
    planes = gzip.decompress(packed)
    plain, middle = bytearray(len(planes)), (len(planes) + 1) // 2
    plain[0::2], plain[1::2] = planes[:middle], planes[middle:]
    return bytes(plain)


def quantised(values: Tensor, levels: int = ALL_LEVELS) -> tuple[Tensor, Tensor]:
    """Matrix or kernel [R, ...] as int8 [..., R], and the scale [R] of each row in bf16.

    The largest magnitude of a row becomes `levels`. The numbers of a column resemble each other and take 2 %
    less space in gzip when they lie side by side, so the axis of rows comes last. `scaled` in
    rust-core/src/models/weights.rs and `in_floats` undo this. Quantising their result gives the same numbers.
    """
    columns = values.float().movedim(0, -1)
    scales = (columns.abs().flatten(0, -2).amax(0) / levels).bfloat16()
    steps = torch.where(scales > 0, scales, torch.ones_like(scales)).float()
    return (columns / steps).round().clamp(-levels, levels).to(torch.int8).contiguous(), scales


def zigzag(values: Tensor) -> Tensor:
    """Codes of whole numbers in uint16: `2n` for `n` from 0 on, `-2n - 1` for a negative `n`.

    Small numbers of either sign have a high byte of 0, which takes no space in gzip. `whole_numbers` in
    rust-core/src/models/weights.rs and `in_floats` undo this.
    """
    whole = values.int()
    return torch.where(whole >= 0, 2 * whole, -2 * whole - 1).to(torch.uint16)


def is_whole(value: Tensor) -> bool:
    """Whether an array is a large f16 array of whole numbers that have a code."""
    is_half = value.dtype == torch.float16 and value.numel() >= SMALLEST
    return is_half and bool((value == value.round()).all()) and bool((value.abs() < 2**15).all())


def is_large(value: Tensor) -> bool:
    """Whether an array is an f16 matrix or kernel large enough for eight bits."""
    is_matrix = value.dtype == torch.float16 and value.ndim > 1
    return is_matrix and value.numel() >= SMALLEST and value[0].numel() >= SHORTEST_ROW


def levels_of(name: str) -> int:
    """Levels of the array MODEL.ARRAY."""
    return next((levels for begin, levels in LEVELS.items() if name.startswith(begin)), ALL_LEVELS)


def as_shipped(stored: dict[str, Tensor], model: str = "") -> dict[str, Tensor]:
    """Packs the large arrays of a file.

    Whole numbers become their codes. Other matrices are quantised and get scales; `HALF` arrays of `model`
    stay f16.
    """
    whole = {name: zigzag(value) for name, value in stored.items() if is_whole(value)}
    large = {
        name: quantised(value, levels_of(f"{model}.{name}"))
        for name, value in stored.items()
        if is_large(value) and name not in whole and not f"{model}.{name}".startswith(HALF)
    }
    numbers = {name: both[0] for name, both in large.items()}
    return stored | whole | numbers | {name + SCALE: both[1] for name, both in large.items()}


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
    stored = as_shipped(stored, folder.name) if is_shipped else stored
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
    """Arrays of a file in f32. Undoes `as_shipped`, except for the rounding."""
    eight_bits = {name for name, value in stored.items() if value.dtype == torch.int8}
    scales = {name + SCALE for name in eight_bits}
    arrays = {name: value.float() for name, value in stored.items() if name not in scales}
    for name in eight_bits:
        arrays[name] = (arrays[name] * stored[name + SCALE].float()).movedim(-1, 0).contiguous()
    for name, value in stored.items():
        if value.dtype == torch.uint16:
            code = value.int()
            arrays[name] = torch.where(code % 2 == 0, code // 2, -(code + 1) // 2).float()
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
