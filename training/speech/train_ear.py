"""Trains the teacher of motion on Whisper: it predicts the face's motion and the phones of any voice.

    python -m training.speech.train_ear --whisper ../shared/models/whisper-base --out runs/ear

trains on recorded motion in three voices and on speech with phone times in twenty languages. Each source of
motion has its own read-out. `ear.pt` then gives all other speech a face (`training.speech.train --ear`).
"""

import argparse
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from training.corpus import ear
from training.corpus.clip import FPS, MEL_PER_FRAME
from training.corpus.ear import FRAMES_EACH, EarClip
from training.corpus.spoken import SOURCE
from training.corpus.teacher import Teacher
from training.losses import SCALE_M, feature_concordance, landmark_weights, motion_loss, source_scale
from training.machine import Machine
from training.run import begin, descend, seeded, trainer_parser
from training.speech.ear import MOTION, EarConfig, EarToMotion, timed
from training.speech.strangers import scores

SHARES = {"grid_s1": 0.35, "facegood_zh": 0.25, SOURCE: 0.4}
CONCORDANCE = 0.3
ARTICULATION = 0.3


@dataclass
class EarBatch:
    """A batch, in which each row is a window of T frames of motion.

    `heard` [B, L, 2 T, C]; `levels` [B, 2 T, 8]; `motion`, `weight` [B, T, 204]; `phones` [B, 4 T];
    `source` [B].
    """

    heard: Tensor
    levels: Tensor
    motion: Tensor
    weight: Tensor
    phones: Tensor
    source: Tensor


class EarSampler:
    """Draws windows of training clips, each in one of its voices."""

    def __init__(self, clips: list[EarClip], shares: dict[str, float], seed: int):
        self.sources, self.random = list(shares), np.random.default_rng(seed)
        self.shares = np.array(list(shares.values())) / sum(shares.values())
        self.clips = {s: [c for c in clips if group(c) == s and not c.held_out] for s in shares}
        self.levels = {id(c): c.levels() for group in self.clips.values() for c in group}
        lengths = [np.array([len(c.motion) for c in self.clips[s]], float) for s in shares]
        self.chances = {s: of / of.sum() for s, of in zip(shares, lengths, strict=True)}

    def batch(self, count: int, frames: int) -> EarBatch:
        """`count` windows of `frames` frames of motion."""
        rows = [self._window(frames) for _ in range(count)]
        *tensors, source = zip(*rows, strict=True)
        return EarBatch(*(torch.stack(column) for column in tensors), torch.tensor(source))

    def _window(self, frames: int):
        index = int(self.random.choice(len(self.sources), p=self.shares))
        parts, total = [], 0
        while total < frames:
            parts.append(self._part(self.sources[index], frames - total))
            total += len(parts[-1][2])
        heard, *rest = zip(*parts, strict=True)
        return torch.cat(heard, dim=1), *(torch.cat(part) for part in rest), index

    def _part(self, source: str, longest: int):
        clips = self.clips[source]
        clip = clips[self.random.choice(len(clips), p=self.chances[source])]
        frames = min(len(clip.motion), longest)
        start = int(self.random.integers(0, len(clip.motion) - frames + 1))
        heard, moved, said = (slice(k * start, k * (start + frames)) for k in (FRAMES_EACH, 1, MEL_PER_FRAME))
        voice = int(self.random.integers(len(clip.heard)))
        rows = (
            self.levels[id(clip)][heard],
            clip.motion[moved].float(),
            clip.weight[moved].float(),
            clip.phones[said],
        )
        return clip.heard[voice, :, heard], *rows


def group(clip: EarClip) -> str:
    """The clip's source if its motion was recorded, else `taught`."""
    return clip.source if clip.source in SHARES else SOURCE


def loss_of(model: EarToMotion, batch: EarBatch, scale: Tensor, weight: Tensor, machine: Machine):
    """Loss of one batch: motion, concordance and phones; `scale` [B, 1, 1] metres by source."""
    with machine.autocast():
        features = model(batch.heard, batch.levels)
        prediction = model.read_out(features, batch.source).float()
        said = model.phones.loss(features, batch.phones)
    has_motion = batch.weight.amax(dim=(1, 2)) > 0
    motion, agreement, parts = said * 0.0, said * 0.0, {}
    if has_motion.any():
        truth = (batch.motion / scale)[has_motion]
        motion = motion_loss(prediction[has_motion] - truth, batch.weight[has_motion] * weight)
        agreement, parts = feature_concordance(prediction[has_motion], truth)
    parts |= {"motion": motion.item(), "said": said.item()}
    return motion + CONCORDANCE * agreement + ARTICULATION * said, parts


