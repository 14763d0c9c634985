"""Training windows of the streaming student: raw log-mel, targets, and emotions that change."""

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from training.corpus.lessons import SILENCE, Lesson
from training.corpus.windows import BANDS, AugmentOptions, WindowSampler
from training.losses import SCALE_M
from training.speech.compact import ACTIVE_QUANTILE, SCALE, clip_colour
from training.speech.log_mel import FLOOR, SAMPLE_RATE_HZ, log_mel
from training.systems.freetalk.stream import Heard, StreamConfig, nothing_heard

DIMS = 204
FEELINGS = 14
UNCAPTURED_SCALE_M = 2.0e-3
ONSET_FRAMES = 8
NEUTRAL_SHARE = 0.4
CHANGING_SHARE = 0.5
COLD_SHARE = 0.4
GAIN_NEPERS = (-5.0, 1.0)
GAIN_SHARE = 0.5
SILENT_SHARE = 0.1
HISS_S = 60


@dataclass
class LessonBatch:
    """`mel` [B, R, 64] raw; `heard` before it; `strengths` [B, T, 14]; metres [B, T, 204]:

    `captured` with its `weight` (0 where nothing was captured), `taught`; `scale` [B, 1, 1].
    """

    mel: Tensor
    heard: Heard
    strengths: Tensor
    captured: Tensor
    weight: Tensor
    taught: Tensor
    scale: Tensor


