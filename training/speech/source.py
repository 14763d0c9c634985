"""Sources of speech features for the denoiser's training, one class per encoder."""

from collections.abc import Iterable
from dataclasses import fields, replace

import torch
from torch import Tensor

from training.corpus import bank
from training.corpus.clip import MEL_PER_FRAME, Clip
from training.corpus.ear import EarClip
from training.corpus.features import FeatureSampler, feature_entries
from training.speech.ear import EarBody
from training.speech.hubert import HubertFeatures


class PreparedSpeech:
    """Features that are computed once, because no training changes their encoder."""

    def __init__(self, entries: list[bank.Entry]):
        self.entries = entries

    def sampler(self, sources: list[str], shares: list[float], seed: int) -> FeatureSampler:
        """A sampler of windows without augmentation of the sound."""
        return FeatureSampler(self.entries, sources, shares, seed)

    def clip(self, entry: bank.Entry) -> Tensor:
        """Features of a clip, [T, C]."""
        return entry.mels[0].float()


class EarSpeech(PreparedSpeech):
    """Features of the ear, in all voices of each clip. All systems share the ear."""

    def __init__(self, ear: EarBody, clips: Iterable[EarClip]):
        super().__init__([entry_with_features(clip, ear) for clip in clips])

    def sampler(self, sources: list[str], shares: list[float], seed: int) -> FeatureSampler:
        """A sampler of windows in all voices. Phones have one row for each frame."""
        rows = [replace(e, phones=e.phones[::MEL_PER_FRAME]) for e in self.entries]
        return FeatureSampler(rows, sources, shares, seed)


@torch.no_grad()
def entry_with_features(clip: EarClip, ear: EarBody) -> bank.Entry:
    """The clip with the ear's features [voices, T, C] in place of log-mels."""
    known = {f.name: getattr(clip, f.name) for f in fields(bank.Entry)}
    features = torch.cat([ear(voice[None]) for voice in clip.heard])
    return replace(bank.Entry(**known), mels=features.half())


class HubertSpeech(PreparedSpeech):
    """Features of a user's HuBERT or wav2vec2 checkpoint."""

    def __init__(self, features: HubertFeatures, clips: list[Clip]):
        super().__init__(feature_entries(clips, features))
