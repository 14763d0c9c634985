"""Writes the trained networks and the shape prior as the model files that Rust embeds.

python -m training.landmarks.export --data ../shared/data --views runs/landmarks --pose runs/pose
"""

import argparse
import json
from pathlib import Path

import torch
from safetensors.torch import save_file

from training.landmarks import prior
from training.landmarks.network import Config, LandmarkNetwork, start_from
from training.landmarks.pose_network import PoseConfig, PoseNetwork


def folded(model: torch.nn.Module, path: Path) -> dict[str, torch.Tensor]:
    """The weights of a run, normalisation folded (it may be folded already)."""
    start_from(path, model, "")
    model.fold()
    return model.state_dict()


def main() -> None:
    """Entry of the command."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--data", type=Path, default=Path("../shared/data"))
    parser.add_argument("--views", type=Path, default=Path("runs/landmarks"))
    parser.add_argument("--pose", type=Path, default=Path("runs/pose"))
    parser.add_argument("--out", type=Path, default=Path("weights/shared/landmarks"))
    args = parser.parse_args()
    views, pose = Config(), PoseConfig()
    tensors = {f"views.{k}": v for k, v in folded(LandmarkNetwork(views), args.views / "network.pt").items()}
    tensors |= {f"pose.{k}": v for k, v in folded(PoseNetwork(pose), args.pose / "network.pt").items()}
    tensors["prior.modes"] = torch.from_numpy(prior.modes(args.data))
    args.out.mkdir(parents=True, exist_ok=True)
    save_file({k: v.half().contiguous() for k, v in tensors.items()}, args.out / "model.safetensors")
    config = {"widths": views.widths, "pose_widths": pose.widths, "prior_modes": prior.MODES}
    (args.out / "config.json").write_text(json.dumps(config) + "\n")


if __name__ == "__main__":
    main()
