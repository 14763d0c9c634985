"""EmoFace: two branches that move a template frame by frame, and Mesh Attention that mixes them (§3).

Both encoders are outside the model, which gets their features. A speech encoder hears the content.
`training.systems.emoface.emotion_encoder` or a second speech encoder hears the emotion. Both are frozen
unless `--tune-encoders` trains them. Displacements are metres; inside the model they are divided by
`scale_m`.

Shapes: `T` frames, `V` template vertices, `D` = 3 V, `C` channels of an encoder's features, `d` width of a
branch.

Differences from the paper: its attention to the features of the same frame alone equals a linear layer, so we
use one. The level of emotion enters only the emotion branch. The paper does not print the formula of the
fusion (see `EmoFace` for ours).
"""

from dataclasses import dataclass, field

import numpy as np
import torch
import torch.nn.functional as F
from torch import Tensor, nn

from training.nn.biased_attention import BiasedSelfAttention, periodic_positions
from training.nn.config import Config, SpeechInput
from training.nn.spiral_conv import SpiralConv3D
from training.systems.emoface.emotion_encoder import HEARD_EMOTIONS

ANY_STYLE = "any"


@dataclass
class EmoFaceConfig(Config):
    """Everything that inference has to know; saved as config.json."""

    system: str = "emoface"
    model: str = "emoface"
    name: str = "compact"
    template: str = "ict"
    vertices: int = 2000
    fps: float = 25.0
    width: int = 128
    heads: int = 4
    period: int = 25
    look_back: int = 600
    channels: int = 192
    kernel: int = 18
    dilation: int = 2
    delta: int = 3
    scale_m: float = 5e-3
    fusion: str = "mesh_attention"
    speech: SpeechInput = field(default_factory=SpeechInput)
    emotion: SpeechInput | None = None
    emotion_ear: bool = False
    """Whether the emotion branch gets the mean features of the emotion that the ear hears in the voice."""
    emotion_channels: int = 13
    emotions: list[str] = field(default_factory=lambda: list(HEARD_EMOTIONS))
    styles: list[str] = field(default_factory=lambda: ["grid_s1", "facegood_zh", "emodb_de", ANY_STYLE])
    default_style: str = ANY_STYLE
    landmarks: list[int] = field(default_factory=list)


@dataclass
class Template:
    """The mesh whose vertices move: `vertices` [V, 3] metres; `triangles` [F, 3]; `landmarks` [68]."""

    vertices: np.ndarray
    triangles: np.ndarray
    landmarks: np.ndarray


class Branch(nn.Module):
    """FaceFormer's decoder with one layer: predicts the next frame from the frames before it."""

    def __init__(self, config: EmoFaceConfig):
        super().__init__()
        width, size = config.width, 3 * config.vertices
        self.period = config.period
        self.motion_in = nn.Linear(size, width)
        self.self_attn = BiasedSelfAttention(width, config.heads, config.period, config.look_back)
        self.own_frame = nn.Linear(config.channels, width)
        self.linear1, self.linear2 = nn.Linear(width, 2 * width), nn.Linear(2 * width, width)
        self.norm1, self.norm2, self.norm3 = (nn.LayerNorm(width) for _ in range(3))
        self.motion_out = nn.Linear(width, size)
        nn.init.zeros_(self.motion_out.weight)
        nn.init.zeros_(self.motion_out.bias)

    def forward(self, before: Tensor, heard: Tensor, condition: Tensor) -> Tensor:
        """Predicts each frame from the one before, [B, T, D].

        `before` [B, T, D] holds the frame before each frame; `heard` is [B, T, C], `condition` [B, T, d].
        """
        x = self._entered(before, condition, 0)
        return self._left(self.norm1(x + self.self_attn(x)), heard)

    def step(self, before: Tensor, heard: Tensor, condition: Tensor, frame: int, cache: list) -> Tensor:
        """Like `forward`, but only for frame number `frame`, [B, 1, …]."""
        x = self._entered(before, condition, frame)
        return self._left(self.norm1(x + self.self_attn.step(x, cache)), heard)

    def _entered(self, before: Tensor, condition: Tensor, frame: int) -> Tensor:
        x = self.motion_in(before) + condition
        return x + periodic_positions(frame, x.shape[1], x.shape[2], self.period).to(x)

    def _left(self, x: Tensor, heard: Tensor) -> Tensor:
        x = self.norm2(x + self.own_frame(heard))
        x = self.norm3(x + self.linear2(F.gelu(self.linear1(x))))
        return self.motion_out(x)


