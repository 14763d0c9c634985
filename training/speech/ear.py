"""A teacher that hears motion through Whisper: its network, and its lessons for the compact encoder.

`training.speech.train_ear` trains it. A lesson is speech without a face, to which the teacher adds motion,
phones and features that the encoder has to predict. Motion and features form one track.
"""

import argparse
import hashlib
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import torch
from torch import Tensor, nn

from training.corpus import ear, spoken
from training.corpus.aligned import kokoro_count, read_texts
from training.corpus.bank import Entry
from training.corpus.cache import cached, digest
from training.corpus.clip import FPS, MEL_PER_FRAME
from training.corpus.decoded import HZ, LEAST_ALIGNED, LEAST_DECODED, align, decode
from training.corpus.ear import FRAMES_EACH, EarClip
from training.corpus.espeak import Espeak
from training.corpus.phones import SEGMENTS, Phone, segment_track, split
from training.corpus.teacher import Teacher, closure, met
from training.corpus.windows import WindowSampler
from training.losses import SCALE_M
from training.nn.config import Config
from training.speech.compact import ResidualBlock
from training.speech.targets import PhoneHead

MOTION = 204
"""Number of motion columns in a track. The features of a lesson come after them."""
LARGEST = 6.0
"""Features are clipped at this many standard deviations, because a few channels of Whisper's inner layers
have enormous values.
"""


@dataclass
class EarConfig(Config):
    """Sizes of the teacher."""

    model: str = "ear"
    layers: int = len(ear.LAYERS)
    width: int = 512
    channels: int = 256
    dilations: list[int] = field(default_factory=lambda: [1, 2, 4, 1])
    dropout: float = 0.2
    noise: float = 0.2


class EarToMotion(nn.Module):
    """Layers of Whisper [B, L, 2 T, C] → features [B, T, c] at 25 Hz, and their read-outs."""

    def __init__(self, config: EarConfig, sources: list[str]):
        super().__init__()
        self.config, channels = config, config.channels
        self.register_buffer("mean", torch.zeros(config.layers, 1, config.width))
        self.register_buffer("deviation", torch.ones(config.layers, 1, config.width))
        self.enter = nn.Linear(config.layers * config.width, channels)
        self.enter_levels = nn.Linear(ear.LEVELS, channels)
        self.dropped = nn.Dropout(config.dropout)
        self.down = nn.Conv1d(channels, channels, 5, stride=2, padding=2)
        self.blocks = nn.ModuleList(ResidualBlock(channels, d) for d in config.dilations)
        self.norm = nn.LayerNorm(channels)
        self.readouts = nn.ModuleList(nn.Linear(channels, 204) for _ in sources)
        self.phones = PhoneHead(channels)

    def forward(self, heard: Tensor, levels: Tensor) -> Tensor:
        """`heard` [B, L, 2 T, C] and `levels` [B, 2 T, 8] of `EarClip` → [B, T, c]."""
        x = ((heard.float() - self.mean) / self.deviation).clamp(-LARGEST, LARGEST)
        if self.training:
            x = x + self.config.noise * torch.randn_like(x)
        x = self.enter(self.dropped(x).transpose(1, 2).flatten(2)) + self.enter_levels(levels)
        x = nn.functional.gelu(self.down(nn.functional.gelu(x).transpose(1, 2)).transpose(1, 2))
        for block in self.blocks:
            x = block(x)
        return self.dropped(self.norm(x))

    def read_out(self, features: Tensor, source: Tensor) -> Tensor:
        """`features` [B, T, c], `source` [B] → [B, T, 204] in units of the source's scale."""
        every = torch.stack([readout(features) for readout in self.readouts])
        return every[source, torch.arange(len(source))]

    def of(self, clip: EarClip) -> Tensor:
        """Features [T, c] of a clip in its own voice."""
        return self(clip.heard[:1], clip.levels()[None])[0]

    def motion(self, clip: EarClip, index: int) -> Tensor:
        """Motion [T, 204] of one read-out in a clip's own voice, in units of the read-out's source."""
        return self.read_out(self.of(clip)[None], torch.tensor([index]))[0]


