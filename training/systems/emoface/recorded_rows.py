"""Training rows from faces recorded with emotion: recordings and crossed pairs (eq. 7, 8)."""

import numpy as np
import torch
from torch import Tensor

from training.corpus.windows import interpolate
from training.systems.emoface.encoders import Encoders
from training.systems.emoface.model import EmoFaceConfig, Inputs
from training.systems.emoface.pairs import Pairs
from training.systems.emoface.rows import Batch, Rows, Spoken


class RecordedRows(Rows):
    """Draws batches.

    A recording with a partner gives two rows with its content. The first has its own emotion and motion. The
    second has the partner's emotion, and the partner's motion at the times of the recording.
    """

    def __init__(self, clips: list[Spoken], config: EmoFaceConfig, encoders: Encoders, seed: int,
                 worn_share: float = 0.0):  # fmt: skip
        """In `worn_share` of a pair's rows, the frames before are taken from the other row."""
        training = [c for c in clips if not c.held_out]
        super().__init__(clips, config, {c.source: 1.0 for c in training}, seed, None, worn_share)
        self.seed, self.encoders, self.training = seed, encoders, training
        self.pairs = Pairs(training)

    @property
    def pair_count(self) -> int:
        """Number of training clips that have a partner."""
        return sum(bool(self.pairs.of(c)) for c in self.training)

    def batch(self, count: int, frames: int) -> Batch:
        """`count` rows of `frames` frames, or one more if the last belongs to a pair."""
        rows, recordings = [], []
        while len(rows) < count:
            source = self.sources[int(self.random.choice(len(self.sources), p=self.shares))]
            clip = self._long_enough(self.clips[source], frames)
            start, at = self._stretch(clip, frames)
            self._add(rows, recordings, clip, at, start == 0.0)
        return _batch(rows, recordings)

    def whole(self, step: int) -> Batch:
        """One whole recording. Each epoch shows every recording once.

        The recording's first frame also serves as the frame before it.
        """
        epoch, place = divmod(step, len(self.training))
        order = np.random.default_rng([self.seed, epoch]).permutation(len(self.training))
        clip = self.training[order[place]]
        rows, recordings = [], []
        self._add(rows, recordings, clip, torch.arange(-1, len(clip)).float(), False)
        return _batch(rows, recordings)

    def _add(self, rows: list, recordings: list, clip: Spoken, at: Tensor, from_rest: bool) -> None:
        partners = self.pairs.of(clip)
        content = interpolate(self.encoders.content(clip), at[1:])
        style = torch.tensor(self._style(clip))
        sides = [self._feel(recordings, clip, at, from_rest)]
        if partners:
            other = partners[int(self.random.integers(len(partners)))]
            there = interpolate(self.pairs.path(clip, other)[:, None], at)[:, 0]
            sides.append(self._feel(recordings, other, there, from_rest))
        for k, (emotion, level, motion) in enumerate(sides):
            wears_other = len(sides) > 1 and self.random.random() < self.worn_share
            before = sides[1 - k if wears_other else k][2][:-1]
            rows.append((content, emotion, style, level, motion[1:], before, torch.tensor(k == 1)))

    def _feel(
        self, recordings: list, clip: Spoken, at: Tensor, from_rest: bool
    ) -> tuple[Tensor, Tensor, Tensor]:
        """The emotion and the motion at places `at` in a clip.

        Returns F_e [T, E], level [T], and displacements that include the frame before, [T + 1, 3 V]. Appends
        the clip's logits and label to `recordings` if the encoders learn.
        """
        emotion, logits = self.encoders.feel(clip)
        if logits is not None:
            recordings.append((logits, torch.tensor(self.encoders.label(clip))))
        motion = interpolate(clip.weights, at)
        if from_rest:
            motion[0] = 0.0
        return interpolate(emotion, at[1:]), torch.full((len(at) - 1,), clip.share), motion


def _batch(rows: list, recordings: list) -> Batch:
    content, emotion, style, level, motion, before, crossed = (
        torch.stack(x) for x in zip(*rows, strict=True)
    )
    logits, labels = (torch.stack(x) for x in zip(*recordings, strict=True)) if recordings else (None, None)
    return Batch(Inputs(content, emotion, style, level), motion, before, crossed, logits, labels)
