"""Writes FaceTalk's head, and its speech model beside it, as the one folder that Rust reads.

    python -m training.export_facetalk --head runs/facetalk/head.pt --motion runs/facetalk_motion/motion.pt \
        --landmark-motion runs/facetalk_landmarks/motion.pt

Weights are f16; maps to codes, landmarks, directions, mean and deviation stay f32.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path

import torch
from safetensors.torch import load_file

from training.export import write_model
from training.systems.facetalk.config import HeadConfig
from training.systems.facetalk.head import Head
from training.systems.facetalk.motion import Denoiser, MotionConfig
from training.systems.facetalk.train import load

MOTIONS = ("motion", "landmark_motion")
"""By speech, and by the motion of landmarks."""
EXACT = ("identity_code.", "expression_code.", "identity.landmarks.", "identity.mirror", "principal.",
         "motion.mean", "motion.std", "landmark_motion.mean", "landmark_motion.std")  # fmt: skip


def export(head: Head, motions: dict[str, Denoiser], folder: Path) -> Path:
    """model.safetensors and config.json; `motions` by what they are called there, `MOTIONS`."""
    state, config = dict(head.state_dict()), head.config.to_json()
    for name, motion in motions.items():
        state |= {f"{name}.{key}": value for key, value in motion.state_dict().items()}
        config[name] = motion.config.to_json()
    stored = {key: value.float() if key.startswith(EXACT) else value.half() for key, value in state.items()}
    return write_model(folder, stored, config, exact=True)


def load_folder(folder: Path) -> tuple[Head, dict[str, Denoiser]]:
    """What `export` wrote, in f32."""
    config = json.loads((folder / "config.json").read_text())
    state = {key: value.float() for key, value in load_file(folder / "model.safetensors").items()}
    head = Head(HeadConfig.from_json(config))
    own = tuple(f"{name}." for name in MOTIONS)
    head.load_state_dict({key: value for key, value in state.items() if not key.startswith(own)})
    motions = {}
    for name in MOTIONS:
        if name in config:
            motions[name] = Denoiser(MotionConfig.from_json(config[name])).eval()
            prefix = f"{name}."
            motions[name].load_state_dict(
                {key[len(prefix) :]: value for key, value in state.items() if key.startswith(prefix)}
            )
    return head.eval(), motions


def load_motion(path: Path) -> Denoiser:
    """motion.pt of `training.systems.facetalk.train_motion`."""
    kept = torch.load(path, map_location="cpu", weights_only=True)
    model = Denoiser(MotionConfig.from_json(kept["config"]))
    model.load_state_dict(kept["state"])
    return model.eval()


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--head", type=Path, required=True, help="head.pt")
    parser.add_argument("--motion", type=Path, help="motion.pt; none: a head without speech")
    parser.add_argument("--landmark-motion", type=Path, help="motion.pt of `--memory landmarks`")
    parser.add_argument("--out", type=Path, default=Path("weights/facetalk/facetalk_compact"))
    arguments = parser.parse_args()
    given = zip(MOTIONS, (arguments.motion, arguments.landmark_motion), strict=True)
    motions = {name: load_motion(path) for name, path in given if path is not None}
    print(export(load(arguments.head), motions, arguments.out))


if __name__ == "__main__":
    main()
