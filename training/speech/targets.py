"""The speech encoder's second training target beside motion: the phone of every frame."""

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from training.corpus.clip import MEL_PER_FRAME
from training.corpus.phones import SEGMENTS


class PhoneHead(nn.Module):
    """A linear read-out of the encoder's features and its loss. It is not shipped."""

    def __init__(self, channels: int):
        super().__init__()
        self.readout = nn.Linear(channels, len(SEGMENTS))

    def loss(self, features: Tensor, phones: Tensor) -> Tensor:
        """`features` [B, T, C], `phones` [B, 4 T] segments (−1 unknown). Mean over rows without −1."""
        known = (phones >= 0).all(dim=1)
        if not known.any():
            return features.sum() * 0.0
        logits = self.readout(features[known]).float()
        around = windows_of(phones[known].long())
        targets = F.one_hot(around, len(SEGMENTS)).float().mean(dim=2)
        return -(targets * logits.log_softmax(dim=-1)).sum(dim=-1).mean()


def windows_of(phones: Tensor) -> Tensor:
    """The four mel frames around each motion frame, [B, 4 T] → [B, T, 4]."""
    half = MEL_PER_FRAME // 2
    padded = torch.cat([phones[:, :1].expand(-1, half), phones], dim=1)[:, : phones.shape[1]]
    return padded.unflatten(1, (-1, MEL_PER_FRAME))
