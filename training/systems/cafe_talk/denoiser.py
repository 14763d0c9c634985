"""The diffusion transformer of Cafe-Talk and its adapter for fine control (Chen et al. 2025, §3.1 and §3.2).

It differs from the paper in three ways. The coarse condition may change from frame to frame. Modulation comes
from one linear layer for all blocks and a table in each (`nn.ada_ln`): only this design fits the number of
parameters that the paper prints. A unit of the fine condition is active on the left, the right or both sides.
"""

from dataclasses import dataclass, field

import torch
from torch import Tensor, nn

from training.corpus.conditions import EMOTIONS, SIDES, UNITS
from training.corpus.faces import CHANNELS
from training.diffusion.schedule import Diffusion
from training.nn.ada_ln import PER_LAYER, AdaLn, modulated, table
from training.nn.attention import band_mask
from training.nn.config import Config, SpeechInput
from training.nn.embedding import Mlp, timestep_embedding
from training.nn.film import Film, film
from training.nn.rotary import RotaryAttention

ANY_STYLE = "any"
ADA_LAYERS, FILM_PLACES, ADAPTER_PLACES = 2, 2, 1
EVENT_KERNEL = 3


@dataclass
class Sampling:
    """Defaults of the reverse process; `alpha` and `beta` are the guidance of eq. 6."""

    steps: int = 8
    spacing: str = "trailing"
    temperature: float = 0.0
    noise_s: float = 0.0
    alpha: float = 1.0
    beta: float = 1.0


@dataclass
class CafeTalkConfig(Config):
    """Everything that inference needs; saved as config.json.

    `coarse` is how the coarse condition enters: `ada_ln`, or `film` as in the paper's table 2.
    """

    system: str = "cafe_talk"
    model: str = "denoiser"
    name: str = "compact"
    channels: list[str] = field(default_factory=lambda: list(CHANNELS))
    fps: float = 25.0
    window_frames: int = 250
    overlap_frames: int = 50
    width: int = 192
    inner: int = 96
    adapter_inner: int = 48
    blocks: int = 4
    heads: int = 4
    feedforward: int = 384
    band: int = 1
    coarse: str = "ada_ln"
    style_width: int = 32
    text_width: int = 64
    speech: SpeechInput = field(default_factory=SpeechInput)
    diffusion: Diffusion = field(default_factory=Diffusion)
    sampling: Sampling = field(default_factory=Sampling)
    emotions: list[str] = field(default_factory=lambda: list(EMOTIONS))
    units: list[str] = field(default_factory=lambda: list(UNITS))
    styles: list[str] = field(
        default_factory=lambda: ["grid_s1", "grid_five", "facegood_zh", "taught", ANY_STYLE]
    )
    default_style: str = ANY_STYLE


def compact_config() -> CafeTalkConfig:
    """The default model."""
    return CafeTalkConfig()


def paper_config() -> CafeTalkConfig:
    """Sizes of the paper: XLSR-300M, d 512, 8 blocks, 8 heads (§3.1, appendix C.1), CLIP's 512 numbers."""
    return CafeTalkConfig(
        name="paper",
        width=512,
        inner=256,
        adapter_inner=128,
        blocks=8,
        heads=8,
        feedforward=1024,
        style_width=512,
        text_width=512,
        speech=SpeechInput("wav2vec2", 1024),
        sampling=Sampling(steps=50),
    )


def debug_config() -> CafeTalkConfig:
    """A tiny model for tests."""
    return CafeTalkConfig(
        name="debug",
        window_frames=40,
        overlap_frames=8,
        width=32,
        inner=16,
        adapter_inner=8,
        blocks=2,
        heads=4,
        feedforward=48,
        style_width=8,
        speech=SpeechInput("ear", 16),
        sampling=Sampling(steps=2),
    )


CONFIGS = {"compact": compact_config, "paper": paper_config, "debug": debug_config}


