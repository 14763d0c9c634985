"""The ear for emotion: which emotion two seconds of a voice express, and how sure that is.

A small network over log-mels and pitch predicts Whisper's middle layers for the two seconds. The 118 numbers
of `training.systems.emoface.emotion_encoder` are joined to its outputs. A linear layer turns both into logits
of the emotions. `training.speech.train_emotion_ear` fits it. Live faces use this ear. Instants and windows
are the same as for the 118 numbers.
"""

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import torch
import torch.nn.functional as F
from torch import Tensor, nn

from training.nn.checkpoint import read_model, restored
from training.nn.config import Config
from training.nn.residual_block import ResidualBlock
from training.speech.log_mel import BANDS
from training.systems.emoface.emotion_encoder import (
    ACTIVE_NEPERS,
    HEARD_EMOTIONS,
    LOUD_SHARE,
    NUMBERS,
    PERIODIC,
    WINDOW,
    Voice,
    cepstral_basis,
    instants,
    of_window,
)

INPUTS = BANDS + 2
"""Input channels of a frame: log-mel relative to the loud level, pitch, and how periodic the sound is."""
DEEPEST, SCALE = -12.0, 4.0
MIDDLE_OCTAVE = 7.5
LEAST_WEIGHT = 0.01
"""Added to the weight of every frame, so that inactive frames (weight 0) still count a little."""
LEAST_SPREAD = 1e-5
STRIDE = 4
LARGEST = 6.0
"""The layer's inputs are clipped at this many standard deviations."""
EVERY = 2
"""Over time the ear uses only every second instant, one each 320 ms."""


@dataclass
class EmotionEarConfig(Config):
    """Everything that inference needs; saved as config.json. `told` is the number of outputs."""

    model: str = "emotion_ear"
    channels: int = 120
    fine_dilations: list[int] = field(default_factory=lambda: [1])
    coarse_dilations: list[int] = field(default_factory=lambda: [1, 2, 4])
    hidden: int = 256
    told: int = 128
    emotions: list[str] = field(default_factory=lambda: list(HEARD_EMOTIONS))


def inputs_of(mel: Tensor, octave: Tensor, periodic: Tensor) -> tuple[Tensor, Tensor]:
    """Network input of windows: [B, T, 64], [B, T], [B, T] → [B, T, 66] and weights [B, T]."""
    level = mel.mean(dim=-1)
    loud = torch.quantile(level, LOUD_SHARE, dim=-1, keepdim=True)
    active = level > loud - ACTIVE_NEPERS
    voiced = active & (periodic > PERIODIC)
    bands = (mel - loud[..., None]).clamp_min(DEEPEST) / SCALE
    pitch = torch.where(voiced, octave - MIDDLE_OCTAVE, torch.zeros_like(octave))
    return torch.cat([bands, pitch[..., None], periodic[..., None]], dim=-1), active.to(mel.dtype)


class Convolutions(nn.Module):
    """[B, T, 66] at 100 Hz → [B, ⌈⌈T/2⌉/2⌉, C] at 25 Hz."""

    def __init__(self, config: EmotionEarConfig):
        super().__init__()
        channels = config.channels
        self.stem = nn.Conv1d(INPUTS, channels, 5, stride=2, padding=2)
        self.fine = nn.ModuleList(ResidualBlock(channels, d) for d in config.fine_dilations)
        self.down = nn.Conv1d(channels, channels, 3, stride=2, padding=1)
        self.coarse = nn.ModuleList(ResidualBlock(channels, d) for d in config.coarse_dilations)
        self.norm = nn.LayerNorm(channels)

    def forward(self, x: Tensor) -> Tensor:
        """[B, T, 66] → [B, T', C]."""
        x = F.gelu(self.stem(x.transpose(1, 2))).transpose(1, 2)
        for block in self.fine:
            x = block(x)
        x = F.gelu(self.down(x.transpose(1, 2))).transpose(1, 2)
        for block in self.coarse:
            x = block(x)
        return self.norm(x)