@torch.no_grad()
def validate(model: EarToMotion, clips: list[EarClip], sources: list[str]) -> dict[str, float]:
    """Scores of held-out clips of trained sources and of clips of left-out sources (with each read-out), and
    the share of phones recognised in held-out speech without a face."""
    model.eval()
    report = {}
    for name in (s for s in SHARES if s != SOURCE):
        known = name in sources
        chosen = [c for c in clips if c.source == name and (c.held_out or not known)]
        for index, source in enumerate(sources):
            if not chosen or (known and source != name):
                continue
            pairs = [(model.motion(c, index) * SCALE_M[source], c) for c in chosen]
            label = name if known else f"{name}<-{source}"
            report |= {f"{label} {key}": round(value, 3) for key, value in scores(pairs).items()}
    for name in sorted({c.source for c in clips if c.source not in SHARES and c.held_out}):
        chosen = [c for c in clips if c.source == name and c.held_out and (c.phones >= 0).all()]
        right = [phones_right(model, c) for c in chosen]
        if right:
            report[f"{name} phones"] = round(float(torch.cat(right).mean()), 3)
    model.train()
    return report


def phones_right(model: EarToMotion, clip: EarClip) -> Tensor:
    """For each frame outside pauses, whether the likeliest segment is the right one."""
    predicted = model.phones.readout(model.of(clip)).argmax(dim=-1)
    true = clip.phones[::MEL_PER_FRAME].long()
    return (predicted == true)[true > 0].float()


def train(arguments) -> Path:
    """Runs the training and returns the checkpoint's path."""
    seeded(arguments)
    machine = Machine("cpu", "bfloat16")
    names = [s for s in ear.every_source() if s not in {*arguments.leave_speech, *ear.UNTIMED}]
    clips = ear.load(arguments.data, arguments.cache, arguments.whisper, names, arguments.minutes)
    shares = {s: share for s, share in SHARES.items() if s not in arguments.leave_out}
    sources = list(shares)
    if arguments.rules:
        follow_rules(clips)
    sampler = EarSampler(clips, shares, arguments.seed)
    config = EarConfig(width=clips[0].heard.shape[-1])
    model = EarToMotion(config, sources)
    sample = torch.cat([c.heard[0] for c in clips[::7] if not c.held_out], dim=1).float()
    model.mean.copy_(sample.mean(dim=1, keepdim=True))
    model.deviation.copy_(sample.std(dim=1, keepdim=True).clamp_min(1e-3))
    run = begin(arguments, model, {"windows": sampler.random}, decay=0.05, warm=0.05, average=0.99)
    weight = landmark_weights()

    def loss(_step: int) -> tuple[Tensor, dict[str, float]]:
        batch = sampler.batch(arguments.batch, arguments.frames)
        return loss_of(model, batch, source_scale(sources, batch.source), weight, machine)

    averaged = descend(arguments, run, loss, lambda x: validate(x, clips, sources))
    path = arguments.out / "ear.pt"
    torch.save({"state": averaged.state_dict(), "config": config.to_json(), "sources": sources}, path)
    return path


def follow_rules(clips: list[EarClip]) -> None:
    """Gives speech without a face the motion that the co-articulation rules derive from its phones."""
    teacher, random = Teacher.load(), np.random.default_rng(0)
    for clip in clips:
        if group(clip) == SOURCE and not clip.held_out:
            motion = teacher.motion(timed(clip.phones), len(clip.motion), FPS, random)
            clip.motion = torch.from_numpy(motion).flatten(1).half()
            clip.weight = torch.ones(1, MOTION).expand(len(motion), MOTION)


def parser() -> argparse.ArgumentParser:
    """Command line."""
    parser = trainer_parser(__doc__, "runs/ear", 1000, 1.5e-3, log_every=500, corpus=False)
    parser.add_argument("--whisper", type=Path, required=True, help="folder of training.speech.whisper")
    parser.add_argument("--leave-out", nargs="*", default=[], choices=[*SHARES], help="sources of motion")
    parser.add_argument("--leave-speech", nargs="*", default=["nathalie_nl"], help="speech to leave out")
    rules = "speech without a face moves by the co-articulation rules (fitted to grid_s1)"
    parser.add_argument("--rules", action=argparse.BooleanOptionalAction, default=True, help=rules)
    parser.add_argument("--minutes", type=float, default=5.0, help="minutes of each language by espeak-ng")
    parser.add_argument("--batch", type=int, default=16)
    parser.add_argument("--frames", type=int, default=72)
    return parser


if __name__ == "__main__":
    train(parser().parse_args())
