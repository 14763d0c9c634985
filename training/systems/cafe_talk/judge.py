"""A judge that tells which of the fifteen emotions weights [T, 51] show (Cafe-Talk, appendix D.2).

It has an MLP, a `cls` token, positions, one transformer layer with 8 heads, and two heads on the token, for
the emotion and for its strength. It learns from recorded speech with added emotions and judges other clips.
`Acc` is the share of clips whose emotion it reads correctly, `Div` the deviation of its features over clips,
`read` the mean strength that it reads in clips that are not neutral.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor, nn

from training.corpus.bank import Entry
from training.corpus.conditions import EMOTIONS
from training.corpus.emotion_weights import with_emotion
from training.corpus.faces import CHANNELS
from training.nn.embedding import timestep_embedding
from training.run import downhill
from training.systems.cafe_talk.train import lips_met

WIDTH, HEADS = 64, 8
WINDOW_FRAMES = 50
BATCH, RATE = 64, 2e-3
INTENSITIES = (0.0, 1.5)
"""Lowest and highest intensity of the emotions that the judge learns from."""
TOO_WEAK = 0.25
"""Below this intensity a window teaches only its strength, not which emotion it shows."""
STRENGTH_SHARE = 1.0
"""Loss weight of the squared error of the strength. The cross-entropy of the emotion weighs 1."""


class Judge(nn.Module):
    """Weights [B, T, 51] → scores of the fifteen emotions [B, 15], and their strength [B]."""

    def __init__(self):
        super().__init__()
        self.mlp = nn.Sequential(nn.Linear(len(CHANNELS), WIDTH), nn.GELU(), nn.Linear(WIDTH, WIDTH))
        self.cls = nn.Parameter(torch.zeros(WIDTH))
        self.layer = nn.TransformerEncoderLayer(WIDTH, HEADS, 2 * WIDTH, 0.1, batch_first=True)
        self.head = nn.Linear(WIDTH, len(EMOTIONS))
        self.strength = nn.Linear(WIDTH, 1)

    def features(self, weights: Tensor) -> Tensor:
        """Features [B, d] of the token for weights [B, T, 51]."""
        x = self.mlp(weights)
        x = torch.cat([self.cls.expand(len(x), 1, -1), x], dim=1)
        return self.layer(x + timestep_embedding(torch.arange(x.shape[1]), WIDTH))[:, 0]

    def forward(self, weights: Tensor) -> tuple[Tensor, Tensor]:
        """[B, T, 51] → [B, 15], [B]."""
        features = self.features(weights)
        return self.head(features), self.strength(features)[:, 0]

    @torch.no_grad()
    def verdict(self, weights: Tensor) -> tuple[int, Tensor, float]:
        """Number of the emotion of a clip [T, 51], features [d] and strength: means over windows of 2 s."""
        count = max(len(weights) // WINDOW_FRAMES, 1)
        windows = weights[: count * WINDOW_FRAMES].unflatten(0, (count, -1))
        scores, strength = self(windows)
        emotion = int(scores.mean(dim=0).argmax())
        return emotion, self.features(windows).mean(dim=0), float(strength.mean())


def under_emotion(weights: Tensor, emotion: int, intensity: float) -> Tensor:
    """Recorded speech [T, 51] with an added emotion, computed in the same way as the model's targets."""
    rows = torch.zeros(len(weights), len(EMOTIONS))
    rows[:, emotion] = 1.0
    return with_emotion(weights, rows, torch.full((len(weights),), intensity), lips_met(weights))


def taught(lessons: list[Entry], steps: int, seed: int = 0) -> Judge:
    """Trains a judge on windows of `lessons`; clips shorter than 2 s are left out."""
    usable = [e.motion.float() for e in lessons if len(e.motion) >= WINDOW_FRAMES]
    if not usable:
        count = len(lessons)
        raise ValueError(f"judge: expected clips of {WINDOW_FRAMES} frames or more, got none in {count}")
    random = np.random.default_rng(seed)
    with torch.random.fork_rng():
        torch.manual_seed(seed)
        judge = Judge()
        optimiser = torch.optim.AdamW(judge.parameters(), RATE, weight_decay=0.02)
        schedule = torch.optim.lr_scheduler.OneCycleLR(optimiser, RATE, steps + 1)
        for _ in range(steps):
            shown, label, strength = _batch(usable, random)
            scores, read = judge(shown)
            clear = strength >= TOO_WEAK
            loss = nn.functional.cross_entropy(scores[clear], label[clear])
            felt_at_all = label != EMOTIONS.index("neutral")
            off = (read - strength)[felt_at_all].square().mean()
            downhill(loss + STRENGTH_SHARE * off, optimiser, schedule)
    return judge.eval()


def _batch(usable: list[Tensor], random: np.random.Generator) -> tuple[Tensor, Tensor, Tensor]:
    labels = random.integers(0, len(EMOTIONS), BATCH)
    strengths = random.uniform(*INTENSITIES, BATCH)
    rows = []
    for label, strength in zip(labels, strengths, strict=True):
        clip = usable[random.integers(len(usable))]
        first = int(random.integers(0, len(clip) - WINDOW_FRAMES + 1))
        window = clip[first : first + WINDOW_FRAMES]
        rows.append(under_emotion(window, int(label), float(strength)))
    return torch.stack(rows), torch.from_numpy(labels), torch.from_numpy(strengths).float()


@dataclass
class Verdicts:
    """The judge's answers on takes: numbers of the true and of the read emotions, [N] each, features [N, d]
    and strength [N]."""

    true_emotions: np.ndarray
    read_emotions: np.ndarray
    features: Tensor
    strength: np.ndarray

    def scores(self, rows: np.ndarray | None = None, truth: int | None = None) -> dict[str, float]:
        """Acc and Div over `rows` (all if None). With `truth` every take counts against that one emotion."""
        rows = np.ones(len(self.true_emotions), bool) if rows is None else rows
        targets = self.true_emotions if truth is None else np.full(len(self.true_emotions), truth)
        spread = self.features[torch.from_numpy(rows)].std(dim=0).mean()
        emotional = rows & (self.true_emotions != EMOTIONS.index("neutral"))
        read = float(self.strength[emotional].mean()) if emotional.any() else 0.0
        return {
            "Acc": float((self.read_emotions == targets)[rows].mean()),
            "Div": float(spread),
            "read": read,
        }


def judged(judge: Judge, makes: Callable[[int, int], Tensor], count: int) -> Verdicts:
    """Verdicts on `makes(clip, emotion)` [T, 51], over `count` clips and all emotions."""
    true_emotions = [(clip, emotion) for clip in range(count) for emotion in range(len(EMOTIONS))]
    each = [judge.verdict(makes(clip, emotion)) for clip, emotion in true_emotions]
    read_emotions, features, strength = zip(*each, strict=True)
    true_emotions = np.array([emotion for _, emotion in true_emotions])
    return Verdicts(true_emotions, np.array(read_emotions), torch.stack(features), np.array(strength))