class EarTeacher:
    """A finished run. It predicts motion for speech in the manner of the run's first source."""

    def __init__(self, run: Path, layer: int | None = None):
        saved = torch.load(run)
        self.model = EarToMotion(EarConfig.from_json(saved["config"]), saved["sources"]).eval()
        self.model.load_state_dict(saved["state"])
        self.model.requires_grad_(False)
        self.scale_m, self.layer = SCALE_M[saved["sources"][0]], layer

    @torch.no_grad()
    def target(self, clip: EarClip, features: Tensor | None = None) -> Tensor:
        """Features of a clip that the compact encoder has to predict, [T, C'] f16.

        With `layer` these are a layer of Whisper in deviations, averaged around each frame of motion. Without
        it they are the teacher's own `features`, computed here if they are not at hand.
        """
        if self.layer is None:
            return (self.model.of(clip) if features is None else features).half()
        place = ear.LAYERS.index(self.layer)
        x = (clip.heard[0, place].float() - self.model.mean[place]) / self.model.deviation[place]
        x = x.clamp(-LARGEST, LARGEST)
        before = torch.cat([x[:1], x[1:-1:FRAMES_EACH]])
        return (0.25 * before + 0.5 * x[::FRAMES_EACH] + 0.25 * x[1::FRAMES_EACH]).half()

    @torch.no_grad()
    def log_posteriors(self, clip: EarClip) -> np.ndarray:
        """Phones of a clip, [4 T, segments] at 100 Hz, from two passes that are shifted by one feature."""
        heard, levels = clip.heard[0], clip.levels()
        late = (torch.cat([heard[:, 1:], heard[:, -1:]], dim=1), torch.cat([levels[1:], levels[-1:]]))
        both = [self.model(x[None], y[None])[0] for x, y in ((heard, levels), late)]
        passes = [self.model.phones.readout(features) for features in both]
        rows = torch.stack(passes, dim=1).flatten(0, 1).log_softmax(dim=-1)
        return rows.repeat_interleave(MEL_PER_FRAME // FRAMES_EACH, dim=0).numpy()

    @torch.no_grad()
    def lesson(self, clip: EarClip, said: list[str] | None) -> Entry:
        """A lesson from a clip without a face: motion with lips that meet at p, b and m, phones and features.

        If the clip has no timed phones, they are decoded, or aligned to `said`, the segments of its text.
        """
        features, phones = self.model.of(clip), clip.phones
        if (phones < 0).any():
            rows = self.log_posteriors(clip)
            timed_phones, sure = decode(rows) if said is None else align(rows, said)
            if sure > (LEAST_DECODED if said is None else LEAST_ALIGNED):
                phones = torch.from_numpy(segment_track(timed_phones, len(phones), HZ))
        motion = (self.model.readouts[0](features) * self.scale_m).unflatten(1, (68, 3)).numpy()
        if (phones >= 0).all():
            motion = met(motion, closure(timed(phones), np.arange(len(motion)) / FPS))
        weight = torch.ones(1, MOTION).expand(len(motion), MOTION)
        moved = torch.from_numpy(motion).flatten(1).half()
        entry = replace(entry_of(clip), source=spoken.SOURCE, motion=moved, weight=weight, phones=phones)
        entry.name = f"{clip.source}/{clip.name.split('/')[-1]}"
        return with_target(entry, self.target(clip, features))


def entry_of(clip: EarClip) -> Entry:
    """The clip without Whisper's features."""
    return Entry(**{key: value for key, value in vars(clip).items() if key != "heard"})


def timed(phones: Tensor) -> list[Phone]:
    """A track of segments [T] at 100 Hz as phones with times."""
    edges = [0, *(torch.nonzero(phones.diff()).flatten() + 1).tolist(), len(phones)]
    spans = zip(edges[:-1], edges[1:], strict=True)
    return [Phone(a / HZ, (b - a) / HZ, SEGMENTS[int(phones[a])]) for a, b in spans]


def with_target(entry: Entry, target: Tensor) -> Entry:
    """Motion and features side by side as one track, because windows re-time `motion` with the sound.

    The last column of `weight` says whether the features are known.
    """
    motion = torch.cat([entry.motion.half(), target], dim=1)
    known = torch.ones(1, 1).expand(len(motion), 1)
    return replace(entry, motion=motion, weight=torch.cat([entry.weight, known], dim=1).half())


class TargetWindows(WindowSampler):
    """Windows of entries from `with_target`; over silence the features are unknown."""

    def _silence(self, frames: int):
        mel, still, _, phones, affect = super()._silence(frames)
        weight = torch.ones(frames, MOTION + 1)
        weight[:, -1] = 0.0
        return mel, still, weight, phones, affect


def lessons(arguments) -> tuple[list[Entry], dict[tuple[str, str], Tensor]]:
    """Lessons from all speech without a face, and the features of recorded clips by source and name."""
    if arguments.whisper is None:
        raise ValueError("--ear: expected --whisper, the folder of training.speech.whisper, got nothing")
    teacher = EarTeacher(arguments.ear, arguments.layer)
    left = {*arguments.leave_speech, *ear.UNHEARD}
    names = [source for source in ear.every_source() if source not in left]
    weights = hashlib.sha256(arguments.ear.read_bytes()).hexdigest()
    kokoro = kokoro_count(arguments.data) if "kokoro" in names else []
    run = digest(ear.VERSION, weights, arguments.layer, names, arguments.minutes, *kokoro)

    def make_lessons() -> Iterator[Entry]:
        sequences = read_sequences(arguments.data)
        for source in names:
            for clip in ear.load(
                arguments.data, arguments.cache, arguments.whisper, [source], arguments.minutes
            ):
                if source in SCALE_M:
                    yield with_target(entry_of(clip), teacher.target(clip))
                else:
                    yield teacher.lesson(clip, sequences.get(clip.name.split("/")[-1]))

    all_lessons = cached(arguments.cache / f"lessons-ear-{run}.pt", Entry, make_lessons)
    recorded = {(e.source, e.name): e.motion[:, MOTION:] for e in all_lessons if e.source in SCALE_M}
    return [e for e in all_lessons if e.source == spoken.SOURCE], recorded


def speech_without_a_face(arguments) -> list[Entry]:
    """Speech without a face, with phones. The teacher of `--ear` or the co-articulation rules move it."""
    if arguments.ear is None:
        left, reader = tuple(arguments.leave_speech), arguments.reader
        return spoken.load(arguments.data, arguments.cache, arguments.minutes, left, Teacher.load(), reader)
    return [without_target(entry) for entry in lessons(arguments)[0]]


def without_target(entry: Entry) -> Entry:
    """The inverse of `with_target`."""
    return replace(entry, motion=entry.motion[:, :MOTION], weight=entry.weight[:, :MOTION])


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Adds the flags that choose the teacher, for `lessons` and `speech_without_a_face`."""
    parser.add_argument("--ear", type=Path, help="ear.pt of training.speech.train_ear, the teacher")
    parser.add_argument(
        "--layer",
        type=int,
        choices=ear.LAYERS,
        help="layer of Whisper to learn, instead of ear.pt's features",
    )
    parser.add_argument("--whisper", type=Path, help="folder of training.speech.whisper, for --ear")


def read_sequences(data: Path) -> dict[str, list[str]]:
    """Segments of the texts of kerstin_de as espeak-ng speaks them, by name."""
    espeak, sequences = Espeak(), {}
    for name, text in read_texts(data / "speech/kerstin_de").items():
        _, phones = espeak.speak(text, "de")
        sequences[name] = [part for phone in phones for _, _, part in split(phone)]
    return sequences
