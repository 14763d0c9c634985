"""Training windows: stretches of speech and motion, re-timed, in random voices and rooms."""

from dataclasses import dataclass

import numpy as np
import torch
import torch.nn.functional as F
from torch import Tensor

from training.corpus.bank import Entry
from training.corpus.clip import MEL_PER_FRAME
from training.speech.log_mel import DEEPEST, SCALE, clip_colour
from training.systems.freetalk.ats import neutral_affect

BANDS = 64


@dataclass
class AugmentOptions:
    """How far training input may differ from the recordings.

    `as_recorded_share` of the stretches stay unchanged. Without them, the lip gap on held-out clips of
    grid_s1 stayed at r 0.93. A small network on the bare recordings exceeds that in three minutes.
    """

    as_recorded_share: float = 0.5
    tempo_octaves: float = 0.3
    band_shift: float = 2.5
    band_stretch: float = 0.06
    noise_share: float = 0.5
    noise_nepers: tuple[float, float] = (1.5, 9.0)
    reverb_share: float = 0.25
    colour_jitter: float = 0.3
    masked_share: float = 0.3
    silent_share: float = 0.04
    own_voice_share: float = 0.25
    music_share: float = 0.12
    band_limit_share: float = 0.15
    codec_share: float = 0.15


@dataclass
class Batch:
    """One training batch.

    `mel` [B, 4 T, 64] normalised; `motion` and `weight` [B, T, D]; `phones` [B, 4 T] segments, −1 if
    unknown; `affect` [B, T, 16] mixture of emotions and intensity; `source` [B] index of the source.
    """

    mel: Tensor
    motion: Tensor
    weight: Tensor
    phones: Tensor
    affect: Tensor
    source: Tensor


