"""Golden of the rig's network: a debug network on random vertices."""

from dataclasses import asdict
from pathlib import Path

import torch

from training.align import canonical_landmarks
from training.corpus.faces import CHANNELS
from training.goldens import write_golden
from training.rig.network import CONFIGS, RigNetwork, SkinGeometry


def write(out: Path, shared: Path) -> Path:
    """Writes `rig_debug.safetensors`: `positions` [V, 3], `landmarks` [N, 3], `base` [V, N],
    `weights.*` and `output` [S, V, 3], decimetres."""
    torch.manual_seed(6)
    landmarks = torch.from_numpy(10.0 * canonical_landmarks()).float()
    near = landmarks[torch.randint(68, (24,))] + 0.15 * torch.randn(24, 3)
    positions = torch.cat([near, 0.8 * torch.randn(8, 3)])
    geometry = SkinGeometry(positions, landmarks, torch.rand(32, 68) / 10.0)
    model = RigNetwork(CONFIGS["debug"]).eval()
    with torch.no_grad():
        for parameter in model.parameters():
            parameter.normal_(0.0, 0.15)
        model.templates.normal_(0.0, 0.05)
        model.feature_mean.normal_(0.0, 0.2)
        model.feature_scale.uniform_(0.5, 1.5)
        output = model(geometry)
    tensors = {"positions": positions, "landmarks": landmarks, "base": geometry.base, "output": output}
    config, source = asdict(CONFIGS["debug"]) | {"shapes": CHANNELS}, "random weights, seed 6"
    path = out / "rig_debug.safetensors"
    return write_golden(path, tensors, "rig", model, config, source=source, tolerance="1e-5 absolute")
