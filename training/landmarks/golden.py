"""Golden of the landmark network: debug size, random weights, one rendered picture."""

import json
from pathlib import Path

import numpy as np
import torch

from training.goldens import write_golden
from training.landmarks import render
from training.landmarks.network import DEBUG, LandmarkNetwork, decode
from training.landmarks.samples import ellipsoid


def scene() -> tuple[np.ndarray, np.ndarray]:
    """Three overlapping ellipsoids: points and triangles."""
    shapes = [
        ellipsoid([0, 0, 0], [0.08, 0.1, 0.09], 16),
        ellipsoid([0, -0.01, 0.09], [0.02, 0.03, 0.02], 9),
        ellipsoid([0.05, 0.06, 0.05], [0.03, 0.02, 0.03], 7),
    ]
    points = np.concatenate([p for p, _ in shapes])
    triangles = [t + sum(len(p) for p, _ in shapes[:i]) for i, (_, t) in enumerate(shapes)]
    return points.astype(np.float32), np.concatenate(triangles).astype(np.int32)


def picture() -> tuple[np.ndarray, torch.Tensor]:
    """A window of the scene (middle x and y, half width) and the picture in it, `[1, 4, 128, 128]`."""
    window = np.array([0.01, 0.005, 0.11], np.float32)
    points, triangles = scene()
    return window, torch.from_numpy(render.picture(points, triangles, window[:2], window[2]))[None]


def unsettle(model: torch.nn.Module) -> None:
    """Gives the normalisations random statistics, so that a mistake in folding shows."""
    for module in model.modules():
        if isinstance(module, torch.nn.BatchNorm2d):
            torch.nn.init.uniform_(module.running_mean, -0.2, 0.2)
            torch.nn.init.uniform_(module.running_var, 0.5, 1.5)


def write(out: Path, _shared: Path) -> Path:
    """Writes `landmarks_debug.safetensors`: the scene, its picture `input` `[4, 128, 128]`, `weights.*`
    and the network's output (heat maps only of landmarks 0, 17, 34, 51)."""
    torch.manual_seed(3)
    model = LandmarkNetwork(DEBUG)
    unsettle(model)
    points, triangles = scene()
    window, pixels = picture()
    model.eval()
    with torch.no_grad():
        before, _ = model(pixels)
        model.fold()
        heat, face = model(pixels)
        assert (heat - before).abs().max() < 1e-4, "folding changed the network"
        places, confidence = decode(heat)
    tensors = {
        "points": torch.from_numpy(points),
        "triangles": torch.from_numpy(triangles),
        "window": torch.from_numpy(window),
        "input": pixels[0],
        "heat": heat[0, ::17],
        "face": face,
        "places": places[0],
        "confidence": confidence[0],
    }
    about = {"widths": json.dumps(DEBUG.widths), "source": "random weights, seed 3, procedural scene"}
    return write_golden(out / "landmarks_debug.safetensors", tensors, "landmarks", model, **about)
