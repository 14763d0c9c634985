"""Training windows from precomputed speech features instead of log-mels (HuBERT)."""

from collections.abc import Callable

import torch
from torch import Tensor

from training.corpus.bank import UNKNOWN, Entry, entry_of
from training.corpus.clip import Clip
from training.corpus.windows import AugmentOptions, WindowSampler

Encode = Callable[[Tensor, int], Tensor]


class FeatureSampler(WindowSampler):
    """Like `WindowSampler`, but `mels` holds one feature row per motion frame.

    Only the tempo is augmented, because the options for voices and rooms have no meaning here.
    """

    per_frame = 1

    def __init__(self, entries: list[Entry], sources: list[str], shares: list[float], seed: int):
        options = AugmentOptions(as_recorded_share=0.0, tempo_octaves=0.2, silent_share=0.0)
        super().__init__(entries, sources, shares, seed, options)

    def _prepare(self, mel: Tensor, colour: Tensor, bare: bool) -> Tensor:
        return mel


def feature_entries(clips: list[Clip], encode: Encode) -> list[Entry]:
    """Entries of all clips with `encode(samples, frames)` [T, C] as their speech."""
    entries = []
    for clip in clips:
        features = encode(torch.from_numpy(clip.samples), len(clip.motion))
        phones = torch.full((len(clip.motion),), UNKNOWN, dtype=torch.int16)
        entries.append(entry_of(clip, features[None], phones))
    return entries
