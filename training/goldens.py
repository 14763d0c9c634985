"""Writes the golden files that keep Python and Rust in agreement.

    python -m training.goldens NAME [--shared ../shared] [--out tests/goldens]

A golden is a tiny model with seeded random weights, one input and its output; the Rust tests load
the same file and must agree within 1e-4. The metadata says where the golden came from.
"""

import argparse
import importlib
import json
from pathlib import Path

from safetensors.torch import save_file
from torch import Tensor, nn

GOLDENS = {
    "eight_bits": "training.nn.golden_eight_bits",
    "log_mel": "training.speech.golden_log_mel",
    "emotion_ear": "training.speech.golden_emotion_ear",
    "emotion_of_whisper": "training.speech.golden_emotion_of_whisper",
    "checkpoint": "training.speech.golden_checkpoint",
    "instants": "training.speech.golden_instants",
    "resampled_speech": "training.speech.golden_resampled",
    "whisper": "training.speech.golden_whisper",
    "ear": "training.speech.golden_ear",
    "phones": "training.speech.golden_phones",
    "ats_compact": "training.systems.freetalk.golden_ats",
    "cafe_talk": "training.systems.cafe_talk.golden",
    "emoface": "training.systems.emoface.golden",
    "emotion_encoder": "training.systems.emoface.golden_emotion_encoder",
    "facetalk_head": "training.systems.facetalk.golden",
    "facetalk_motion": "training.systems.facetalk.golden_motion",
    "head_topology": "training.head.golden_topology",
    "static_weights": "training.deform.golden_static_weights",
    "creases": "training.deform.golden_creases",
    "landmarks": "training.landmarks.golden",
    "pose": "training.landmarks.golden_pose",
    "stm_paper": "training.systems.freetalk.stm.golden_paper",
    "stream": "training.systems.freetalk.golden_stream",
    "rig": "training.rig.golden",
    "text_units": "training.text.golden",
    "clip_text": "training.text.golden_clip",
}
"""Model name -> module with `write(out: Path, shared: Path) -> Path`."""


def write_golden(path: Path, tensors: dict[str, Tensor], name: str, model: nn.Module | None = None,
                 config: dict | None = None, **about: str) -> Path:  # fmt: skip
    """Writes `tensors` and the weights of `model` as `weights.*`.

    The metadata holds the model's configuration, the tolerance for Rust, the command, and `about`.
    """
    weights = {} if model is None else {f"weights.{key}": value for key, value in model.state_dict().items()}
    metadata = {} if config is None else {"config": json.dumps(config)}
    metadata |= {"tolerance": "1e-4", "command": f"python -m training.goldens {name}"} | about
    save_file({key: value.contiguous() for key, value in (weights | tensors).items()}, path, metadata)
    path.chmod(0o644)
    return path


def randomise_norms(model: nn.Module) -> None:
    """Gives every LayerNorm a random weight and bias instead of 1 and 0, so that swapped norms show."""
    for module in model.modules():
        if isinstance(module, nn.LayerNorm):
            nn.init.uniform_(module.weight, 0.5, 1.5)
            nn.init.uniform_(module.bias, -0.5, 0.5)


def main() -> None:
    """Entry of the command."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("names", nargs="*", choices=[*GOLDENS, []], help="goldens to write; default: all")
    parser.add_argument("--shared", type=Path, default=Path("../shared"))
    parser.add_argument("--out", type=Path, default=Path("tests/goldens"))
    args = parser.parse_args()
    args.out.mkdir(parents=True, exist_ok=True)
    for name in args.names or GOLDENS:
        print(importlib.import_module(GOLDENS[name]).write(args.out, args.shared))


if __name__ == "__main__":
    main()
