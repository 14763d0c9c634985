"""Runs a finished model on held-out clips, with any events and emotions."""

from dataclasses import dataclass, replace
from pathlib import Path

import torch
from torch import Tensor, nn

from training.corpus import arkit, ear
from training.corpus.action_units import unit_matrix
from training.corpus.bank import Entry
from training.corpus.clip import FPS, MEL_PER_FRAME
from training.corpus.conditions import EMOTIONS, SIDES, UNITS
from training.corpus.ear import EarClip
from training.speech.ear import FRAMES_EACH
from training.systems.cafe_talk.denoiser import Denoiser, Sampling
from training.systems.cafe_talk.sampling import Request, sample_weights
from training.systems.cafe_talk.stored import load

SLOT_FRAMES = 20
"""Length of the slot in which events are tried: 0.8 s."""
LESSONS = 40
"""Number of clips of each source that the judge learns from."""


@dataclass
class Take:
    """A clip to perform: `features` [T, C] of its sound, recorded weights `truth` [T, 51], `phones` [4 T]."""

    name: str
    source: str
    features: Tensor
    truth: Tensor
    phones: Tensor

    @property
    def slot(self) -> tuple[int, int]:
        """The slot in which events are tried: 0.8 s in the middle of the clip."""
        first = max((len(self.truth) - SLOT_FRAMES) // 2, 0)
        return first, first + min(SLOT_FRAMES, len(self.truth))


@dataclass
class TakeControl:
    """Control of a take: `unit` on both sides within the slot, at strength `beta`; `emotion` at `intensity`.

    `printed` takes eq. 6 as printed. `unmasked` lets the event guide every frame, as Ho & Salimans (2021) do;
    `every_shape` lets it guide all shapes in the slot. `over_speech` lets jaw and chin hide the speech.
    Without `labelled` the model does not get the coarse condition.
    """

    unit: str | None = None
    beta: float = 1.0
    emotion: str = "neutral"
    intensity: float = 0.0
    printed: bool = False
    unmasked: bool = False
    every_shape: bool = False
    over_speech: bool = False
    labelled: bool = True


class Unlabelled:
    """A denoiser that never gets the coarse condition (table 8: the label masked)."""

    def __init__(self, model: Denoiser):
        self.model, self.config, self.mean = model, model.config, model.mean
        self.to_weights = model.to_weights

    def __call__(self, noisy: Tensor, timestep: Tensor, speech: Tensor, coarse, *more) -> Tensor:
        """Runs the denoiser with its learned null as the coarse condition."""
        withheld = torch.zeros_like(coarse.has_label)
        return self.model(noisy, timestep, speech, replace(coarse, has_label=withheld), *more)


class Actor:
    """A finished model with its encoder, from a `cafe_talk.pt` or the folder to which it was exported."""

    def __init__(self, path: Path):
        stored = load(path)
        if stored.encoder is None:
            raise ValueError(f"{path}: expected a model with a built-in encoder, got one with a checkpoint's")
        self.config, self.encoder, self.emotions = stored.config, stored.encoder, stored.emotions
        self.model = Denoiser(self.config).eval()
        self.model.load_state_dict(stored.state)

    @torch.no_grad()
    def take(self, entry: EarClip) -> Take:
        """Runs a clip through the encoder."""
        features = self.encoder(entry.heard[:1])[0]
        return Take(entry.name, entry.source, features, entry.motion.float(), entry.phones)

    def perform(
        self, take: Take, control: TakeControl | None = None, sampling: Sampling | None = None
    ) -> Tensor:
        """Weights [T, 51] of a take."""
        control = control or TakeControl()
        model: nn.Module | Unlabelled = self.model if control.labelled else Unlabelled(self.model)
        return sample_weights(model, take.features, self._request(take, control), sampling=sampling)

    def _request(self, take: Take, control: TakeControl) -> Request:
        frames = len(take.truth)
        events = torch.zeros(frames, SIDES * len(UNITS))
        strength = torch.zeros(frames, len(self.config.channels))
        if control.unit is not None:
            number, within = UNITS.index(control.unit), slice(*take.slot)
            events[within, [number, len(UNITS) + number]] = 1.0
            shapes = unit_matrix()[[number, len(UNITS) + number]].amax(dim=0)
            strength[within] = control.beta * shapes
            if control.every_shape:
                strength[within] = control.beta
            if control.unmasked:
                strength[:] = control.beta
        emotion = self.emotions[EMOTIONS.index(control.emotion)].expand(frames, -1)
        style = self.config.styles.index(self.config.default_style)
        intensity = torch.full((frames,), control.intensity)
        return Request(style, emotion, intensity, events, strength, control.printed, control.over_speech)


def clips(arguments) -> tuple[list[Entry], list[Entry]]:
    """Clips to teach the judge, and held-out clips to judge and measure; motion is weights [T, 51].

    `arguments` has `corpus` folders, or the `data` folder with `cache`. It takes `clips` held-out clips of
    each source, and at most `seconds` of each clip.
    """
    chosen = first_of_each([*ear.recorded(arguments, list(ear.LAYERS))], LESSONS, arguments.clips)
    solved = arkit.as_weights(chosen, None if arguments.corpus else arguments.data)
    cut = [shortened(entry, int(arguments.seconds * FPS)) for entry in solved]
    return [e for e in cut if not e.held_out], [e for e in cut if e.held_out]


def first_of_each(entries: list[Entry], training: int, held_out: int) -> list[Entry]:
    """The first clips of each source: `training` clips that are not held out and `held_out` that are."""
    chosen: list[Entry] = []
    for source in sorted({e.source for e in entries}):
        for is_held_out, count in ((False, training), (True, held_out)):
            chosen += [e for e in entries if e.source == source and e.held_out is is_held_out][:count]
    return chosen


def shortened(entry: EarClip, frames: int) -> EarClip:
    """The first `frames` of a clip."""
    rows = MEL_PER_FRAME * frames
    sound = {"mels": entry.mels[:, :rows], "phones": entry.phones[:rows]}
    sound["heard"] = entry.heard[:, :, : FRAMES_EACH * frames]
    return replace(entry, **sound, motion=entry.motion[:frames], weight=entry.weight[:frames])
