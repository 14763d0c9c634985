"""Turns a checkpoint that others trained into a run of ours, or says what does not fit.

    python -m training.import_checkpoint SYSTEM CHECKPOINT --out RUN [--config paper]
    python -m training.import_checkpoint SYSTEM --table

SYSTEM is one of `SYSTEMS`. `--table` prints every array that is expected, with its shape. A checkpoint is a
file of PyTorch (numbers alone) or safetensors. Wrappers such as `state_dict` and the prefix `module.` are
taken off, `RENAMES` are applied, and every array has to be there with its shape. No authors' checkpoint of
the four papers is public, so the names are ours, which are those of the parts that the papers build on: the
authors' DiffusionNet and PyTorch's transformer layers. `training.export` then writes the model folder.
`emoface-branches` takes FaceFormer's decoder, for `training.systems.emoface.train --branches`.
"""

import argparse
import pickle
import re
from collections.abc import Callable
from pathlib import Path

import torch
from safetensors.torch import load_file
from torch import Tensor, nn

from training.nn.checkpoint import save
from training.systems.cafe_talk.denoiser import CONFIGS as CAFE_TALK
from training.systems.cafe_talk.denoiser import Denoiser as CafeTalkDenoiser
from training.systems.emoface.model import CONFIGS as EMOFACE
from training.systems.emoface.model import Branch, EmoFaceConfig
from training.systems.facetalk.motion import Denoiser as FaceTalkDenoiser
from training.systems.facetalk.train_motion import CONFIGS as FACETALK
from training.systems.freetalk.ats import CONFIGS as ATS
from training.systems.freetalk.ats import AtsDenoiser
from training.systems.freetalk.stm.paper import CONFIGS as STM
from training.systems.freetalk.stm.paper import PaperDecoder

State = dict[str, Tensor]
WRAPPERS = ("state_dict", "model_state_dict", "model", "state", "ema", "net", "params")
"""Keys under which training code keeps the weights of a network."""
PREFIXES = ("module.", "_orig_mod.", "model.", "denoiser.")
"""Beginnings that wrappers of modules put before every name."""
MOST = 6
"""Number of arrays that an error lists."""
SYSTEMS: dict[str, Callable[[str], nn.Module]] = {
    "freetalk-ats": lambda config: AtsDenoiser(ATS[config]()),
    "freetalk-stm": lambda config: PaperDecoder(STM[config]),
    "cafe-talk": lambda config: CafeTalkDenoiser(CAFE_TALK[config]()),
    "facetalk-motion": lambda config: FaceTalkDenoiser(FACETALK[config]()),
    "emoface-branches": lambda config: Branch(EMOFACE[config]()),
}
RENAMES: dict[str, list[tuple[str, str]]] = {
    "emoface-branches": [
        (r"^vertice_map\.", "motion_in."),
        (r"^vertice_map_r\.", "motion_out."),
        (r"^transformer_decoder\.layers\.0\.", ""),
    ],
}
"""Patterns of others' names and what they become here. FaceFormer's are those of its public code."""


def read_state(path: Path) -> State:
    """Arrays of a checkpoint without wrappers and without a prefix that all names share.

    Raises ValueError if the file holds no arrays.
    """
    if path.suffix == ".safetensors":
        state = load_file(path)
    else:
        try:
            state = torch.load(path, map_location="cpu", weights_only=True)
        except pickle.UnpicklingError as error:
            raise ValueError(
                f"{path}: expected numbers alone, got an object that would run code; save its state_dict() "
                "where it was trained"
            ) from error
        state = state if isinstance(state, dict) else {}
        while (wrapper := next((k for k in WRAPPERS if isinstance(state.get(k), dict)), None)) is not None:
            state = state[wrapper]
    state = {name: value for name, value in state.items() if isinstance(value, Tensor)}
    if not state:
        raise ValueError(
            f"{path}: expected the arrays of a network, possibly under {', '.join(WRAPPERS)}, got none"
        )
    while (prefix := next((p for p in PREFIXES if all(k.startswith(p) for k in state)), None)) is not None:
        state = {name.removeprefix(prefix): value for name, value in state.items()}
    return state


