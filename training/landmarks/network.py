"""The network that finds 68 landmarks on a depth picture; `find_landmarks/network.rs` is its
twin.

A small U-Net over 128² pictures of depth and normals (`render.py`). It gives 68 heat maps of 64²,
made at 32² with four sub-pixels each, and one number that says whether there is a face. It also
places landmarks that face away, so that three views together fix all of them in space (after
Paulsen et al. 2018, "Multi-view Consensus CNN for 3D Facial Landmark Placement").
"""

from dataclasses import dataclass
from pathlib import Path

import torch
from torch import Tensor, nn
from torch.nn import functional as F

from training.nn.checkpoint import read_arrays

LANDMARKS = 68


@dataclass
class Config:
    """`widths`: channels at 64², 32², 16² and 8²."""

    widths: tuple[int, int, int, int] = (16, 48, 80, 96)


DEBUG = Config(widths=(4, 6, 8, 8))


class Conv(nn.Module):
    """3×3 (or 1×1) convolution with batch normalisation, which is folded into it on export."""

    def __init__(self, inputs: int, outputs: int, kernel: int = 3, stride: int = 1):
        super().__init__()
        self.conv = nn.Conv2d(inputs, outputs, kernel, stride, kernel // 2)
        self.norm: nn.Module = nn.BatchNorm2d(outputs)

    def forward(self, x: Tensor) -> Tensor:
        return self.norm(self.conv(x))

    @torch.no_grad()
    def fold(self) -> None:
        """Puts the normalisation's running statistics into the convolution."""
        if isinstance(self.norm, nn.Identity):
            return
        scale = self.norm.weight / torch.sqrt(self.norm.running_var + self.norm.eps)
        self.conv.weight.mul_(scale[:, None, None, None])
        self.conv.bias.copy_((self.conv.bias - self.norm.running_mean) * scale + self.norm.bias)
        self.norm = nn.Identity()


class Block(nn.Module):
    """Two convolutions with a shortcut around them."""

    def __init__(self, width: int):
        super().__init__()
        self.first = Conv(width, width)
        self.second = Conv(width, width)

    def forward(self, x: Tensor) -> Tensor:
        return torch.relu(x + self.second(torch.relu(self.first(x))))


class LandmarkNetwork(nn.Module):
    """`[B, 4, 128, 128]` → heat maps `[B, 68, 64, 64]` (logits) and face logits `[B]`."""

    def __init__(self, config: Config):
        super().__init__()
        a, b, c, d = config.widths
        self.config = config
        self.stem = Conv(4, a, stride=2)
        self.block64 = Block(a)
        self.down32 = Conv(a, b, stride=2)
        self.block32 = Block(b)
        self.down16 = Conv(b, c, stride=2)
        self.block16 = Block(c)
        self.down8 = Conv(c, d, stride=2)
        self.block8 = Block(d)
        self.up16 = Conv(d, c, kernel=1)
        self.join16 = Conv(c, c)
        self.up32 = Conv(c, b, kernel=1)
        self.join32 = Block(b)
        self.heat = nn.Conv2d(b, 4 * LANDMARKS, 1)
        self.face = nn.Linear(d, 1)

    def forward(self, x: Tensor) -> tuple[Tensor, Tensor]:
        x = self.block64(torch.relu(self.stem(x)))
        x32 = self.block32(torch.relu(self.down32(x)))
        x16 = self.block16(torch.relu(self.down16(x32)))
        x8 = self.block8(torch.relu(self.down8(x16)))
        up = F.interpolate(self.up16(x8), scale_factor=2, mode="nearest")
        up = torch.relu(self.join16(torch.relu(up + x16)))
        up = F.interpolate(self.up32(up), scale_factor=2, mode="nearest")
        up = self.join32(torch.relu(up + x32))
        heat = F.pixel_shuffle(self.heat(up), 2)
        return heat, self.face(x8.mean((2, 3)))[:, 0]

    def fold(self) -> None:
        """Folds every normalisation; afterwards the network only infers."""
        self.eval()
        for module in self.modules():
            if isinstance(module, Conv):
                module.fold()


def decode(heat: Tensor) -> tuple[Tensor, Tensor]:
    """Places `[B, 68, 2]` (column, row from 0 to 1) and confidences `[B, 68]` of heat maps.

    The place is the mean over the 7×7 pixels around the peak of the softmax; the confidence is
    the probability inside them.
    """
    batch, count, size, _ = heat.shape
    chance = heat.flatten(2).softmax(-1)
    peak = chance.argmax(-1)
    row, column = peak // size, peak % size
    grid = torch.arange(size, device=heat.device)
    near_row = (grid - row[..., None]).abs() <= 3
    near_column = (grid - column[..., None]).abs() <= 3
    chance = chance.view(batch, count, size, size)
    chance = chance * near_row[..., :, None] * near_column[..., None, :]
    confidence = chance.sum((2, 3))
    centres = (grid + 0.5) / size
    x = (chance.sum(2) * centres).sum(-1) / confidence
    y = (chance.sum(3) * centres).sum(-1) / confidence
    return torch.stack([x, y], -1), confidence


def start_from(origin: Path, model: nn.Module, part: str) -> None:
    """Loads another run's `network.pt`, or the arrays of a model folder whose names begin with `part`.

    If the normalisation of the loaded weights is folded, it stays folded.
    """
    if origin.is_dir():
        arrays = read_arrays(origin).items()
        state = {k.removeprefix(part): v for k, v in arrays if k.startswith(part)}
    else:
        state = torch.load(origin)["model"]
    if not any("running_mean" in name for name in state):
        model.fold()
        model.train()
    model.load_state_dict(state)
