"""Speech to expression codes: a transformer decoder that predicts clean codes (§4, fig. 2; eq. 2 to 10).

Differences from the paper: the norm comes before each sublayer, and FiLM modulates the sublayer's output
(`nn.film`). Positions are rotary. A row attends to itself and to the `look_back_frames` − 1 rows before it.
So a sound of any length can be sampled at once, in the same way as training windows. The augmentation r of
eq. 8 is an input of the model, so artists can control it.
"""

from dataclasses import dataclass, field

import torch
from torch import Tensor, nn

from training.diffusion.ddim import ddim_sample
from training.diffusion.guidance import guided
from training.diffusion.schedule import Diffusion
from training.nn.attention import band_mask
from training.nn.config import Config, SpeechInput
from training.nn.embedding import timestep_embedding
from training.nn.film import Film, film
from training.nn.rotary import RotaryAttention

PLACES = 3
LANDMARKS = "landmarks"
"""Names the input of a model that follows landmarks instead of speech: their motion, [T, 204] centimetres."""
CM = 100.0


@dataclass
class Sampling:
    """Defaults of the reverse process; guidance is w of eq. 10, vividness r of eq. 8."""

    steps: int = 10
    spacing: str = "trailing"
    temperature: float = 1.0
    guidance: float = 1.5
    vividness: float = 1.0


@dataclass
class MotionConfig(Config):
    """Everything that inference has to know; stored as `motion` in config.json."""

    codes: int = 64
    fps: float = 25.0
    width: int = 192
    inner: int = 192
    blocks: int = 4
    heads: int = 4
    feedforward: int = 384
    band: int = 0
    look_back_frames: int = 48
    film: bool = True
    direct: bool = False
    speech: SpeechInput = field(default_factory=SpeechInput)
    diffusion: Diffusion = field(default_factory=Diffusion)
    sampling: Sampling = field(default_factory=Sampling)


def landmark_config(codes: int) -> MotionConfig:
    """The model that follows the motion of 68 landmarks instead of speech (the paper's conclusion).

    This motion nearly determines the codes, so the model is small, starts without noise and has no guidance.
    A linear layer adds the landmarks' motion directly to the output. It starts as the best linear map.
    """
    return MotionConfig(
        codes=codes, width=32, inner=32, blocks=2, heads=4, feedforward=32, look_back_frames=12,
        direct=True, speech=SpeechInput(LANDMARKS, 204),
        sampling=Sampling(steps=4, temperature=0.0, guidance=1.0),
    )  # fmt: skip


def paper_config() -> MotionConfig:
    """What the paper prints: 1,000 steps of a cosine schedule from full noise, and masks of eq. 6 and 7.

    It prints no width, no number of blocks or heads and no guidance weight. These are ours, about as large as
    FaceFormer's. Frames stay at 25 a second, where its corpus has 24.
    """
    return MotionConfig(
        width=512, inner=512, blocks=8, heads=8, feedforward=2048,
        sampling=Sampling(steps=1000, temperature=1.0),
    )  # fmt: skip


def debug_config() -> MotionConfig:
    """Sizes small enough for a golden."""
    return MotionConfig(
        codes=5,
        width=16,
        inner=16,
        blocks=2,
        heads=2,
        feedforward=24,
        look_back_frames=6,
        direct=True,
        speech=SpeechInput("ear", 16),
        sampling=Sampling(steps=4, temperature=0.5),
    )


class Time(nn.Module):
    """MLP of three layers on the sinusoids of the timestep."""

    def __init__(self, width: int):
        super().__init__()
        self.linear1, self.linear2, self.linear3 = (nn.Linear(width, width) for _ in range(3))

    def forward(self, x: Tensor) -> Tensor:
        """[B, d] → [B, d]."""
        silu = nn.functional.silu
        return self.linear3(silu(self.linear2(silu(self.linear1(x)))))


class Block(nn.Module):
    """Self-attention, cross-attention and feed-forward, each followed by FiLM."""

    def __init__(self, config: MotionConfig):
        super().__init__()
        width = config.width
        self.self_attn = RotaryAttention(width, config.inner, config.heads)
        self.cross_attn = RotaryAttention(width, config.inner, config.heads)
        self.linear1, self.linear2 = (
            nn.Linear(width, config.feedforward),
            nn.Linear(config.feedforward, width),
        )
        self.norm1, self.norm2, self.norm3 = (nn.LayerNorm(width) for _ in range(PLACES))

    def forward(self, x: Tensor, memory: Tensor, films, behind: Tensor, band: Tensor) -> Tensor:
        """`x`, `memory` [B, T, d]; masks [T, T]."""
        y = self.norm1(x)
        x = film(x, self.self_attn(y, y, behind), *films[0])
        x = film(x, self.cross_attn(self.norm2(x), memory, band), *films[1])
        y = self.linear2(nn.functional.gelu(self.linear1(self.norm3(x))))
        return film(x, y, *films[2])


