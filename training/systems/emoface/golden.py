"""Golden of EmoFace: a performance from a first pose, 30 frames and so longer than the look-back."""

from pathlib import Path

import torch

from training.goldens import randomise_norms, write_golden
from training.nn.spiral_conv import spirals
from training.systems.emoface.model import EmoFace, Inputs, debug_config

FRAMES, STYLE = 30, 1


def write(out: Path, shared: Path) -> Path:
    """`weights.*`; `content`, `emotion`, `level`, `first` → `motion`, `content_…`, `emotion_motion` [T, D]
    metres, `mask` [T, V]; `shares` → `prototype`. `shared` is not used.
    """
    torch.manual_seed(23)
    config = debug_config()
    config.landmarks = list(range(68))
    points = torch.rand(config.vertices, 3).numpy()
    triangles = torch.randint(0, config.vertices, (300, 3))
    triangles = torch.cat([triangles, torch.arange(config.vertices).unfold(0, 3, 3)])
    triangles = triangles[triangles.diff(dim=1).abs().min(dim=1).values > 0]
    triangles = triangles[triangles[:, 0] != triangles[:, 2]].numpy()
    around = spirals(points, triangles, config.kernel, config.dilation)
    model = EmoFace(config, around).eval()
    randomise_norms(model)
    with torch.no_grad():
        for branch in (model.content, model.emotion):
            branch.motion_out.weight.normal_(std=0.2)
            branch.motion_out.bias.normal_(std=0.2)
        model.prototypes.normal_()
        model.mesh_attention.out.weight.normal_()
    inputs = Inputs(
        torch.randn(1, FRAMES, config.speech.channels),
        torch.randn(1, FRAMES, config.emotion_channels),
        torch.tensor([STYLE]),
        torch.linspace(0.0, 1.5, FRAMES)[None],
    )
    first = torch.randn(1, 3 * config.vertices)
    performance = model.perform(inputs, first)
    shares = torch.softmax(torch.randn(len(config.emotions)), dim=0)
    tensors = {
        "weights.spirals": torch.from_numpy(around).float(),
        "content": inputs.content[0],
        "emotion": inputs.emotion[0],
        "level": inputs.level[0],
        "first": (first * config.scale_m).unflatten(1, (-1, 3))[0],
        "motion": performance.motion[0] * config.scale_m,
        "content_motion": performance.content[0] * config.scale_m,
        "emotion_motion": performance.emotion[0] * config.scale_m,
        "mask": performance.mask[0],
        "shares": shares,
        "prototype": shares @ model.prototypes,
    }
    return write_golden(out / "emoface_debug.safetensors", tensors, "emoface", model, config.to_json())
