"""Golden of FaceTalk's head: both fields and both deformations at points of one head."""

from pathlib import Path

import torch

from training.goldens import write_golden
from training.systems.facetalk.config import debug_config
from training.systems.facetalk.head import COEFFICIENTS, Head

POINTS = 60


def write(out: Path, shared: Path) -> Path:
    """`weights.*`; `points` [P, 3], `coefficients` [1, 100], `channels` [1, M] → `z` [1, Z],
    `anchors` [A, 3], `expression` [1, X], `mean_place` [P, 3], `identity` [P], `posed`, `canonical` [P, 3],
    `field` [P]. `shared` is not used.
    """
    torch.manual_seed(31)
    config = debug_config()
    head = Head(config).eval()
    with torch.no_grad():
        for parameter in head.parameters():
            parameter.add_(0.1 * torch.randn_like(parameter))
        head.identity.mirror.copy_(torch.tensor([1.0, -1.0, 1.0, 1.0, -1.0, 1.0]))
        points = 0.3 * torch.randn(1, POINTS, 3)
        coefficients, channels = torch.randn(1, COEFFICIENTS), torch.rand(1, len(config.channels))
        z, expression = head.identity_code(coefficients), head.expression(channels)
        anchors = head.identity.anchors(z)
        points[0, : config.anchors] = anchors[0] + 0.02
        tensors = {
            "points": points[0],
            "coefficients": coefficients,
            "channels": channels,
            "z": z,
            "anchors": anchors[0],
            "expression": expression,
            "mean_place": head.place(points, z)[0],
            "identity": head.identity(points, z)[0],
            "posed": head.posed(points, z, expression)[0],
            "canonical": head.canonical(points, z, expression)[0],
            "field": head(points, z, expression)[0],
        }
    config.directions = [
        {"name": f"direction {number}", "reach_mm": 1.0} for number in range(len(head.principal.directions))
    ]
    return write_golden(
        out / "facetalk_head_debug.safetensors", tensors, "facetalk_head", head, config.to_json()
    )