class LessonSampler(WindowSampler):
    """Draws windows from lessons; the sound reaches past the last frame by the look-ahead."""

    def __init__(self, lessons: list[Lesson], shares: dict[str, float], seed: int, config):
        sources = [source for source in shares if source != SILENCE]
        packed = [pack(lesson) for lesson in lessons if lesson.source != SILENCE]
        values = [shares[source] for source in sources]
        super().__init__(packed, sources, values, seed, AugmentOptions(silent_share=SILENT_SHARE))
        self.config: StreamConfig = config
        self.silent = [pack(lesson) for lesson in lessons if lesson.source == SILENCE]
        self.moods = len(self.silent[0].moods)
        self.hiss = hiss(seed)

    def batch(self, count: int, frames: int) -> LessonBatch:
        """`count` windows of `frames` motion frames."""
        rows = self.config.mel_rows(frames)
        windows = [self._lesson(frames, rows) for _ in range(count)]
        mel, captured, weight, taught, strengths, scale = zip(*windows, strict=True)
        mel = torch.stack(mel)
        return LessonBatch(
            mel=mel,
            heard=self._heard(mel),
            strengths=torch.stack(strengths),
            captured=torch.stack(captured),
            weight=torch.stack(weight),
            taught=torch.stack(taught),
            scale=torch.tensor(scale)[:, None, None],
        )

    def _lesson(self, frames: int, rows: int):
        """One window; its parts are clips one after the other."""
        longer = -(-rows // self.per_frame)
        mel, tracks, _, weight, _, index = self._window(longer)
        tracks = tracks.float()
        if self.random.random() < GAIN_SHARE:
            mel = mel + self.random.uniform(*GAIN_NEPERS)
        mel = mel.clamp_min(np.log(FLOOR))[:rows]
        felt, strengths = self._feel(tracks[:frames])
        captured, taught = tracks[:frames, :DIMS] + felt, tracks[:frames, DIMS : 2 * DIMS] + felt
        scale = SCALE_M.get(self.sources[index], UNCAPTURED_SCALE_M)
        return mel, captured, weight[:frames], taught, strengths, scale

    def _feel(self, tracks: Tensor) -> tuple[Tensor, Tensor]:
        """What emotion adds [T, 204] and its strengths [T, 14]; changes settle in 8 frames.

        The first emotion is there from the start. A change leaves from what stood before it: a
        causal model cannot prepare for it.
        """
        frames = len(tracks)
        strengths, added = torch.zeros(frames, FEELINGS), torch.zeros(frames, DIMS)
        if self.random.random() < NEUTRAL_SHARE:
            return added, strengths
        deltas, moods = unpack_moods(tracks, self.moods)
        cuts = [0, frames]
        if self.random.random() < CHANGING_SHARE:
            cuts = [0, *sorted(self.random.integers(1, frames, 2).tolist()), frames]
        for first, last in zip(cuts, cuts[1:], strict=False):
            mood = int(self.random.integers(0, self.moods + 1))
            share = self.random.uniform(0.2, 1.0) if self.random.random() < 0.5 else 1.0
            if mood < self.moods:
                strengths[first:last] = share * moods[mood][first:last]
                added[first:last] = share * deltas[mood][first:last]
        return settle(added, strengths), strengths

    def _heard(self, mel: Tensor) -> Heard:
        """Some windows start cold, the others with their voice already known."""
        heard = nothing_heard(self.config.normaliser, len(mel))
        for row, window in enumerate(mel):
            if self.random.random() < COLD_SHARE:
                continue
            known = float(self.random.uniform(20.0, 600.0))
            heard.colour[row] = clip_colour(window) + self._smooth(0.15)
            heard.peak[row] = torch.quantile(window.mean(dim=1), ACTIVE_QUANTILE)
            heard.frames[row] = known
        return heard

    def _normalised(self, mel: Tensor, colour: Tensor) -> Tensor:
        """Another room, noise and tract, as raw log-mel: the normalisation runs over windows."""
        return super()._normalised(mel, colour) * SCALE + colour

    def _silence(self, frames: int):
        """Digital silence or steady noise, with what the moods do to a resting face."""
        lesson = self.silent[int(self.random.integers(0, len(self.silent)))]
        held = torch.arange(frames).clamp_max(len(lesson.motion) - 1)
        mel = torch.full((self.per_frame * frames, BANDS), FLOOR).log()
        if self.random.random() < 0.75:
            noise = self.random.uniform(-12.0, -3.0) + self._smooth(1.0)
            mel = torch.logaddexp(mel, noise + self._wobble(len(mel)))
        tracks, phones = lesson.motion[held], torch.zeros(len(mel), dtype=torch.int16)
        return mel, tracks, tracks[:, :1], torch.ones(frames, DIMS), phones

    def _wobble(self, rows: int) -> Tensor:
        """How steady noise strays from its own level, [rows, 64]."""
        start = int(self.random.integers(0, len(self.hiss) - rows))
        return self.hiss[start : start + rows]


def hiss(seed: int) -> Tensor:
    """Log-mel of white noise, less its mean, [T, 64]."""
    generator = torch.Generator().manual_seed(seed)
    mel = log_mel(torch.randn(HISS_S * SAMPLE_RATE_HZ, generator=generator))
    return mel - mel.mean(dim=0)


def pack(lesson: Lesson) -> Lesson:
    """Captured, taught, added by moods and their strengths side by side as one track.

    Windows re-time `motion` as they re-time the sound, so everything that goes with it is there.
    Captured is what has lips that meet.
    """
    captured = torch.where(lesson.weight > 0, lesson.closed, lesson.taught[0].float())
    if lesson.source == SILENCE:
        captured = torch.zeros_like(lesson.motion)
    moods = lesson.moods.flatten().expand(len(captured), -1)
    neutral = torch.zeros_like(captured) if lesson.source == SILENCE else lesson.taught[0].float()
    track = torch.cat([captured, neutral, *lesson.taught[1:].float(), moods], dim=1).half()
    return Lesson(**(vars(lesson) | {"motion": track, "closed": track[:, :1]}))


def unpack_moods(tracks: Tensor, count: int) -> tuple[list[Tensor], list[Tensor]]:
    """The moods' additions, [T, 204] each, and their strengths, [T, 14] each."""
    deltas = tracks[:, 2 * DIMS : (2 + count) * DIMS].split(DIMS, dim=1)
    return list(deltas), list(tracks[:, (2 + count) * DIMS :].split(FEELINGS, dim=1))


def settle(added: Tensor, strengths: Tensor) -> Tensor:
    """Replaces every step of the strengths by a smooth one that starts where they change."""
    out = added.clone()
    changes = ((strengths[1:] - strengths[:-1]).abs() > 1e-4).any(dim=1).nonzero().flatten() + 1
    for first in changes.tolist():
        last = min(first + ONSET_FRAMES, len(out))
        u = torch.arange(1, last - first + 1)[:, None] / ONSET_FRAMES
        share = u * u * (3.0 - 2.0 * u)
        out[first:last] = share * added[first:last] + (1.0 - share) * out[first - 1]
    return out