@dataclass
class Coarse:
    """The coarse condition C of a batch.

    `style` [B] int. `emotion` [B, T, E]: place in the text space. `intensity` [B, T]. `has_label` [B] bool:
    where it is false, the learned null replaces the whole condition.
    """

    style: Tensor
    emotion: Tensor
    intensity: Tensor
    has_label: Tensor


class CoarseCondition(nn.Module):
    """`C_f = W [C_ts ‖ C_emo ‖ i·e_int]`, §3.1.1."""

    def __init__(self, config: CafeTalkConfig):
        super().__init__()
        self.style = nn.Embedding(len(config.styles), config.style_width)
        self.intensity = nn.Parameter(torch.randn(config.text_width) * 0.5)
        self.linear = nn.Linear(config.style_width + 2 * config.text_width, config.width)
        self.null = nn.Parameter(torch.zeros(config.width))

    def forward(self, coarse: Coarse) -> Tensor:
        """→ C_f [B, T, d]."""
        frames = coarse.emotion.shape[1]
        style = self.style(coarse.style)[:, None].expand(-1, frames, -1)
        intensity = coarse.intensity[..., None] * self.intensity
        mapped = self.linear(torch.cat([style, coarse.emotion, intensity], dim=-1))
        return torch.where(coarse.has_label[:, None, None], mapped, self.null)


class Block(nn.Module):
    """AdaLN self-attention, FiLM self-attention, FiLM cross-attention, AdaLN feed-forward (fig. 2)."""

    def __init__(self, config: CafeTalkConfig):
        super().__init__()
        width, inner, heads = config.width, config.inner, config.heads
        self.coarse_attn = RotaryAttention(width, inner, heads)
        self.self_attn = RotaryAttention(width, inner, heads)
        self.cross_attn = RotaryAttention(width, inner, heads)
        self.linear1 = nn.Linear(width, config.feedforward)
        self.linear2 = nn.Linear(config.feedforward, width)
        self.norm1 = nn.LayerNorm(width)
        self.norm2 = nn.LayerNorm(width)
        self.ada_table = table(ADA_LAYERS, width)

    def forward(self, x: Tensor, memory: Tensor, ada: Tensor, films, band: Tensor) -> Tensor:
        """`x` [B, T, d], `memory` [B, T, d], `ada` [B, T, 6, d] → the adapter's input, [B, T, d]."""
        shift, scale, gate = self._ada(ada, 0)
        y = modulated(x, shift, scale)
        x = x + gate * self.coarse_attn(y, y)
        y = self.norm1(x)
        x = film(x, self.self_attn(y, y), *films[0])
        return film(x, self.cross_attn(self.norm2(x), memory, band), *films[1])

    def feed(self, x: Tensor, ada: Tensor) -> Tensor:
        """The feed-forward layer, [B, T, d]."""
        shift, scale, gate = self._ada(ada, 1)
        y = nn.functional.gelu(self.linear1(modulated(x, shift, scale)))
        return x + gate * self.linear2(y)

    def _ada(self, ada: Tensor, layer: int):
        rows = slice(PER_LAYER * layer, PER_LAYER * (layer + 1))
        return (ada[..., rows, :] + self.ada_table[rows]).unbind(-2)


class AdapterBlock(nn.Module):
    """A FiLM self-attention layer that sees the events, and a zero convolution behind it (§3.2, fig. 3)."""

    def __init__(self, config: CafeTalkConfig):
        super().__init__()
        self.norm = nn.LayerNorm(config.width)
        self.attn = RotaryAttention(config.width, config.adapter_inner, config.heads)
        self.zero = nn.Linear(config.width, config.width)
        nn.init.zeros_(self.zero.weight)
        nn.init.zeros_(self.zero.bias)

    def forward(self, x: Tensor, events: Tensor, place: tuple[Tensor, Tensor]) -> Tensor:
        """`x` and `events` [B, T, d] → the term to add to `x`."""
        heard = self.norm(x) + events
        return self.zero(film(heard, self.attn(heard, heard), *place))


