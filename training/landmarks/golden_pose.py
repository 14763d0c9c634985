"""Golden of the pose network: debug size, random weights, the landmark golden's picture."""

import json
from pathlib import Path

import torch

from training.goldens import write_golden
from training.landmarks import golden
from training.landmarks.pose_network import POSE_DEBUG, PoseNetwork
from training.landmarks.pose_train import decode


def write(out: Path, _shared: Path) -> Path:
    """Writes `pose_debug.safetensors`: `input` `[4, 128, 128]`, `weights.*`, `out` `[16, 16, 10]` and
    the best cell's `place` and `rotation`."""
    torch.manual_seed(4)
    model = PoseNetwork(POSE_DEBUG)
    golden.unsettle(model)
    _, pixels = golden.picture()
    model.eval()
    with torch.no_grad():
        before = model(pixels)
        model.fold()
        result = model(pixels)
        assert (result - before).abs().max() < 1e-4, "folding changed the network"
        _, place, _, turn = decode(result)
    tensors = {
        "input": pixels[0],
        "out": result[0].permute(1, 2, 0),
        "place": place[0],
        "rotation": turn[0],
    }
    about = {"widths": json.dumps(POSE_DEBUG.widths), "source": "random weights, seed 4, procedural scene"}
    return write_golden(out / "pose_debug.safetensors", tensors, "pose", model, **about)
