"""Sources of speech features for the denoiser's training, one class per encoder."""

import copy
from collections.abc import Iterable
from dataclasses import fields, replace

import torch
from torch import Tensor, nn

from training.corpus import bank
from training.corpus.clip import MEL_PER_FRAME, Clip
from training.corpus.ear import EarClip
from training.corpus.features import FeatureSampler, feature_entries
from training.corpus.windows import AugmentOptions, WindowSampler
from training.speech.compact import CompactEncoder, normalise
from training.speech.ear import EarBody
from training.speech.hubert import HubertFeatures


class CompactSpeech:
    """Runs log-mels in several voices through the compact encoder, frozen unless training tunes it."""

    def __init__(self, encoder: CompactEncoder, entries: list[bank.Entry]):
        self.encoder = encoder.eval().requires_grad_(False)
        self.entries = entries

    def using(self, encoder: CompactEncoder) -> "CompactSpeech":
        """The same clips through another encoder."""
        other = copy.copy(self)
        other.encoder = encoder.eval()
        return other

    def sampler(self, sources: list[str], shares: list[float], seed: int) -> WindowSampler:
        """A sampler of windows with augmentation."""
        return WindowSampler(self.entries, sources, shares, seed, AugmentOptions())

    def windows(self, mel: Tensor) -> Tensor:
        """`mel` [B, 4 T, 64] of a batch → features [B, T, C]."""
        return self.encoder(mel)

    def clip(self, entry: bank.Entry) -> Tensor:
        """Features of a clip in its own voice, [T, C]."""
        mel = normalise(entry.mels[0].float())[None]
        return self.encoder(mel.to(self.encoder.norm.weight.device))[0].cpu()

    def to(self, device: str) -> None:
        """Moves the encoder."""
        self.encoder.to(device)

    def saved(self) -> dict:
        """State of the encoder for a checkpoint."""
        state = {k: v.cpu() for k, v in self.encoder.state_dict().items()}
        return {"encoder": state, "encoder_config": self.encoder.config.to_json()}


class PreparedSpeech:
    """Features that are computed once, because no training changes their encoder."""

    def __init__(self, entries: list[bank.Entry]):
        self.encoder, self.entries = nn.Identity(), entries

    def using(self, encoder: nn.Module) -> "PreparedSpeech":
        """Returns itself, since the encoder is not trained."""
        return self

    def sampler(self, sources: list[str], shares: list[float], seed: int) -> FeatureSampler:
        """A sampler of windows without augmentation of the sound."""
        return FeatureSampler(self.entries, sources, shares, seed)

    def windows(self, features: Tensor) -> Tensor:
        """Returns `features` [B, T, C] unchanged."""
        return features

    def clip(self, entry: bank.Entry) -> Tensor:
        """Features of a clip, [T, C]."""
        return entry.mels[0].float()

    def to(self, device: str) -> None:
        """Nothing to move."""

    def saved(self) -> dict:
        """Nothing, since the encoder has a folder of its own."""
        return {"encoder": None, "encoder_config": None}


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