class Adapter(nn.Module):
    """Fine control beside the frozen base: maps events `F` to a condition; one block per base block."""

    def __init__(self, config: CafeTalkConfig):
        super().__init__()
        width = config.width
        self.events = nn.Linear(SIDES * len(config.units), width)
        self.spread = nn.Conv1d(width, width, EVENT_KERNEL, padding=EVENT_KERNEL // 2)
        self.film = Film(width, width, ADAPTER_PLACES)
        self.blocks = nn.ModuleList(AdapterBlock(config) for _ in range(config.blocks))

    def condition(self, events: Tensor) -> Tensor:
        """Active units [B, T, 2·16] (left, then right) → [B, T, d]; 0 from two frames off any event."""
        active = events.any(dim=-1, keepdim=True).to(events.dtype)
        heard = nn.functional.silu(self.events(events)) * active
        near = nn.functional.max_pool1d(active.transpose(1, 2), EVENT_KERNEL, 1, EVENT_KERNEL // 2)
        return self.spread(heard.transpose(1, 2)).transpose(1, 2) * near.transpose(1, 2)


class Denoiser(nn.Module):
    """`M̂₀ = G(M_τ; τ, A, C, F)`, eq. 3. Without events only the base model runs."""

    def __init__(self, config: CafeTalkConfig):
        super().__init__()
        self.config = config
        width = config.width
        self.x_proj = nn.Linear(len(config.channels), width)
        self.mem_proj = nn.Linear(config.speech.channels, width)
        self.null_speech = nn.Parameter(torch.zeros(width))
        self.time_mlp = Mlp(width, width, width)
        self.coarse = CoarseCondition(config)
        self.ada = AdaLn(width, width, ADA_LAYERS)
        self.film = Film(width, width, FILM_PLACES)
        self.blocks = nn.ModuleList(Block(config) for _ in range(config.blocks))
        self.norm = nn.LayerNorm(width)
        self.head = nn.Linear(width, len(config.channels))
        self.adapter = Adapter(config)
        self.register_buffer("mean", torch.zeros(len(config.channels)))
        self.register_buffer("std", torch.ones(len(config.channels)))

    def base_parameters(self) -> list[nn.Parameter]:
        """The parameters that stage 1 trains: all except the adapter's."""
        return [p for name, p in self.named_parameters() if not name.startswith("adapter.")]

    def forward(
        self,
        noisy: Tensor,
        timestep: Tensor,
        speech: Tensor,
        coarse: Coarse,
        speech_given: Tensor,
        events: Tensor | None = None,
    ) -> Tensor:
        """One pass in standardised space.

        `noisy` [B, T, 51], `timestep` [B] int, `speech` [B, T, C] at the motion's frame rate,
        `speech_given` [B] bool, `events` [B, T, 32], or None to run the base alone. Returns x̂₀ [B, T, 51].
        """
        if speech.shape[1] != noisy.shape[1]:
            raise ValueError(f"speech frames: expected {noisy.shape[1]}, got {speech.shape[1]}")
        time = self.time_mlp(timestep_embedding(timestep, self.config.width))
        condition = self.coarse(coarse)
        films = self.film(time if self.config.coarse == "ada_ln" else time + condition.mean(dim=1))
        ada = self.ada(condition if self.config.coarse == "ada_ln" else torch.zeros_like(condition))
        memory = torch.where(speech_given[:, None, None], self.mem_proj(speech), self.null_speech)
        band = band_mask(noisy.shape[1], noisy.shape[1], self.config.band, noisy.device)
        fine = None if events is None else (self.adapter.condition(events), self.adapter.film(time)[0])
        x = self.x_proj(noisy)
        for block, beside in zip(self.blocks, self.adapter.blocks, strict=True):
            x = block(x, memory, ada, films, band)
            if fine is not None:
                x = x + beside(x, *fine)
            x = block.feed(x, ada)
        return self.head(self.norm(x))

    def standardise(self, weights: Tensor) -> Tensor:
        """Weights [..., 51] → the model's space."""
        return (weights - self.mean) / self.std

    def to_weights(self, x: Tensor) -> Tensor:
        """The model's space → weights."""
        return x * self.std + self.mean
