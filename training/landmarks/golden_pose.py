"""Golden of the pose network: debug size, random weights, the landmark golden's picture."""

import json
from pathlib import Path

import numpy as np
import torch
from safetensors.torch import save_file

from training.landmarks import render
from training.landmarks.golden import scene
from training.landmarks.pose_network import POSE_DEBUG, PoseNetwork
from training.landmarks.pose_train import decode


def write(out: Path, _shared: Path) -> Path:
    """Writes `pose_debug.safetensors`: `input` `[4, 128, 128]`, `weights.*`, `out` `[16, 16, 10]` and
    the best cell's `place` and `rotation`."""
    torch.manual_seed(4)
    model = PoseNetwork(POSE_DEBUG)
    # Not the identity: folding must be seen to work.
    for module in model.modules():
        if isinstance(module, torch.nn.BatchNorm2d):
            torch.nn.init.uniform_(module.running_mean, -0.2, 0.2)
            torch.nn.init.uniform_(module.running_var, 0.5, 1.5)
    points, triangles = scene()
    window = np.array([0.01, 0.005, 0.11], np.float32)
    picture = torch.from_numpy(render.picture(points, triangles, window[:2], window[2]))[None]
    model.eval()
    with torch.no_grad():
        before = model(picture)
        model.fold()
        result = model(picture)
        assert (result - before).abs().max() < 1e-4, "folding changed the network"
        _, place, _, turn = decode(result)
    tensors = {f"weights.{k}": v for k, v in model.state_dict().items()}
    tensors |= {
        "input": picture[0],
        "out": result[0].permute(1, 2, 0),
        "place": place[0],
        "rotation": turn[0],
    }
    path = out / "pose_debug.safetensors"
    save_file(
        {k: v.contiguous() for k, v in tensors.items()},
        path,
        metadata={
            "widths": json.dumps(POSE_DEBUG.widths),
            "source": "python -m training.goldens pose; random weights, seed 4, procedural scene",
            "tolerance": "1e-4 absolute",
        },
    )
    return path
