"""Trains the body of the ear: Whisper's first layers → the face's motion and the phones of any voice.

    python -m training.speech.train_ear --data ../shared/data --out runs/ear

trains on recorded motion in several voices and on speech with phone times in twenty languages. Each way of
recording a face has its own read-out: the tracker of GRID, facegood's capture, and the co-articulation rules
that move speech without a face. Only the body is kept. `--leave-clips s4_` holds a speaker out whole. Seeded;
resumes from `--out/last.pt` with the same bits.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from torch import Tensor, nn

from training.corpus import ear
from training.corpus.clip import MEL_PER_FRAME
from training.corpus.ear import MOTION, SILENCE, EarClip
from training.corpus.split import leave_clips
from training.corpus.spoken import SOURCE
from training.corpus.teacher import Teacher
from training.losses import SCALE_M, feature_concordance, landmark_weights, motion_loss, source_scale
from training.machine import in_bfloat16
from training.run import begin, descend, seeded, trainer_parser
from training.speech.ear import FRAMES_EACH, EarBody, EarConfig
from training.speech.strangers import scores
from training.speech.targets import PhoneHead

SHARES = {"grid_s1": 0.27, "grid_five": 0.2, "facegood_zh": 0.2, SOURCE: 0.3, SILENCE: 0.03}
READOUTS = {"grid_s1": 0, "grid_five": 0, "facegood_zh": 1, SOURCE: 2}
CONCORDANCE = 0.3
ARTICULATION = 0.3
NOISE = 0.1
"""Noise that training adds to the body's input, in standard deviations of each channel."""
DROPOUT = 0.15


class EarToMotion(nn.Module):
    """The body, and one linear read-out for each way of recording a face."""

    def __init__(self, config: EarConfig):
        super().__init__()
        self.encoder = EarBody(config, DROPOUT)
        self.readouts = nn.ModuleList(nn.Linear(config.channels, MOTION) for _ in set(READOUTS.values()))
        self.phones = PhoneHead(config.channels)

    def read_out(self, features: Tensor, index: Tensor) -> Tensor:
        """`features` [B, T, C], `index` [B] of read-outs → [B, T, 204] in units of the source's scale."""
        every = torch.stack([readout(features) for readout in self.readouts])
        return every[index, torch.arange(len(index))]

    def features(self, clip: EarClip) -> Tensor:
        """Features [T, C] of a clip in its own voice."""
        return self.encoder(clip.heard[:1])[0]

    def motion(self, clip: EarClip, source: str) -> Tensor:
        """Motion [T, 204] m of a clip in its own voice, by the read-out of `source`."""
        return self.readouts[READOUTS[source]](self.features(clip)) * SCALE_M[source]


@dataclass
class EarBatch:
    """A batch, in which each row is a window of T frames of motion.

    `heard` [B, K, 2 T, 512]; `motion`, `weight` [B, T, 204]; `phones` [B, 4 T]; `source` [B].
    """

    heard: Tensor
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
            total += len(parts[-1][1])
        heard, *rest = zip(*parts, strict=True)
        return torch.cat(heard, dim=1), *(torch.cat(part) for part in rest), index

    def _part(self, source: str, longest: int):
        clips = self.clips[source]
        clip = clips[self.random.choice(len(clips), p=self.chances[source])]
        frames = min(len(clip.motion), longest)
        start = int(self.random.integers(0, len(clip.motion) - frames + 1))
        heard, moved, said = (slice(k * start, k * (start + frames)) for k in (FRAMES_EACH, 1, MEL_PER_FRAME))
        voice = int(self.random.integers(len(clip.heard)))
        return (
            clip.heard[voice, :, heard],
            clip.motion[moved].float(),
            clip.weight[moved].float(),
            clip.phones[said],
        )


def group(clip: EarClip) -> str:
    """The clip's source if it has a share of its own, else `taught`."""
    return clip.source if clip.source in SHARES else SOURCE


def loss_of(model: EarToMotion, batch: EarBatch, sources: list[str], weight: Tensor):
    """Loss of one batch: motion, concordance and phones. Silence is at rest in every read-out."""
    names = [sources[int(i)] for i in batch.source]
    silent = torch.randint(0, len(model.readouts), (len(names),))
    index = torch.tensor([READOUTS.get(name, int(other)) for name, other in zip(names, silent, strict=True)])
    scale = source_scale(sources, batch.source, SCALE_M | {SILENCE: SCALE_M["grid_s1"]})
    noise = NOISE * model.encoder.deviation[:, None] * torch.randn_like(batch.heard.float())
    with in_bfloat16():
        features = model.encoder(batch.heard.float() + noise)
        prediction = model.read_out(features, index).float()
        said = model.phones.loss(features, batch.phones)
    truth = batch.motion / scale
    motion = motion_loss(prediction - truth, batch.weight * weight)
    has_motion = batch.weight.amax(dim=(1, 2)) > 0
    agreement, parts = feature_concordance(prediction[has_motion], truth[has_motion])
    parts |= {"motion": motion.item(), "said": said.item()}
    return motion + CONCORDANCE * agreement + ARTICULATION * said, parts


