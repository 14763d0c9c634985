"""Training rows of EmoFace: stretches of speech with their own emotion or another recording's."""

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from training.corpus.conditions import EMOTIONS
from training.corpus.emotion_weights import with_emotion
from training.corpus.windows import interpolate
from training.systems.emoface.model import ANY_STYLE, EmoFaceConfig, Inputs

NEUTRAL = "neutral"
NEUTRAL_SHARE = 0.45
"""Share of neutral speech that stays neutral. The rest takes the emotion of another recording."""
OWN_SHARE = 0.5
"""Share of acted speech that keeps its own emotion (eq. 7). The rest are crossed pairs (eq. 8)."""
CHANGING_SHARE = 0.25
LEVEL_ONE_SHARE, HIGHEST_LEVEL = 0.4, 1.5
UNNAMED_STYLE_SHARE = 0.5
CHANGE_FRAMES = 10
TEMPO_OCTAVES = 0.25


@dataclass
class Spoken:
    """A clip: `content` [voices][T, C] and `emotion` [T, E] from the encoders, and `weights` [T, 51].

    The weights are those of neutral speech. `label` is the clip's emotion, `share` the share of listeners who
    agreed, 0 to 1. If the emotional face itself was recorded (`is_recorded`), `weights` [T, 3 V] are its
    displacements in metres and `share` is its intensity. `text` is what the clip says, empty if the text or
    the emotion is unknown. `sound` and `voice` are the inputs of encoders that learn.
    """

    name: str
    source: str
    held_out: bool
    content: list[Tensor]
    emotion: Tensor
    weights: Tensor
    label: str = NEUTRAL
    share: float = 1.0
    is_recorded: bool = False
    text: str = ""
    sound: Tensor | None = None
    voice: Tensor | None = None

    def __len__(self) -> int:
        return len(self.weights)


@dataclass
class Batch:
    """A batch: the model's `inputs`, and `weights` [B, T, 51] with the emotion.

    `before` [B, T, 51] holds the frame before each frame. For recorded faces `weights` and `before` are
    [B, T, 3 V], and `crossed` [B] marks the rows that have the emotion of another recording. With encoders
    that learn, `logits` [N, K] are their class logits for the recordings of the batch, and `labels` [N] the
    true classes.
    """

    inputs: Inputs
    weights: Tensor
    before: Tensor
    crossed: Tensor | None = None
    logits: Tensor | None = None
    labels: Tensor | None = None


