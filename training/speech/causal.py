"""Causal students: turn speech into numbers at 25 Hz while it is being spoken.

A student is a small convolutional network. FreeTalk's imitates encoder and denoiser together and gives
landmarks. EmoFace's imitates only the encoder and gives its features. Log-mel at 100 Hz passes a running
normalisation, a strided stem to 50 Hz, a strided step to 25 Hz, blocks that look a little ahead (`listen`),
and blocks that only look back (`perform`). Every layer sees zeros before the first frame and real sound
after the last one. So a frame depends on no sound beyond its look-ahead, wherever the sound was cut. Twin of
`rust-core/src/speech/causal.rs`.
"""

from dataclasses import dataclass, field
from pathlib import Path

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from training.nn.checkpoint import load_model, read_model
from training.nn.config import Config
from training.speech.log_mel import (
    ACTIVE_RANGE,
    BANDS,
    DEEPEST,
    FLOOR,
    FRAME,
    HOP,
    QUIETEST_LEVEL,
    SAMPLE_RATE_HZ,
    SCALE,
    log_mel,
)

MEL_PER_FRAME = 4
STEM_TAPS = 5
STEM_AHEAD = 2
TAPS = 3
DOWN_AHEAD = 1
QUANTILE = 0.95
SILENT_MEL = torch.log(torch.tensor(FLOOR)).item()


@dataclass
class Normaliser:
    """Constants of the running normalisation; levels are nepers of power, counts are mel frames.

    `prior_colour` [64] and `prior_peak` stand in for the voice until it is heard.
    """

    prior_colour: list[float] = field(default_factory=lambda: [-2.4] * BANDS)
    prior_peak: float = -1.0
    prior_frames: float = 30.0
    memory_frames: float = 1000.0
    start_frames: float = 100.0
    start_step: float = 0.3
    step: float = 0.04
    peak_over_level: float = 2.0


@dataclass
class Block:
    """A residual block: 3 taps `dilation` apart, `ahead` of them (0 or 1) after the current frame."""

    dilation: int
    ahead: int


def _blocks(*pairs: tuple[int, int]) -> list[Block]:
    return [Block(*pair) for pair in pairs]


@dataclass
class StreamConfig(Config):
    """Everything that inference needs; saved as config.json."""

    system: str = "freetalk"
    model: str = "stream"
    outputs: int = 204
    fps: float = 25.0
    bands: int = BANDS
    channels: int = 144
    fine: list[Block] = field(default_factory=lambda: _blocks((1, 1)))
    listen: list[Block] = field(default_factory=lambda: _blocks((1, 1), (1, 1), (1, 1), (3, 0)))
    perform: list[Block] = field(default_factory=lambda: _blocks((1, 0), (2, 0), (4, 0)))
    normaliser: Normaliser = field(default_factory=Normaliser)
    sooner: list[int] = field(default_factory=list)
    """Lead of each further head in frames. When the main head predicts frame t, a further head predicts
    frame t + its lead from the same sound."""

    def mel_ahead(self) -> int:
        """Number of mel frames after 4 t that frame t depends on."""
        fine = STEM_AHEAD + 2 * sum(block.ahead * block.dilation for block in self.fine)
        coarse = sum(block.ahead * block.dilation for block in self.listen)
        return fine + 2 * DOWN_AHEAD + MEL_PER_FRAME * coarse

    def look_ahead_samples(self) -> int:
        """Frame t depends on samples before 640 t + this, which includes half the last mel frame's window."""
        return HOP * self.mel_ahead() + FRAME // 2

    def look_ahead_s(self) -> float:
        """The same in seconds."""
        return self.look_ahead_samples() / SAMPLE_RATE_HZ

    def mel_rows(self, frames: int) -> int:
        """Mel frames that `frames` motion frames need."""
        return MEL_PER_FRAME * (frames - 1) + 1 + self.mel_ahead()


def debug_config() -> StreamConfig:
    """A tiny student for tests; its normaliser forgets quickly, so that it changes within a golden."""
    normaliser = Normaliser(
        prior_colour=[-3.0 + 0.05 * band for band in range(BANDS)],
        prior_frames=3.0,
        memory_frames=40.0,
        start_frames=20.0,
    )
    return StreamConfig(
        channels=20,
        listen=_blocks((1, 1), (2, 1)),
        perform=_blocks((1, 0), (3, 0)),
        normaliser=normaliser,
    )


@dataclass
class Heard:
    """State of the running normalisation for each voice: [B, 64], [B] and [B]."""

    colour: Tensor
    peak: Tensor
    frames: Tensor


