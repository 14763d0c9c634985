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


class EarSpeech:
    """Features of the ear, computed once in all voices. The ear is frozen: all systems share it."""

    def __init__(self, ear: EarBody, clips: Iterable[EarClip]):
        self.ear, self.encoder = ear, nn.Identity()
        self.entries = [entry_with_features(clip, ear) for clip in clips]

    def using(self, encoder: nn.Module) -> "EarSpeech":
        """Returns itself, since the ear is not trained."""
        return self

    def sampler(self, sources: list[str], shares: list[float], seed: int) -> FeatureSampler:
        """A sampler of windows in all voices, without augmentation of the sound."""
        rows = [replace(e, phones=e.phones[::MEL_PER_FRAME]) for e in self.entries]
        return FeatureSampler(rows, sources, shares, seed)

    def windows(self, features: Tensor) -> Tensor:
        """Returns `features` [B, T, C] unchanged."""
        return features

    def clip(self, entry: bank.Entry) -> Tensor:
        """Features of a clip, [T, C]."""
        return entry.mels[0].float()

    def to(self, device: str) -> None:
        """Nothing to move."""

    def saved(self) -> dict:
        """Nothing, since the ear has a model folder of its own."""
        return {"encoder": None, "encoder_config": None}


@torch.no_grad()
def entry_with_features(clip: EarClip, ear: EarBody) -> bank.Entry:
    """The clip with the ear's features [voices, T, C] in place of log-mels."""
    known = {f.name: getattr(clip, f.name) for f in fields(bank.Entry)}
    features = torch.cat([ear(voice[None]) for voice in clip.heard])
    return replace(bank.Entry(**known), mels=features.half())


class HubertSpeech:
    """Features of a user's HuBERT or wav2vec2 checkpoint, computed once."""

    def __init__(self, features: HubertFeatures, clips: list[Clip]):
        self.encoder = nn.Identity()
        self.entries = feature_entries(clips, features)

    def using(self, encoder: nn.Module) -> "HubertSpeech":
        """Returns itself, since the checkpoint is not trained."""
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
        """Nothing, since the checkpoint belongs to the user."""
        return {"encoder": None, "encoder_config": None}
