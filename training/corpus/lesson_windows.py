"""Training windows of the streaming student: raw log-mel and targets."""

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from training.corpus.lessons import Lesson
from training.corpus.windows import BANDS, AugmentOptions, WindowSampler
from training.losses import SCALE_M
from training.speech.causal import Heard, StreamConfig, nothing_heard
from training.speech.log_mel import ACTIVE_QUANTILE, FLOOR, SAMPLE_RATE_HZ, SCALE, clip_colour, log_mel
from training.systems.freetalk.ats import neutral_affect

DIMS = 204
UNCAPTURED_SCALE_M = 2.0e-3
COLD_SHARE = 0.4
GAIN_NEPERS = (-5.0, 1.0)
GAIN_SHARE = 0.5
SILENT_SHARE = 0.1
HISS_S = 60


@dataclass
class LessonBatch:
    """A batch of windows. `mel` [B, R, 64] is raw log-mel; `heard` is the normaliser's state before it.

    `captured` [B, T, 204] is in metres, and its `weight` is 0 where nothing was captured. `taught` [B, T, D]
    are the teacher's rows. `scale` is [B, 1, 1].
    """

    mel: Tensor
    heard: Heard
    captured: Tensor
    weight: Tensor
    taught: Tensor
    scale: Tensor


class LessonSampler(WindowSampler):
    """Draws windows from lessons of `taught_by`. The sound extends past the last frame by the look-ahead.

    `silence` [D] is what the teacher says where nobody speaks.
    """

    def __init__(self, lessons: list[Lesson], shares: dict[str, float], seed: int, config, silence: Tensor,
                 scales: dict[str, float] = SCALE_M):  # fmt: skip
        options = AugmentOptions(silent_share=SILENT_SHARE)
        super().__init__(lessons, list(shares), list(shares.values()), seed, options)
        self.silence = silence
        self.config: StreamConfig = config
        self.scales = scales
        self.hiss = hiss(seed)

    def batch(self, count: int, frames: int) -> LessonBatch:
        """`count` windows of `frames` motion frames."""
        rows = self.config.mel_rows(frames)
        windows = [self._lesson(frames, rows) for _ in range(count)]
        mel, captured, weight, taught, scale = zip(*windows, strict=True)
        mel = torch.stack(mel)
        return LessonBatch(
            mel=mel,
            heard=self._heard(mel),
            captured=torch.stack(captured),
            weight=torch.stack(weight),
            taught=torch.stack(taught),
            scale=torch.tensor(scale)[:, None, None],
        )

    def _lesson(self, frames: int, rows: int):
        """One window, filled with one clip after another."""
        longer = -(-rows // self.per_frame)
        mel, tracks, weight, _, _, index = self._window(longer)
        tracks = tracks.float()
        if self.random.random() < GAIN_SHARE:
            mel = mel + self.random.uniform(*GAIN_NEPERS)
        mel = mel.clamp_min(np.log(FLOOR))[:rows]
        captured, taught = tracks[:frames].split([DIMS, len(self.silence)], dim=1)
        scale = self.scales.get(self.sources[index], UNCAPTURED_SCALE_M)
        return mel, captured, weight[:frames], taught, scale

    def _heard(self, mel: Tensor) -> Heard:
        """Some windows start cold. In the others the normaliser already knows the voice."""
        heard = nothing_heard(self.config.normaliser, len(mel))
        for row, window in enumerate(mel):
            if self.random.random() < COLD_SHARE:
                continue
            known = float(self.random.uniform(20.0, 600.0))
            heard.colour[row] = clip_colour(window) + self._smooth(0.15)
            heard.peak[row] = torch.quantile(window.mean(dim=1), ACTIVE_QUANTILE)
            heard.frames[row] = known
        return heard

    def _prepare(self, mel: Tensor, colour: Tensor, bare: bool) -> Tensor:
        """Varies room, noise and tract. Returns raw log-mel, because whole windows are normalised later."""
        return super()._prepare(mel, colour, bare) * SCALE + colour

    def _silence(self, frames: int):
        """Digital silence or steady noise over a resting face."""
        mel = torch.full((self.per_frame * frames, BANDS), FLOOR).log()
        if self.random.random() < 0.75:
            noise = self.random.uniform(-12.0, -3.0) + self._smooth(1.0)
            mel = torch.logaddexp(mel, noise + self._wobble(len(mel)))
        phones = torch.zeros(len(mel), dtype=torch.int16)
        still = torch.cat([torch.zeros(DIMS), self.silence]).expand(frames, -1)
        weight = torch.ones(frames, DIMS)
        return mel, still, weight, phones, neutral_affect(1, frames)[0]

    def _wobble(self, rows: int) -> Tensor:
        """Random variation of steady noise about its own level, [rows, 64]."""
        start = int(self.random.integers(0, len(self.hiss) - rows))
        return self.hiss[start : start + rows]


def hiss(seed: int) -> Tensor:
    """Log-mel of white noise minus its mean over time, [T, 64]."""
    generator = torch.Generator().manual_seed(seed)
    mel = log_mel(torch.randn(HISS_S * SAMPLE_RATE_HZ, generator=generator))
    return mel - mel.mean(dim=0)