class WindowSampler:
    """Draws batches of T-frame windows from the training entries of one or more sources."""

    per_frame = MEL_PER_FRAME

    def __init__(
        self,
        entries: list[Entry],
        sources: list[str],
        shares: list[float],
        seed: int,
        augment: AugmentOptions,
    ):
        self.sources = sources
        self.shares = np.array(shares) / np.sum(shares)
        self.random = np.random.default_rng(seed)
        self.augment = augment
        self.entries = {s: [e for e in entries if e.source == s and not e.held_out] for s in sources}
        for source, clips in self.entries.items():
            if not clips:
                raise ValueError(f"{source}: expected training clips, got none")
        self.dimensions = next(iter(self.entries.values()))[0].motion.shape[1]
        self.colours = {
            (e.source, e.name): torch.stack([clip_colour(m.float()) for m in e.mels])
            for group in self.entries.values()
            for e in group
        }

    def batch(self, count: int, frames: int) -> Batch:
        """`count` windows of `frames` motion frames."""
        rows = [self._window(frames) for _ in range(count)]
        *tensors, source = zip(*rows, strict=True)
        return Batch(*(torch.stack(column) for column in tensors), torch.tensor(source))

    def _window(self, frames: int):
        index = int(self.random.choice(len(self.sources), p=self.shares))
        if self.random.random() < self.augment.silent_share:
            return (*self._silence(frames), index)
        parts, total = [], 0
        while total < frames:
            parts.append(self._part(self.sources[index], frames - total))
            total += len(parts[-1][1])
        mel, motion, weight, phones, affect = (torch.cat(part) for part in zip(*parts, strict=True))
        fine = self.per_frame * frames
        return mel[:fine], motion[:frames], weight[:frames], phones[:fine], affect[:frames], index

    def _part(self, source: str, longest: int):
        """One clip, or a stretch of a long one: normalised mel, motion, weight, phones, affect."""
        group = self.entries[source]
        lengths = np.array([len(e.motion) for e in group], dtype=float)
        entry = group[self.random.choice(len(group), p=lengths / lengths.sum())]
        bare = self.random.random() < self.augment.as_recorded_share
        own_voice = bare or self.random.random() < self.augment.own_voice_share or len(entry.mels) == 1
        voice = 0 if own_voice else int(self.random.integers(1, len(entry.mels)))
        octaves = 0.0 if bare else self.augment.tempo_octaves
        tempo = 2.0 ** self.random.uniform(-octaves, octaves)
        available = int(len(entry.motion) / tempo)
        frames = min(available, longest) if available > 150 else available
        start = self.random.uniform(0, max(len(entry.motion) - frames * tempo - 1, 0))
        first, last = int(start), min(int(start + frames * tempo) + 2, len(entry.motion))
        position = start - first + torch.arange(frames) * tempo
        moving = [interpolate(x[first:last].float(), position) for x in (entry.motion, entry.weight)]
        span = slice(self.per_frame * first, self.per_frame * last)
        fine = self.per_frame * (start - first) + torch.arange(self.per_frame * frames) * tempo
        mel = interpolate(entry.mels[voice, span].float(), fine)
        phones = entry.phones[span][fine.round().long().clamp_max(span.stop - span.start - 1)]
        heard = self._prepare(mel, self.colours[source, entry.name][voice], bare)
        return heard, *moving, phones, entry.affect().expand(frames, -1)

    def _prepare(self, mel: Tensor, colour: Tensor, bare: bool) -> Tensor:
        """Turns the raw log-mel of a stretch into the encoder's input."""
        return (mel - colour).clamp_min(DEEPEST) / SCALE if bare else self._normalised(mel, colour)

    def _normalised(self, mel: Tensor, colour: Tensor) -> Tensor:
        """Adds a room and noise to raw log-mel, then normalises it as `compact.normalise` would."""
        options = self.augment
        if self.random.random() < options.codec_share:
            mel = drop_masked(mel, self.random.uniform(5.0, 9.0))
        if self.random.random() < options.reverb_share:
            mel = reverberate(mel, self.random.uniform(3.0, 12.0), self.random.uniform(0.03, 0.25))
        if self.random.random() < options.noise_share:
            noise = colour.mean() - self.random.uniform(*options.noise_nepers) + self._smooth(1.5)
            wobble = torch.from_numpy(self.random.gamma(4.0, 0.25, mel.shape)).float()
            mel = torch.logaddexp(mel, noise + wobble.clamp_min(1e-3).log())
            colour = torch.logaddexp(colour, noise)
        if self.random.random() < options.music_share:
            music = self._music(len(mel)) + colour.mean() - self.random.uniform(0.5, 4.0)
            mel = torch.logaddexp(mel, music)
            colour = torch.logaddexp(colour, music.mean(dim=0))
        mel = mel - colour
        if self.random.random() < options.band_limit_share:
            mel = self._band_limited(mel)
        mel = self._warp_bands(mel)
        mel = mel + self._smooth(options.colour_jitter) if options.colour_jitter else mel
        mel = mel.clamp_min(DEEPEST) / SCALE
        if self.random.random() < options.masked_share:
            width = int(self.random.integers(2, 9))
            low = int(self.random.integers(0, BANDS - width))
            mel[:, low : low + width] = mel[:, low : low + width].mean()
        return mel

    def _warp_bands(self, mel: Tensor) -> Tensor:
        options = self.augment
        if options.band_shift == 0.0 and options.band_stretch == 0.0:
            return mel
        shift = self.random.uniform(-options.band_shift, options.band_shift)
        stretch = 1.0 + self.random.uniform(-options.band_stretch, options.band_stretch)
        return interpolate(mel.T, torch.arange(BANDS) * stretch + shift).T

    def _music(self, frames: int) -> Tensor:
        """Chords that change every quarter to whole second, [T, 64] log power around 0."""
        out, start = torch.full((frames, BANDS), -6.0), 0
        while start < frames:
            length = int(self.random.integers(25, 100))
            notes = self.random.integers(4, 48, int(self.random.integers(2, 9)))
            fade = torch.linspace(0.0, -float(self.random.uniform(0, 3)), length)[: frames - start]
            out[start : start + length, notes] = fade[:, None] + 1.0
            start += length
        return out

    def _band_limited(self, mel: Tensor) -> Tensor:
        """A telephone or a low-pass: outside the pass band only a little steady noise remains."""
        low = int(self.random.integers(0, 12)) if self.random.random() < 0.5 else 0
        high = int(self.random.integers(38, 58))
        noise = torch.from_numpy(self.random.standard_normal(mel.shape)).float() * 0.3
        inside = torch.zeros(BANDS, dtype=torch.bool)
        inside[low:high] = True
        return torch.where(inside, mel, noise)

    def _smooth(self, size: float) -> Tensor:
        """A smooth random curve over the bands, [64]."""
        knots = torch.from_numpy(self.random.standard_normal((1, 1, 6))).float() * size
        return F.interpolate(knots, BANDS, mode="linear", align_corners=True)[0, 0]

    def _silence(self, frames: int):
        """Digital silence or steady noise over a neutral face at rest, in the order of `Batch`."""
        mel = torch.full((self.per_frame * frames, BANDS), DEEPEST / SCALE)
        if self.random.random() < 0.75:
            wobble = self.random.gamma(self.random.uniform(1.0, 6.0), 1.0, mel.shape)
            mel = torch.from_numpy(np.log(np.maximum(wobble, 1e-4))).float()
            mel = (mel - clip_colour(mel)) / SCALE + self._smooth(0.1)
        still, phones = torch.zeros(frames, self.dimensions), torch.zeros(len(mel), dtype=torch.int16)
        return mel, still, torch.ones_like(still), phones, neutral_affect(1, frames)[0]


def interpolate(x: Tensor, position: Tensor) -> Tensor:
    """Interpolates rows of `x` [T, …] linearly at fractional positions [P], clamped to the ends."""
    position = position.clamp(0, len(x) - 1)
    below = position.floor().long().clamp_max(max(len(x) - 2, 0))
    share = (position - below).to(x.dtype).unsqueeze(1)
    above = (below + 1).clamp_max(len(x) - 1)
    return x[below] * (1 - share) + x[above] * share


def drop_masked(mel: Tensor, depth_nepers: float) -> Tensor:
    """Imitates lossy codecs: bands far below the loudest of their frame vanish. [T, 64]."""
    floor = mel.amax(dim=1, keepdim=True) - depth_nepers
    return torch.where(mel < floor, floor - 2.0, mel)


def reverberate(mel: Tensor, decay_frames: float, gain: float) -> Tensor:
    """Adds an exponential tail to the power of log-mel [T, 64]."""
    tail = torch.exp(-torch.arange(1, 40) / decay_frames) * gain / decay_frames * 4.0
    kernel = torch.cat([torch.ones(1), tail]).flip(0)[None, None]
    power = F.pad(mel.exp().T[:, None], (kernel.shape[-1] - 1, 0))
    return F.conv1d(power, kernel)[:, 0].T.clamp_min(1e-8).log()