class EmotionEarNet(nn.Module):
    """Windows of 10 ms frames → a prediction of Whisper's layers for them, [B, told]."""

    def __init__(self, config: EmotionEarConfig):
        super().__init__()
        self.config = config
        self.encoder = Convolutions(config)
        self.inner = nn.Linear(2 * config.channels, config.hidden)
        self.outer = nn.Linear(config.hidden, config.told)

    def forward(self, heard: Tensor, weight: Tensor) -> Tensor:
        """`heard` [B, T, 66] and `weight` [B, T] of `inputs_of`; mean and spread over time are weighted."""
        x = self.encoder(heard)
        share = weight[:, ::STRIDE, None] + LEAST_WEIGHT
        share = share / share.sum(dim=1, keepdim=True)
        mean = (share * x).sum(dim=1)
        spread = (share * (x - mean[:, None]).square()).sum(dim=1)
        pooled = torch.cat([mean, (spread + LEAST_SPREAD).sqrt()], dim=1)
        return self.outer(F.gelu(self.inner(pooled)))


ARRAYS = ("mean", "scale", "weight", "bias", "readers")
"""Names of the arrays that an ear stores beside its network."""


@dataclass
class EmotionLayer:
    """Logistic regression over rows of R numbers: `mean`, `scale` [R], `weight` [R, 7], `bias` [7].

    `readers` [R] is the mean row of neutral readers, to which a speaker's neutral voice is moved
    (`rust-core/src/speech/emotion_ear/neutral_voice.rs`).
    """

    mean: np.ndarray
    scale: np.ndarray
    weight: np.ndarray
    bias: np.ndarray
    readers: np.ndarray

    def arrays(self) -> dict[str, np.ndarray]:
        """The arrays that are saved beside the network."""
        return {name: getattr(self, name) for name in ARRAYS}

    def logits(self, rows: np.ndarray) -> np.ndarray:
        """Logits of rows, [I, R] → [I, 7]."""
        return ((rows - self.mean) / self.scale).clip(-LARGEST, LARGEST) @ self.weight + self.bias


def layer_arrays(state: dict[str, torch.Tensor]) -> dict[str, np.ndarray]:
    """The arrays of the layer among those of a model."""
    return {name: state[name].double().numpy() for name in ARRAYS}


@dataclass
class EmotionEar(EmotionLayer):
    """The layer over the network's outputs and the 118 numbers, R = told + 118."""

    config: EmotionEarConfig
    net: EmotionEarNet

    def hear(self, voice: Voice) -> np.ndarray:
        """Logits at each instant of a voice, [I, 7]."""
        return self.logits(rows_of(self.net, voice))


def read_ear(folder: Path) -> EmotionEar:
    """The layer and the network of a model folder."""
    config, state = read_model(folder)
    net = EmotionEarNet(EmotionEarConfig.from_json(config))
    restored(net, {name: value for name, value in state.items() if name not in ARRAYS})
    return EmotionEar(**layer_arrays(state), config=net.config, net=net)


@torch.no_grad()
def told_of(net: EmotionEarNet, voice: Voice, first: int, end: int) -> np.ndarray:
    """Outputs of the network for one window, [told]."""
    part = [torch.from_numpy(x[first:end]).float()[None] for x in (voice.mel, voice.octave, voice.periodic)]
    return net(*inputs_of(*part))[0].numpy().astype(np.float64)


def row_of(net: EmotionEarNet, voice: Voice, first: int, end: int) -> np.ndarray:
    """Outputs of the network for a window, then the window's 118 numbers, [told + 118]."""
    cepstra = voice.mel @ cepstral_basis()
    return np.concatenate([told_of(net, voice, first, end), of_window(voice, cepstra, first, end)])


def rows_of(net: EmotionEarNet, voice: Voice) -> np.ndarray:
    """`row_of` the window at each instant, [I, told + 118]."""
    rows = [row_of(net, voice, max(end - WINDOW, 0), end) for end in instants(len(voice.mel))]
    return np.array(rows).reshape(-1, net.outer.out_features + NUMBERS)