def renamed(state: State, system: str) -> State:
    """The arrays under the names of this project. FaceFormer's decoder also becomes a `Branch`."""
    out = {}
    for name, value in state.items():
        for pattern, replacement in RENAMES.get(system, []):
            name = re.sub(pattern, replacement, name)
        out[name] = value
    return of_faceformer(out, EmoFaceConfig.scale_m) if system == "emoface-branches" else out


def of_faceformer(state: State, scale_m: float) -> State:
    """Joins FaceFormer's cross-attention into one linear layer, and scales motion from metres to `scale_m`.

    Its alignment mask lets a frame attend to the sound of that frame alone. Then the share is 1, queries and
    keys have no effect, and values and output projection are one map.
    """
    state = dict(state)
    parts = [state.get(f"multihead_attn.{name}") for name in ("in_proj_weight", "in_proj_bias")]
    parts += [state.get(f"multihead_attn.out_proj.{name}") for name in ("weight", "bias")]
    if all(part is not None for part in parts):
        joint, bias, out, shift = parts
        values = slice(2 * len(out), None)
        state["own_frame.weight"], state["own_frame.bias"] = out @ joint[values], out @ bias[values] + shift
    scales = {
        "motion_in.weight": scale_m,
        "motion_out.weight": 1.0 / scale_m,
        "motion_out.bias": 1.0 / scale_m,
    }
    return state | {name: scale * state[name] for name, scale in scales.items() if name in state}


def fitted(path: Path, state: State, network: nn.Module) -> nn.Module:
    """The network with these weights. Arrays that it does not have are left out.

    Raises ValueError if one of its own is missing or has another shape, with what was expected and found.
    """
    expected = network.state_dict()
    wrong = [
        f"{name}: expected {list(value.shape)}, got {list(state[name].shape) if name in state else 'none'}"
        for name, value in expected.items()
        if name not in state or state[name].shape != value.shape
    ]
    if wrong:
        beside = sorted(state.keys() - expected.keys())
        raise ValueError(
            f"{path}: {len(wrong)} of {len(expected)} arrays do not fit\n  "
            + "\n  ".join([*wrong[:MOST], *(["…"] if len(wrong) > MOST else [])])
            + f"\nin the file and of no use here: {', '.join(beside[:MOST]) or 'none'}"
            + "\nnext: --config for another size, or a line in RENAMES for other names (--table lists ours)"
        )
    network.load_state_dict({name: state[name] for name in expected})
    return network.eval()


def table(network: nn.Module) -> str:
    """The arrays of a network with their shapes, one a line."""
    return "\n".join(f"{name}  {list(value.shape)}" for name, value in network.state_dict().items())


def import_checkpoint(system: str, path: Path, out: Path, config: str = "paper") -> nn.Module:
    """Reads a checkpoint and writes a file as the system's trainer does. Returns the network."""
    network = fitted(path, renamed(read_state(path), system), SYSTEMS[system](config))
    if isinstance(network, Branch):
        torch.save({"state": network.state_dict()}, out)
    else:
        save(out, network)
    return network


def main(line: list[str] | None = None) -> int:
    """Entry of the command."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("system", choices=list(SYSTEMS))
    parser.add_argument("checkpoint", type=Path, nargs="?", help=".pt, .pth, .ckpt or .safetensors")
    parser.add_argument("--out", type=Path, help="file of the run")
    parser.add_argument("--config", default="paper", choices=["paper", "compact", "debug"], help="size")
    parser.add_argument("--table", action="store_true", help="print the expected arrays instead")
    arguments = parser.parse_args(line)
    if arguments.table:
        print(table(SYSTEMS[arguments.system](arguments.config)))
        return 0
    if arguments.checkpoint is None or arguments.out is None:
        parser.error("expected CHECKPOINT and --out FILE, or --table")
    try:
        network = import_checkpoint(arguments.system, arguments.checkpoint, arguments.out, arguments.config)
    except ValueError as error:
        parser.exit(1, f"{error}\n")
    print(f"{arguments.out}: {sum(p.numel() for p in network.parameters()):,} parameters")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