class Rows:
    """Draws batches of rows."""

    def __init__(
        self,
        clips: list[Spoken],
        config: EmoFaceConfig,
        shares: dict[str, float],
        seed: int,
        met,
        worn_share: float = 0.0,
    ):
        """`met` computes from weights where the lips meet.

        In `worn_share` of the rows, the frames before show another emotion than the voice. So the model
        learns to take the emotion from the voice and not from these frames.
        """
        self.config, self.met, self.worn_share = config, met, worn_share
        self.random = np.random.default_rng(seed)
        self.clips = {s: [c for c in clips if c.source == s and not c.held_out] for s in shares}
        empty = [s for s, group in self.clips.items() if not group]
        if empty:
            raise ValueError(f"{empty[0]}: expected training clips, got none")
        self.sources = list(shares)
        self.shares = np.array(list(shares.values())) / sum(shares.values())
        all_clips = [c for group in self.clips.values() for c in group]
        self.by_emotion = {f: [c for c in all_clips if c.label == f] for f in config.emotions}

    def batch(self, count: int, frames: int) -> Batch:
        """`count` rows of `frames` frames."""
        rows = [self._row(frames) for _ in range(count)]
        content, emotion, style, level, weights, before = (torch.stack(x) for x in zip(*rows, strict=True))
        return Batch(Inputs(content, emotion, style, level), weights, before)

    def _row(self, frames: int):
        source = self.sources[int(self.random.choice(len(self.sources), p=self.shares))]
        clip = self._long_enough(self.clips[source], frames)
        start, at = self._stretch(clip, frames)
        content = interpolate(clip.content[int(self.random.integers(len(clip.content)))].float(), at[1:])
        spoken = interpolate(clip.weights, at.clamp_min(0.0))
        if start == 0.0:
            spoken[0] = 0.0
        heard, emotion, share = self._emotion(clip, at, frames)
        level = float(self.random.uniform(0.0, HIGHEST_LEVEL))
        level = 1.0 if self.random.random() < LEVEL_ONE_SHARE else level
        met = self.met(spoken)
        acted = with_emotion(spoken, emotion, level * share, met)
        worn = self._worn(spoken, met) if self.random.random() < self.worn_share else acted.clone()
        if start == 0.0:
            worn[0] = 0.0
        named = self._style(clip)
        return content, heard, torch.tensor(named), torch.full((frames,), level), acted[1:], worn[:-1]

    def _style(self, clip: Spoken) -> int:
        unnamed = self.random.random() < UNNAMED_STYLE_SHARE
        return self.config.styles.index(ANY_STYLE if unnamed else clip.source)

    def _stretch(self, clip: Spoken, frames: int) -> tuple[float, Tensor]:
        """Start of a random stretch, and places in the clip of its frames and the one before, [T + 1]."""
        tempo = 2.0 ** self.random.uniform(-TEMPO_OCTAVES, TEMPO_OCTAVES)
        tempo = min(tempo, (len(clip) - 2) / frames)
        start = self.random.uniform(0.0, max(len(clip) - 1 - frames * tempo, 0.0))
        if self.random.random() < 0.3:
            start = 0.0
        return start, start + torch.arange(-1, frames) * tempo

    def _worn(self, spoken: Tensor, met: Tensor) -> Tensor:
        """The row's frames with a randomly drawn emotion, which may be none.

        They serve as the frames before. The model has to leave this emotion for the row's own.
        """
        other = self.config.emotions[int(self.random.integers(len(self.config.emotions)))]
        row = torch.zeros(len(spoken), len(EMOTIONS))
        row[:, EMOTIONS.index(other)] = 1.0
        level = float(self.random.uniform(0.0, HIGHEST_LEVEL))
        return with_emotion(spoken, row, torch.full((len(spoken),), level), met)

    def _emotion(self, clip: Spoken, at: Tensor, frames: int) -> tuple[Tensor, Tensor, Tensor]:
        """Features for the emotion branch [T, E], the emotions' mixture [T + 1, 15] and intensity [T + 1]."""
        is_own = self.random.random() < (NEUTRAL_SHARE if clip.label == NEUTRAL else OWN_SHARE)
        one = (interpolate(clip.emotion, at[1:]), clip) if is_own else self._of_another(frames)
        if self.random.random() >= CHANGING_SHARE:
            return one[0], mixture(one[1]).expand(frames + 1, -1), torch.full((frames + 1,), one[1].share)
        two = self._of_another(frames)
        middle = int(self.random.integers(0, frames))
        heard = torch.cat([one[0][:middle], two[0][middle:]])
        share = ((torch.arange(-1, frames) - middle) / CHANGE_FRAMES).clamp(0.0, 1.0)[:, None]
        shares = (1.0 - share) * mixture(one[1]) + share * mixture(two[1])
        return heard, shares, ((1.0 - share) * one[1].share + share * two[1].share)[:, 0]

    def _of_another(self, frames: int) -> tuple[Tensor, Spoken]:
        """A recording of any emotion, stretched to this length from a random start in its first 40 %."""
        label = self.config.emotions[int(self.random.integers(len(self.config.emotions)))]
        group = self.by_emotion[label] or self.by_emotion[NEUTRAL]
        clip = group[int(self.random.integers(len(group)))]
        first = self.random.uniform(0.0, 0.4) * (len(clip) - 1)
        at = torch.linspace(first, len(clip) - 1, frames)
        return interpolate(clip.emotion, at), clip

    def _long_enough(self, group: list[Spoken], frames: int) -> Spoken:
        lengths = np.array([max(len(c) - 2, 1) for c in group], float)
        lengths[lengths < 0.8 * frames] = 1e-9
        return group[int(self.random.choice(len(group), p=lengths / lengths.sum()))]


def mixture(clip: Spoken) -> Tensor:
    """Mixture of the emotions for a clip's label, [15]."""
    row = torch.zeros(len(EMOTIONS))
    row[EMOTIONS.index(clip.label)] = 1.0
    return row


def prototypes(clips: list[Spoken], config: EmoFaceConfig) -> Tensor:
    """Mean features of each emotion over the second half of its training clips, [7, E]."""
    out = torch.zeros(len(config.emotions), config.emotion_channels)
    for row, label in enumerate(config.emotions):
        heard = [c.emotion[len(c) // 2 :] for c in clips if c.label == label and not c.held_out]
        if heard:
            out[row] = torch.cat(heard).mean(dim=0)
    return out