class Denoiser(nn.Module):
    """x̂₀ = D(x_t; t, speech, r) in standardised codes."""

    def __init__(self, config: MotionConfig):
        super().__init__()
        self.config = config
        width = config.width
        self.x_proj, self.mem_proj = nn.Linear(config.codes, width), nn.Linear(config.speech.channels, width)
        self.null_speech = nn.Parameter(torch.zeros(width))
        self.time, self.vividness = Time(width), nn.Linear(1, width)
        self.film = Film(width, width, PLACES * config.blocks)
        self.blocks = nn.ModuleList(Block(config) for _ in range(config.blocks))
        self.norm, self.head = nn.LayerNorm(width), nn.Linear(width, config.codes)
        self.direct = nn.Linear(config.speech.channels, config.codes) if config.direct else None
        self.register_buffer("mean", torch.zeros(config.codes))
        self.register_buffer("std", torch.ones(config.codes))

    def forward(
        self, noisy: Tensor, timestep: Tensor, speech: Tensor, has_speech: Tensor, r: Tensor
    ) -> Tensor:
        """`noisy` [B, T, X], `timestep` [B], `speech` [B, T, C], `has_speech` [B] bool, `r` [B] → x̂₀."""
        frames = noisy.shape[1]
        if speech.shape[1] != frames:
            raise ValueError(f"speech frames: expected {frames}, got {speech.shape[1]}")
        condition = self.time(timestep_embedding(timestep, self.config.width)) + self.vividness(
            r[:, None] - 1.0
        )
        films = self.film(condition if self.config.film else torch.zeros_like(condition))
        memory = torch.where(has_speech[:, None, None], self.mem_proj(speech), self.null_speech)
        rows = torch.arange(frames, device=noisy.device)
        back = rows[:, None] - rows
        behind = (back >= 0) & (back < self.config.look_back_frames)
        band = band_mask(frames, frames, self.config.band, noisy.device)
        x = self.x_proj(noisy)
        if not self.config.film:
            x = x + condition[:, None]
        for number, block in enumerate(self.blocks):
            x = block(x, memory, films[PLACES * number : PLACES * (number + 1)], behind, band)
        clean = self.head(self.norm(x))
        if self.direct is None:
            return clean
        return clean + torch.where(has_speech[:, None, None], self.direct(speech), 0.0)

    @torch.no_grad()
    def begin_direct(self, memory: Tensor, codes: Tensor) -> None:
        """Sets the direct layer to the least-squares map from memory [N, C] to codes [N, X].

        Sets the output layer to 0, so that the blocks add nothing yet.
        """
        inputs = torch.cat([memory, torch.ones(len(memory), 1)], 1)
        solution = torch.linalg.lstsq(inputs, self.standardise(codes)).solution
        self.direct.weight.copy_(solution[:-1].T)
        self.direct.bias.copy_(solution[-1])
        nn.init.zeros_(self.head.weight)
        nn.init.zeros_(self.head.bias)

    @torch.no_grad()
    def go_on_from(self, other: "Denoiser") -> None:
        """Takes the weights of a model of the same size. It keeps its own mean and deviation of the codes.

        The first and the last layer change with them, so that the same noisy codes give the same clean ones.
        """
        mean, std = self.mean.clone(), self.std.clone()
        self.load_state_dict(other.state_dict())
        scale, shift = std / self.std, (mean - self.mean) / self.std
        self.x_proj.bias += self.x_proj.weight @ shift
        self.x_proj.weight *= scale
        outputs = [self.head] if self.direct is None else [self.head, self.direct]
        for layer in outputs:
            layer.weight /= scale[:, None]
            layer.bias /= scale
        self.head.bias -= shift / scale
        self.mean.copy_(mean)
        self.std.copy_(std)

    def standardise(self, codes: Tensor) -> Tensor:
        """z_ex [..., X] → the model's space."""
        return (codes - self.mean) / self.std

    def to_codes(self, x: Tensor) -> Tensor:
        """The model's space → z_ex."""
        return x * self.std + self.mean


@torch.no_grad()
def sample_from(model: Denoiser, noise: Tensor, speech: Tensor, sampling: Sampling | None = None) -> Tensor:
    """Samples z_ex [T, X] of a whole sound from unit noise [T, X], on the model's device.

    `speech` is [T, C].
    """
    config, sampling, device = model.config, sampling or model.config.sampling, model.mean.device
    noise, speech = noise.to(device), speech.to(device)
    alphas = config.diffusion.alphas()
    yes, no = torch.tensor([True], device=device), torch.tensor([False], device=device)
    r = torch.tensor([sampling.vividness], device=device)

    def predict(x: Tensor, t: int) -> Tensor:
        step = torch.tensor([t], device=device)
        heard = model(x, step, speech[None], yes, r)
        if sampling.guidance == 1.0:
            return heard
        return guided(model(x, step, speech[None], no, r), heard, sampling.guidance)

    start = sampling.temperature * noise[None]
    return model.to_codes(ddim_sample(predict, start, alphas, sampling.steps, sampling.spacing)[0])


def sample(model: Denoiser, speech: Tensor, seed: int = 0, sampling: Sampling | None = None) -> Tensor:
    """Samples z_ex [T, X] for speech features [T, C]."""
    generator = torch.Generator().manual_seed(seed)
    noise = torch.randn(len(speech), model.config.codes, generator=generator)
    return sample_from(model, noise, speech, sampling)