class MeshAttention(nn.Module):
    """Share of the emotion branch for every vertex and frame, 0 to 1 (§3.2)."""

    def __init__(self, config: EmoFaceConfig, spirals: np.ndarray):
        super().__init__()
        channels = config.channels
        self.content = nn.Linear(channels, channels // 4)
        self.emotion = nn.Linear(channels, channels // 4)
        self.joint = nn.Linear(channels // 2, channels // 16)
        self.places = nn.Parameter(0.5 * torch.randn(config.vertices, channels // 16))
        self.conv = SpiralConv3D(spirals, channels // 16, channels // 16, config.delta)
        self.out = nn.Linear(channels // 16, 1)

    def heard(self, content: Tensor, emotion: Tensor) -> Tensor:
        """F_audio: content and emotion, each [B, T, C], → [B, T, C/16]."""
        parts = F.gelu(self.content(content)), F.gelu(self.emotion(emotion))
        return F.gelu(self.joint(torch.cat(parts, dim=-1)))

    def forward(self, content: Tensor, emotion: Tensor) -> Tensor:
        """Content and emotion, each [B, T, C], → w [B, T, V]."""
        around = self.conv.of_sum(self.heard(content, emotion), self.places)
        return torch.sigmoid(self.out(F.gelu(around))[..., 0])


@dataclass
class Inputs:
    """Inputs of the model for a stretch of frames.

    `content` [B, T, speech channels], `emotion` [B, T, emotion channels], `style` [B], and `level` [B, T],
    the level of the emotion from 0 to 1.5.
    """

    content: Tensor
    emotion: Tensor
    style: Tensor
    level: Tensor


@dataclass
class FaceMotion:
    """`motion`, `content`, `emotion` [B, T, D] in units of `scale_m`; `mask` [B, T, V] is w."""

    motion: Tensor
    content: Tensor
    emotion: Tensor
    mask: Tensor


class EmoFace(nn.Module):
    """`M = w ⊙ M^e + (1 − w) ⊙ M^c`, where w comes from Mesh Attention.

    With `fusion` `sum` it is `M^c + M^e`, "w/o Mesh Attention" of table 3.
    """

    def __init__(self, config: EmoFaceConfig, spirals: np.ndarray):
        super().__init__()
        self.config = config
        self.content_in = nn.Linear(config.speech.channels, config.channels)
        self.emotion_in = nn.Linear(config.emotion_channels, config.channels)
        self.style = nn.Embedding(len(config.styles), config.width)
        self.level = nn.Parameter(0.1 * torch.randn(2, config.width))
        self.content, self.emotion = Branch(config), Branch(config)
        self.mesh_attention = MeshAttention(config, spirals)
        self.register_buffer("prototypes", torch.zeros(len(config.emotions), config.emotion_channels))

    def forward(self, before: Tensor, inputs: Inputs) -> FaceMotion:
        """`before` [B, T, D] is the frame before each frame, in units of `scale_m`."""
        content, emotion = self.content_in(inputs.content), self.emotion_in(inputs.emotion)
        plain, emotional = self._conditions(inputs)
        parts = self.content(before, content, plain), self.emotion(before, emotion, emotional)
        return self.fused(*parts, self.mesh_attention(content, emotion))

    def _conditions(self, inputs: Inputs) -> tuple[Tensor, Tensor]:
        style = self.style(inputs.style)[:, None]
        level = inputs.level[..., None]
        return style.expand(-1, level.shape[1], -1), style + (1.0 - level) * self.level[
            0
        ] + level * self.level[1]

    def fused(self, content: Tensor, emotion: Tensor, mask: Tensor) -> FaceMotion:
        """Mixes both branches [B, T, D] by the mask [B, T, V]."""
        if self.config.fusion == "sum":
            return FaceMotion(content + emotion, content, emotion, mask)
        w = mask.repeat_interleave(3, dim=-1)
        return FaceMotion(w * emotion + (1.0 - w) * content, content, emotion, mask)

    @torch.no_grad()
    def perform(self, inputs: Inputs, first: Tensor | None = None, layer: str = "motion") -> FaceMotion:
        """Predicts frame by frame from a first pose [B, D] (the template if None).

        If `layer` is `content` or `emotion`, the next frame follows from the motion of that branch alone.
        """
        content, emotion = self.content_in(inputs.content), self.emotion_in(inputs.emotion)
        plain, emotional = self._conditions(inputs)
        mask = self.mesh_attention(content, emotion)
        rows, size = inputs.style.shape[0], 3 * self.config.vertices
        before = (torch.zeros(rows, size) if first is None else first)[:, None]
        caches, frames = ([], []), []
        for t in range(content.shape[1]):
            now = slice(t, t + 1)
            frame = self.fused(self.content.step(before, content[:, now], plain[:, now], t, caches[0]),
                              self.emotion.step(before, emotion[:, now], emotional[:, now], t, caches[1]),
                              mask[:, now])  # fmt: skip
            frames.append(frame)
            before = getattr(frame, layer)
        parts = ("motion", "content", "emotion", "mask")
        return FaceMotion(*(torch.cat([getattr(f, part) for f in frames], dim=1) for part in parts))


def compact_config(vertices: int = 2000) -> EmoFaceConfig:
    """The default model."""
    styles = ["grid_s1", "grid_five", "facegood_zh", "emodb_de", ANY_STYLE]
    return EmoFaceConfig(vertices=vertices, speech=SpeechInput("ear"), styles=styles)


def debug_config(vertices: int = 90) -> EmoFaceConfig:
    """A tiny model for tests."""
    return EmoFaceConfig(
        name="debug", vertices=vertices, width=16, period=5, look_back=12, channels=32, kernel=6,
        speech=SpeechInput(channels=16), emotion_channels=8,
    )  # fmt: skip


def paper_config(vertices: int = 5023) -> EmoFaceConfig:
    """The paper's sizes: FLAME's vertices, 768 channels from each wav2vec2, 30 fps (§4, appendix A.1).

    The width is FaceFormer's.
    """
    return EmoFaceConfig(
        name="paper", template="own", vertices=vertices, fps=30.0, period=30, width=64, channels=768,
        speech=SpeechInput("wav2vec2", 768, transformer_fps=30.0), emotion_channels=768,
    )  # fmt: skip


CONFIGS = {"compact": compact_config, "debug": debug_config, "paper": paper_config}