def nothing_heard(config: Normaliser, count: int) -> Heard:
    """The state before any sound."""
    colour = torch.tensor(config.prior_colour).expand(count, -1).clone()
    return Heard(colour, torch.full((count,), config.prior_peak), torch.zeros(count))


def normalise_running(mel: Tensor, config: Normaliser, heard: Heard | None = None) -> Tensor:
    """Raw log-mel [B, R, 64] → input of the network; row i depends on rows 0 … i.

    The causal form of `log_mel.normalise`. The level of a frame is its mean over bands. `peak` follows
    the 95 % quantile of levels in steps: up by 0.95 or down by 0.05 of a step size, which shrinks while
    the first voice is heard. Frames at most 4 nepers below the peak, and not below −9, update the colour:
    a mean that starts from the prior and forgets after `memory_frames`. If the colour's mean is below the
    peak minus `peak_over_level`, or below −9, it is raised to that.
    """
    heard = heard or nothing_heard(config, mel.shape[0])
    levels, offsets = mel.mean(dim=2), []
    for row, level in zip(mel.unbind(1), levels.unbind(1), strict=True):
        offsets.append(_hear(heard, row, level, config))
    return (mel - torch.stack(offsets, 1)).clamp_min(DEEPEST) / SCALE


def _hear(heard: Heard, row: Tensor, level: Tensor, config: Normaliser) -> Tensor:
    """Updates the state by one mel frame of each voice. Returns the offset to subtract from it, [B, 64]."""
    fresh = (1.0 - heard.frames / config.start_frames).clamp_min(0.0)
    step = config.step + (config.start_step - config.step) * fresh
    heard.peak = heard.peak + step * torch.where(level > heard.peak, QUANTILE, QUANTILE - 1.0)
    active = (level >= (heard.peak - ACTIVE_RANGE).clamp_min(QUIETEST_LEVEL)).float()
    heard.frames = (heard.frames + active).clamp_max(config.memory_frames)
    rate = active / (heard.frames + config.prior_frames).clamp_max(config.memory_frames)
    heard.colour = heard.colour + rate[:, None] * (row - heard.colour)
    least = (heard.peak - config.peak_over_level).clamp_min(QUIETEST_LEVEL)
    return heard.colour + (least - heard.colour.mean(dim=1)).clamp_min(0.0)[:, None]


class CausalBlock(nn.Module):
    """x + mix(GELU(conv(norm(x)))) on [B, T, C]; the last `ahead · dilation` frames are dropped."""

    def __init__(self, channels: int, block: Block):
        super().__init__()
        self.block = block
        self.norm = nn.LayerNorm(channels)
        self.conv = nn.Conv1d(channels, channels, TAPS, dilation=block.dilation)
        self.mix = nn.Linear(channels, channels)

    def forward(self, x: Tensor) -> Tensor:
        """[B, T, C] → [B, T − ahead · dilation, C]; zeros stand before the first frame."""
        past = (TAPS - 1 - self.block.ahead) * self.block.dilation
        y = self.conv(F.pad(self.norm(x).transpose(1, 2), (past, 0))).transpose(1, 2)
        return x[:, : y.shape[1]] + self.mix(F.gelu(y))


class SoonerHead(nn.Module):
    """A head that predicts a later frame from the features of `hear`."""

    def __init__(self, channels: int, outputs: int):
        super().__init__()
        self.block = CausalBlock(channels, Block(dilation=1, ahead=0))
        self.norm = nn.LayerNorm(channels)
        self.head = nn.Linear(channels, outputs)

    def forward(self, x: Tensor) -> Tensor:
        """[B, T, C] → [B, T, D] in deviations from the mean."""
        return self.head(self.norm(self.block(x)))


