"""The compact speech encoder: log-mel → features at 25 Hz, about 1.4 million parameters.

It has a strided stem to 50 Hz, residual dilated convolutions there, a strided step to 25 Hz, more
such convolutions, and a final norm. A linear read-out of the features says when lips close. Output
frame i is centred on mel frame 4 i, i.e. on second i / 25.
"""

from dataclasses import dataclass, field
from pathlib import Path

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from training import shipped
from training.nn.checkpoint import load_model, restored
from training.nn.config import Config
from training.speech.log_mel import BANDS

ACTIVE_QUANTILE = 0.95
ACTIVE_RANGE = 4.0
QUIETEST_LEVEL = -9.0
DEEPEST = -12.0
SCALE = 4.0
SHIPPED_ENCODER = shipped("compact_speech")
UNTRAINED_CLOSURE = -20.0
"""Bias of the closure read-out until `training.speech.train_closure` runs. With it lips never close."""


@dataclass
class CompactConfig(Config):
    """Sizes of the encoder; `rate_hz` is the rate of features that they give."""

    model: str = "compact_speech"
    bands: int = BANDS
    channels: int = 192
    fine_dilations: list[int] = field(default_factory=lambda: [1, 2])
    coarse_dilations: list[int] = field(default_factory=lambda: [1, 2, 4, 8, 1, 2])
    rate_hz: float = 25.0


def debug_config() -> CompactConfig:
    """A tiny encoder for tests."""
    return CompactConfig(channels=16, fine_dilations=[1], coarse_dilations=[1, 2])


def normalise(mel: Tensor) -> Tensor:
    """Removes loudness, microphone and voice colour from one clip, [T, 64] → [T, 64].

    The level of a frame is its mean over bands. Frames within 4 nepers (of power) of the 95 %
    quantile of levels are active (quantile with linear interpolation). Each band's mean over the
    active frames is subtracted. If the mean of these means is under −9, all are raised together
    so that it is −9: near-silence stays silent instead of being amplified. Then the result is
    bounded below by −12 and divided by 4.
    """
    return (mel - clip_colour(mel)).clamp_min(DEEPEST) / SCALE


def clip_colour(mel: Tensor) -> Tensor:
    """The means [64] that `normalise` subtracts from a clip's raw log-mel [T, 64]."""
    level = mel.mean(dim=1)
    active = level >= torch.quantile(level, ACTIVE_QUANTILE) - ACTIVE_RANGE
    colour = mel[active].mean(dim=0)
    return colour + (QUIETEST_LEVEL - colour.mean()).clamp_min(0.0)


class ResidualBlock(nn.Module):
    """x + mix(GELU(conv(norm(x)))) on [B, T, C]; `conv` has 3 taps `dilation` apart."""

    def __init__(self, channels: int, dilation: int):
        super().__init__()
        self.norm = nn.LayerNorm(channels)
        self.conv = nn.Conv1d(channels, channels, 3, padding=dilation, dilation=dilation)
        self.mix = nn.Linear(channels, channels)

    def forward(self, x: Tensor) -> Tensor:
        """[B, T, C] → [B, T, C]; zeros stand beyond both ends."""
        y = self.conv(self.norm(x).transpose(1, 2)).transpose(1, 2)
        return x + self.mix(F.gelu(y))


class CompactEncoder(nn.Module):
    """Normalised log-mel [B, T, 64] at 100 Hz → features [B, ⌈⌈T/2⌉/2⌉, C] at 25 Hz."""

    def __init__(self, config: CompactConfig):
        super().__init__()
        self.config = config
        channels = config.channels
        self.stem = nn.Conv1d(config.bands, channels, 5, stride=2, padding=2)
        self.fine = nn.ModuleList(ResidualBlock(channels, d) for d in config.fine_dilations)
        self.down = nn.Conv1d(channels, channels, 3, stride=2, padding=1)
        self.coarse = nn.ModuleList(ResidualBlock(channels, d) for d in config.coarse_dilations)
        self.norm = nn.LayerNorm(channels)
        self.closure = nn.Linear(channels, 1)
        nn.init.zeros_(self.closure.weight)
        nn.init.constant_(self.closure.bias, UNTRAINED_CLOSURE)

    def closed(self, features: Tensor) -> Tensor:
        """Probability that the lips are together for p, b or m: features [..., C] → [...]."""
        return self.closure(features)[..., 0].sigmoid()

    def forward(self, mel: Tensor) -> Tensor:
        """`mel` [B, T, 64], each clip through `normalise` first. Returns [B, T', C]."""
        x = F.gelu(self.stem(mel.transpose(1, 2))).transpose(1, 2)
        for block in self.fine:
            x = block(x)
        x = F.gelu(self.down(x.transpose(1, 2))).transpose(1, 2)
        for block in self.coarse:
            x = block(x)
        return self.norm(x)


def load_encoder(path: Path) -> CompactEncoder:
    """The encoder of a finished run, or of a model folder, ready for inference."""
    if path.is_dir():
        return load_model(path, lambda config: CompactEncoder(CompactConfig(**config)))
    saved = torch.load(path)
    state = {k.removeprefix("encoder."): v for k, v in saved["state"].items() if "encoder." in k}
    return restored(CompactEncoder(CompactConfig(**saved["config"])), state)
