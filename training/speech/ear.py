"""The ear: frozen layers of Whisper, and a small trained body that turns them into 192 features at 25 Hz.

Whisper has heard everyone: its first layers are alike for all voices. The body learns what a face does with
them. `training.speech.train_ear` trains it, and `rust-core/src/speech/ear.rs` runs it. Output frame i is
centred on second i / 25.
"""

from dataclasses import dataclass, field
from pathlib import Path

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from training import shipped
from training.machine import in_bfloat16
from training.nn.checkpoint import load_model, restored
from training.nn.config import Config
from training.nn.residual_block import ResidualBlock
from training.speech.whisper import WhisperEncoder, decades, decades_of_power, load_trunk

NAME = "ear"
SHIPPED_EAR = shipped(NAME)
FRAMES_EACH = 2
"""Number of Whisper's feature vectors per frame of motion."""
LARGEST = 6.0
"""Inputs of the body are clipped at this many standard deviations, because a few channels of Whisper's inner
layers have enormous values."""
LOUD_QUANTILE = 0.95
LOUD = 1.0
"""Every sound is brought to this level: the 95 % quantile over frames of the loudest band, in decades."""
MAX_RAISED = 3.0
"""Decades by which a quiet sound is raised at most. Near-silence stays silent."""
QUIETEST = -6.5
"""Bands below this many decades of power, after the sound has its level, are raised to it."""


@dataclass
class EarConfig(Config):
    """Sizes of the body. `taps` are the layers of Whisper that it reads, `width` their channels."""

    model: str = NAME
    taps: list[int] = field(default_factory=lambda: [2, 3])
    width: int = 512
    channels: int = 192
    fine_dilations: list[int] = field(default_factory=lambda: [1, 2])
    coarse_dilations: list[int] = field(default_factory=lambda: [1, 2, 4, 8, 1, 2])
    rate_hz: float = 25.0


def debug_config() -> EarConfig:
    """A tiny body for tests."""
    return EarConfig(taps=[1, 2], width=16, channels=16, fine_dilations=[1], coarse_dilations=[1, 2])


class EarBody(nn.Module):
    """Taps of Whisper [B, K, 2 T, 512] at 50 Hz → features [B, T, C] at 25 Hz."""

    def __init__(self, config: EarConfig, dropout: float = 0.0):
        super().__init__()
        self.config, self.dropout = config, dropout
        taps, channels = len(config.taps), config.channels
        self.register_buffer("mean", torch.zeros(taps, config.width))
        self.register_buffer("deviation", torch.ones(taps, config.width))
        self.enter = nn.Linear(taps * config.width, channels)
        self.fine = nn.ModuleList(ResidualBlock(channels, d) for d in config.fine_dilations)
        self.down = nn.Conv1d(channels, channels, 3, stride=2, padding=1)
        self.coarse = nn.ModuleList(ResidualBlock(channels, d) for d in config.coarse_dilations)
        self.norm = nn.LayerNorm(channels)

    def forward(self, heard: Tensor) -> Tensor:
        """`heard` [B, K, 2 T, 512] → [B, T, C]."""
        x = ((heard.float() - self.mean[:, None]) / self.deviation[:, None]).clamp(-LARGEST, LARGEST)
        x = self._dropped(x.transpose(1, 2).flatten(2))
        x = F.gelu(self.enter(x))
        for block in self.fine:
            x = block(x)
        x = F.gelu(self.down(self._dropped(x).transpose(1, 2))).transpose(1, 2)
        for block in self.coarse:
            x = block(x)
        return self._dropped(self.norm(x))

    def _dropped(self, x: Tensor) -> Tensor:
        return F.dropout(x, self.dropout, self.training)


def ear_mel(samples: Tensor) -> Tensor:
    """The log-mel that the ear gives to Whisper: [S] in −1 … 1 → [S // 160, 80] at 100 Hz."""
    return levelled(decades(samples))


def ear_mel_of_power(power: Tensor, warp: float = 1.0) -> Tensor:
    """The same of `log_mel.power_spectrum` [T, 257], for voices without a waveform."""
    return levelled(decades_of_power(power, warp))


def levelled(mel: Tensor) -> Tensor:
    """Brings decades of power [T, 80] to one loudness and onto Whisper's scale.

    Whisper's own limit, 8 decades under the loudest band of the whole sound, moves with a single click. This
    one is fixed once a sound has its level, so loud and quiet copies of a sound have the same features.
    """
    level = torch.quantile(mel.amax(dim=1), LOUD_QUANTILE)
    raised = mel + (LOUD - level).clamp_max(MAX_RAISED)
    return (raised.clamp_min(QUIETEST) + 4.0) / 4.0


class Ear:
    """The whole ear, as the library runs it: Whisper's first layers and the body.

    Whisper multiplies in bfloat16 where a processor has it, which changes no feature by more than its own
    noise in training.
    """

    def __init__(self, body: EarBody | None = None, trunk: WhisperEncoder | None = None):
        self.body = load_ear(SHIPPED_EAR) if body is None else body
        self.trunk = load_trunk() if trunk is None else trunk

    @torch.no_grad()
    def __call__(self, mel: Tensor, frames: int) -> Tensor:
        """`ear_mel` [T, 80] → features [frames, C]."""
        return self.body(taps(self.trunk, mel, self.body.config.taps, frames)[None])[0]


def taps(trunk: WhisperEncoder, mel: Tensor, layers: list[int], frames: int) -> Tensor:
    """`ear_mel` [T, 80] → outputs of `layers` [K, 2 `frames`, 512] f16; the last row repeats."""
    with torch.no_grad(), in_bfloat16():
        heard = trunk.hear(mel, layers)
    rows = torch.stack([x.float() for x in heard]).half()
    return rows[:, torch.arange(FRAMES_EACH * frames).clamp_max(rows.shape[1] - 1)]


def load_ear(path: Path) -> EarBody:
    """The body of a finished run, or of a model folder, ready for inference."""
    if path.is_dir():
        return load_model(path, lambda config: EarBody(EarConfig(**config)))
    saved = torch.load(path)
    state = {k.removeprefix("encoder."): v for k, v in saved["state"].items() if k.startswith("encoder.")}
    return restored(EarBody(EarConfig(**saved["config"])), state)
