"""The paper's sizes train on precomputed features of 768 channels."""

import torch
from torch import nn

from training.corpus.bank import UNKNOWN, Entry
from training.corpus.features import FeatureSampler
from training.systems.freetalk.ats import paper_config
from training.systems.freetalk.train import AtsTrainer, parser
from training.tests.test_parity import SHARED, needs_shared


class RandomSpeech:
    """768 random features a frame, in place of a HuBERT checkpoint."""

    def __init__(self):
        torch.manual_seed(0)
        self.encoder = nn.Identity()
        self.entries = [self._entry(source) for source in ("grid_s1", "facegood_zh")]

    def _entry(self, source: str) -> Entry:
        motion = torch.randn(80, 204).cumsum(0) * 1e-4
        features = torch.randn(1, 80, 768).half()
        phones = torch.full((80,), UNKNOWN, dtype=torch.int16)
        return Entry(source, source, False, features, motion, torch.ones(80, 204), phones)

    def sampler(self, sources, shares, seed):
        """Windows of the two clips."""
        return FeatureSampler(self.entries, sources, shares, seed)

    def windows(self, features):
        """As they are."""
        return features

    def to(self, device):
        """Nothing to move."""


@needs_shared
def test_paper_configuration_takes_a_training_step():
    arguments = parser().parse_args(["--config", "paper", "--data", str(SHARED / "data"), "--dropout", "0"])
    trainer = AtsTrainer(arguments, paper_config(), RandomSpeech())
    loss, _ = trainer.loss(trainer.draw(1, 40))
    loss.backward()
    assert torch.isfinite(loss)
    assert trainer.model.layers[5].linear1.weight.shape == (2048, 512)
    assert all(p.grad is not None for p in trainer.model.parameters())