def speaker(clip: EarClip) -> str:
    """The source of a clip, and of GRID's five other speakers the speaker."""
    return f"{clip.source} {clip.name.split('_')[0]}" if clip.source == "grid_five" else clip.source


@torch.no_grad()
def validate(model: EarToMotion, clips: list[EarClip]) -> dict[str, float]:
    """Scores of held-out clips by speaker, and the share of phones recognised in held-out speech."""
    model.eval()
    report, held_out = {}, [c for c in clips if c.held_out]
    for name in sorted({speaker(c) for c in held_out if c.source in READOUTS}):
        pairs = [(model.motion(c, c.source), c) for c in held_out if speaker(c) == name]
        report |= {f"{name} {key}": round(value, 3) for key, value in scores(pairs).items()}
    for name in sorted({c.source for c in held_out if c.source not in SHARES}):
        chosen = [c for c in held_out if c.source == name and (c.phones >= 0).all()]
        right = [phones_right(model, c) for c in chosen]
        if right:
            report[f"{name} phones"] = round(float(torch.cat(right).mean()), 3)
    model.train()
    return report


def phones_right(model: EarToMotion, clip: EarClip) -> Tensor:
    """For each frame outside pauses, whether the likeliest segment is the right one."""
    predicted = model.phones.readout(model.features(clip)).argmax(dim=-1)
    true = clip.phones[::MEL_PER_FRAME].long()
    return (predicted == true)[true > 0].float()


def train(arguments) -> Path:
    """Runs the training and returns the checkpoint's path."""
    seeded(arguments)
    left = {*arguments.leave_speech, *ear.UNTIMED}
    names = [s for s in ear.every_source() if s not in left]
    config = EarConfig(taps=arguments.taps)
    clips = ear.load(arguments.data, arguments.cache, names, config.taps, arguments.minutes)
    leave_clips(clips, arguments.leave_clips)
    shares = {s: share for s, share in SHARES.items() if s not in arguments.leave_out}
    teacher, random = Teacher.load(), np.random.default_rng(0)
    for clip in clips:
        if group(clip) == SOURCE and not clip.held_out:
            ear.follow_rules(clip, teacher, random)
    sampler = EarSampler(clips, shares, arguments.seed)
    model = EarToMotion(config)
    sample = torch.cat([c.heard[0] for c in clips[::7] if not c.held_out], dim=1).float()
    model.encoder.mean.copy_(sample.mean(dim=1))
    model.encoder.deviation.copy_(sample.std(dim=1).clamp_min(1e-3))
    run = begin(arguments, model, {"windows": sampler.random}, decay=0.05, warm=0.05, average=0.99)
    weight = landmark_weights()

    def loss(_step: int) -> tuple[Tensor, dict[str, float]]:
        batch = sampler.batch(arguments.batch, arguments.frames)
        return loss_of(model, batch, sampler.sources, weight)

    averaged = descend(arguments, run, loss, lambda x: validate(x, clips))
    path = arguments.out / "ear.pt"
    torch.save({"state": averaged.state_dict(), "config": config.to_json()}, path)
    return path


def parser():
    """Command line."""
    parser = trainer_parser(__doc__, "runs/ear", 1500, 1.5e-3, log_every=500, corpus=False)
    parser.add_argument("--leave-out", nargs="*", default=[], choices=[*SHARES], help="sources to leave out")
    parser.add_argument("--leave-clips", nargs="*", default=[], help="hold out clips whose names begin so")
    parser.add_argument("--leave-speech", nargs="*", default=["nathalie_nl"], help="speech to leave out")
    layers = {"choices": ear.LAYERS, "default": list(ear.LAYERS), "help": "layers of Whisper to read"}
    parser.add_argument("--taps", type=int, nargs="*", **layers)
    parser.add_argument("--minutes", type=float, default=5.0, help="minutes of each language by espeak-ng")
    parser.add_argument("--batch", type=int, default=16)
    parser.add_argument("--frames", type=int, default=72)
    return parser


if __name__ == "__main__":
    train(parser().parse_args())
