"""What the speech encoder is asked beside motion: frame phones, CTC or articulatory features."""

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from training.corpus.clip import MEL_PER_FRAME
from training.corpus.phones import FEATURES, SEGMENTS, feature_table

TARGETS = ("none", "phones", "ctc", "features")
IMPORTANCE = {"closed": 4.0, "labiodental": 3.0, "round": 2.0, "silence": 2.0, "open": 2.0}


class PhoneHead(nn.Module):
    """A linear read-out of the encoder's features and its loss; nothing of it is shipped."""

    def __init__(self, kind: str, channels: int):
        super().__init__()
        self.kind = kind
        outputs = {"none": 1, "phones": len(SEGMENTS), "ctc": len(SEGMENTS) + 1, "features": len(FEATURES)}
        self.readout = nn.Linear(channels, outputs[kind])
        self.register_buffer("table", torch.from_numpy(feature_table()), persistent=False)
        weight = torch.tensor([IMPORTANCE.get(f, 1.0) for f in FEATURES])
        self.register_buffer("importance", weight / weight.mean(), persistent=False)

    def loss(self, features: Tensor, phones: Tensor) -> Tensor:
        """`features` [B, T, C], `phones` [B, 4 T] segments (−1 unknown); mean over known rows."""
        known = (phones >= 0).all(dim=1)
        if self.kind == "none" or not known.any():
            return features.sum() * 0.0
        logits, phones = self.readout(features[known]).float(), phones[known].long()
        if self.kind == "ctc":
            return self._ctc(logits, phones)
        around = windows_of(phones)
        if self.kind == "phones":
            wanted = F.one_hot(around, len(SEGMENTS)).float().mean(dim=2)
            return -(wanted * logits.log_softmax(dim=-1)).sum(dim=-1).mean()
        wanted = self.table[around].mean(dim=2)
        loss = F.binary_cross_entropy_with_logits(logits, wanted, reduction="none")
        return 2.0 * (loss * self.importance).mean()

    def _ctc(self, logits: Tensor, phones: Tensor) -> Tensor:
        """Connectionist temporal classification (Graves et al. 2006) of the segment sequence."""
        rows = [torch.unique_consecutive(row) + 1 for row in phones]
        lengths = torch.tensor([len(row) for row in rows])
        frames = torch.full((len(rows),), logits.shape[1])
        log_p = logits.log_softmax(dim=-1).transpose(0, 1)
        return F.ctc_loss(log_p, torch.cat(rows), frames, lengths, zero_infinity=True) / 2.0


def windows_of(phones: Tensor) -> Tensor:
    """The four mel frames around each motion frame, [B, 4 T] → [B, T, 4]."""
    half = MEL_PER_FRAME // 2
    padded = torch.cat([phones[:, :1].expand(-1, half), phones], dim=1)[:, : phones.shape[1]]
    return padded.unflatten(1, (-1, MEL_PER_FRAME))
