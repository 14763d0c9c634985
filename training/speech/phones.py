"""Reads from the ear's features which phone is heard when, at 100 frames a second.

Twin of `rust-core/src/speech/phones.rs`. Frame t of the encoder is at t / 25 s. Row 4 t + j of the posteriors
is at (4 t + j − 2) / 100 s, so the four rows of a frame lie from 20 ms before it to 10 ms after it.
"""

from dataclasses import dataclass, field

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from training.corpus.phones import PAUSE, SEGMENTS
from training.nn.config import Config

PARTS = 4
"""Number of rows of posteriors for each frame of the encoder."""

CLASSES = {
    PAUSE: PAUSE,
    "i": "iɨ",
    "ɪ": "ɪ",
    "y": "yʏʉɥ",
    "u": "uɯ",
    "ʊ": "ʊ",
    "e": "eɘ",
    "ɛ": "ɛ",
    "ø": "øœɵɞ",
    "ə": "əɤ",
    "ɝ": "ɜɚɝ",
    "o": "o",
    "ɔ": "ɔɒ",
    "ʌ": "ʌɐ",
    "a": "a",
    "ɑ": "ɑ",
    "æ": "æ",
    "p": "p",
    "b": "bʙ",
    "m": "mɱ",
    "f": "fɸ",
    "v": "vβʋ",
    "w": "wʍ",
    "t": "tʈcʔ",
    "d": "dɖɟ",
    "n": "nɳɲ",
    "θ": "θ",
    "ð": "ð",
    "s": "sɬ",
    "z": "z",
    "ʃ": "ʃʂɕ",
    "ʒ": "ʒʐʑ",
    "l": "lɫɭʎ",
    "r": "rɾɽ",
    "ɹ": "ɹɻ",
    "j": "jʝ",
    "k": "kq",
    "ɡ": "ɡɢ",
    "ŋ": "ŋ",
    "x": "xχçħ",
    "ʁ": "ʁʀɣʕ",
    "h": "hɦ",
}
"""The sign of each phone class, and the segments that belong to the class."""

COARSE = (
    "_", "iɪjy", "uʊw", "eɛ", "øəɝʌ", "oɔ", "aɑæ", "pb", "m", "fv", "td", "n", "θðsz", "ʃʒ", "l", "rɹʁ",
    "kɡxh", "ŋ",
)  # fmt: skip
"""A smaller set of classes. Each text lists the signs of the classes that it merges into one."""


def class_of_segment() -> Tensor:
    """Class of every index into `SEGMENTS`, [len(SEGMENTS)]."""
    class_of = {segment: index for index, kinds in enumerate(CLASSES.values()) for segment in kinds}
    return torch.tensor([class_of[segment] for segment in SEGMENTS])


@dataclass
class PhoneConfig(Config):
    """Sizes of the read-out, the encoder that it reads, and the signs of its classes."""

    model: str = "phones"
    encoder: str = "ear"
    channels: int = 192
    hidden: int = 128
    phones: list[str] = field(default_factory=lambda: list(CLASSES))


class PhoneReadout(nn.Module):
    """Features [B, T, C] of the frozen encoder → log-posteriors [B, 4 T, K]."""

    def __init__(self, config: PhoneConfig):
        super().__init__()
        self.config = config
        self.conv = nn.Conv1d(config.channels, config.hidden, 3, padding=1)
        self.out = nn.Linear(config.hidden, PARTS * len(config.phones))
        self.register_buffer("log_prior", torch.zeros(len(config.phones)))

    def forward(self, features: Tensor) -> Tensor:
        """Features beyond both ends count as zeros."""
        hidden = F.gelu(self.conv(features.transpose(1, 2)).transpose(1, 2))
        return self.out(hidden).unflatten(-1, (PARTS, -1)).flatten(1, 2).log_softmax(dim=-1)
