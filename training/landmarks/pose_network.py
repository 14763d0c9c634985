"""The network that finds faces in any pose on a depth picture; `find_landmarks/pose_network.rs` is
its twin.

A small U-Net over the 128² pictures of `render.py`. Each of 16² cells says whether a face's centre
lies in it, where exactly, how large the face is and how it is turned. A face counts as visible up to
60° from the line of sight; backs of heads are no faces.
"""

from dataclasses import dataclass

import torch
from torch import Tensor, nn
from torch.nn import functional as F

from training.landmarks.network import Block, Conv

CELLS = 16
# Face logit, place in the cell (column, row), log of the size, and two axes of the face in the view.
OUTPUTS = 1 + 2 + 1 + 6


@dataclass
class PoseConfig:
    """`widths`: channels at 64², 32², 16², 8² and 4²."""

    widths: tuple[int, int, int, int, int] = (12, 24, 48, 72, 72)


POSE_DEBUG = PoseConfig(widths=(4, 6, 8, 8, 8))


class PoseNetwork(nn.Module):
    """`[B, 4, 128, 128]` → `[B, 10, 16, 16]`: see `OUTPUTS`."""

    def __init__(self, config: PoseConfig):
        super().__init__()
        a, b, c, d, e = config.widths
        self.config = config
        self.stem = Conv(4, a, stride=2)
        self.down32 = Conv(a, b, stride=2)
        self.block32 = Block(b)
        self.down16 = Conv(b, c, stride=2)
        self.block16 = Block(c)
        self.down8 = Conv(c, d, stride=2)
        self.block8 = Block(d)
        self.down4 = Conv(d, e, stride=2)
        self.block4 = Block(e)
        self.up8 = Conv(e, d, kernel=1)
        self.join8 = Block(d)
        self.up16 = Conv(d, c, kernel=1)
        self.join16 = Block(c)
        self.out = nn.Conv2d(c, OUTPUTS, 1)

    def forward(self, x: Tensor) -> Tensor:
        x = self.block32(torch.relu(self.down32(torch.relu(self.stem(x)))))
        x16 = self.block16(torch.relu(self.down16(x)))
        x8 = self.block8(torch.relu(self.down8(x16)))
        x4 = self.block4(torch.relu(self.down4(x8)))
        up = F.interpolate(self.up8(x4), scale_factor=2, mode="nearest")
        up = self.join8(torch.relu(up + x8))
        up = F.interpolate(self.up16(up), scale_factor=2, mode="nearest")
        return self.out(self.join16(torch.relu(up + x16)))

    def fold(self) -> None:
        """Folds every normalisation; afterwards the network only infers."""
        self.eval()
        for module in self.modules():
            if isinstance(module, Conv):
                module.fold()