class StreamNet(nn.Module):
    """Normalised log-mel to `outputs` numbers, such as landmark displacements in metres."""

    def __init__(self, config: StreamConfig):
        super().__init__()
        self.config = config
        channels, dims = config.channels, config.outputs
        self.stem = nn.Conv1d(config.bands, channels, STEM_TAPS, stride=2)
        self.fine = nn.ModuleList(CausalBlock(channels, block) for block in config.fine)
        self.down = nn.Conv1d(channels, channels, TAPS, stride=2)
        self.listen = nn.ModuleList(CausalBlock(channels, block) for block in config.listen)
        self.perform = nn.ModuleList(CausalBlock(channels, block) for block in config.perform)
        self.norm = nn.LayerNorm(channels)
        self.head = nn.Linear(channels, dims)
        self.sooner = nn.ModuleList(SoonerHead(channels, dims) for _ in config.sooner)
        self.register_buffer("mean", torch.zeros(dims))
        self.register_buffer("std", torch.ones(dims))

    def forward(self, mel: Tensor) -> Tensor:
        """`mel` [B, R, 64] normalised → [B, T, D].

        R is `config.mel_rows(T)`, which includes the look-ahead of the last frame.
        """
        return self.say(self.hear(mel))

    def hear(self, mel: Tensor) -> Tensor:
        """Features [B, T, C] that all heads read; `mel` as in `forward`."""
        first = self.config.mel_rows(1)
        if mel.shape[1] < first or (mel.shape[1] - first) % MEL_PER_FRAME:
            raise ValueError(f"mel frames: expected {first} + {MEL_PER_FRAME} k, got {mel.shape[1]}")
        x = F.pad(mel.transpose(1, 2), (STEM_TAPS - 1 - STEM_AHEAD, 0))
        x = F.gelu(self.stem(x)).transpose(1, 2)
        for block in self.fine:
            x = block(x)
        x = F.pad(x.transpose(1, 2), (TAPS - 1 - DOWN_AHEAD, 0))
        x = F.gelu(self.down(x)).transpose(1, 2)
        for block in self.listen:
            x = block(x)
        for block in self.perform:
            x = block(x)
        return x

    def say(self, heard: Tensor, sooner: int | None = None) -> Tensor:
        """Features [B, T, C] of `hear` → [B, T, D], by the further head `sooner` if it is given.

        Row t of a further head stands for frame t + `config.sooner[sooner]`.
        """
        said = self.head(self.norm(heard)) if sooner is None else self.sooner[sooner](heard)
        return said * self.std + self.mean


def pad_mel(mel: Tensor, rows: int) -> Tensor:
    """Raw log-mel [R, 64] cut to `rows`, or padded with silence at the end."""
    missing = max(rows - mel.shape[0], 0)
    return F.pad(mel[:rows], (0, 0, 0, missing), value=SILENT_MEL)


@torch.no_grad()
def perform(model: StreamNet, mel: Tensor, frames: int, head: int | None = None) -> Tensor:
    """The result for one whole clip, by the further head `head` if it is given.

    `mel` [R, 64] is the raw log-mel of the sound; silence follows it. Returns [T, D], T = `frames`. A
    further head hears silence before the sound, so that its first row stands for frame 0.
    """
    before = 0 if head is None else MEL_PER_FRAME * model.config.sooner[head]
    return _say(model, F.pad(mel, (0, 0, before, 0), value=SILENT_MEL), frames, head)


def _say(model: StreamNet, mel: Tensor, frames: int, head: int | None) -> Tensor:
    padded = pad_mel(mel, model.config.mel_rows(frames))[None]
    return model.say(model.hear(normalise_running(padded, model.config.normaliser)), head)[0]


def load_stream(folder: Path) -> StreamNet:
    """The finished student of a model folder, ready for inference."""
    return load_model(folder, lambda config: StreamNet(StreamConfig.from_json(config)))


def describe(model: StreamNet) -> str:
    """Parameters in millions and the look-ahead, of the main head and of each further head."""
    further = [sum(x.numel() for x in head.parameters()) / 1e6 for head in model.sooner]
    main = sum(x.numel() for x in model.parameters()) / 1e6 - sum(further)
    leads = [0.0, *(sooner / model.config.fps for sooner in model.config.sooner)]
    ahead = [1e3 * max(model.config.look_ahead_s() - lead, 0.0) for lead in leads]
    millions = " + ".join(f"{count:.2f}" for count in (main, *further))
    return f"{millions} million parameters, look-ahead {', '.join(f'{x:.1f}' for x in ahead)} ms"


def with_sooner(folder: Path, sooner: list[int]) -> StreamNet:
    """A finished student with further heads to train. All its other weights are frozen."""
    config, state = read_model(folder)
    model = StreamNet(StreamConfig.from_json(config | {"sooner": sooner}))
    model.load_state_dict(state, strict=False)
    model.requires_grad_(False)
    model.sooner.requires_grad_(True)
    return model


@torch.no_grad()
def speak(model: StreamNet, samples: Tensor, frames: int, head: int | None = None) -> Tensor:
    """Samples [S] at 16 kHz → the first `frames` frames, [T, D].

    A further head first hears silence for as long as its lead, but no longer than the look-ahead, because
    a head's own look-ahead cannot be negative.
    """
    config = model.config
    sooner = 0 if head is None else MEL_PER_FRAME * HOP * config.sooner[head]
    samples = F.pad(samples, (min(sooner, config.look_ahead_samples()), 0))
    rows = config.mel_rows(frames)
    mel = log_mel(F.pad(samples, (0, max(HOP * rows - len(samples), 0))))
    return _say(model, mel, frames, head)
