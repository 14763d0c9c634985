"""Trains the ATS denoiser on top of a speech encoder.

    python -m training.systems.freetalk.train --corpus DIR [DIR ...] --out runs/ats
    python -m training.systems.freetalk.train --data ../shared/data --speech runs/speech/speech.pt

`--corpus` trains on corpus folders (`training/corpus/folder.py`) and nothing else, with their emotions;
`--data` trains on the project's own sources. `--config` is `compact` (default), `paper` or `debug` (trains
and exports in under a minute). Speech features come from the shipped ear, the one of `--speech`, or HuBERT or
wav2vec2 in `--hubert FOLDER`; `paper` needs one of the two flags.
`--recipe paper` uses the paper's losses and rates. Seeded; resumes from `--out/last.pt` bit for bit;
`--device` and `--precision` set where and how it computes, and `accelerate launch` starts it on several GPUs
(`training/machine.py`).
"""

import argparse
from dataclasses import dataclass
from pathlib import Path

import torch

from training.corpus import bank, ear, spoken
from training.corpus.bank import Entry
from training.corpus.clip import Clip
from training.corpus.closures import closures_met
from training.corpus.shares import lasting, measured_scales, with_phones
from training.corpus.split import leave_clips
from training.diffusion.schedule import add_noise, noise_levels
from training.losses import (
    feature_concordance,
    feature_scores,
    landmark_weights,
    lip_gap,
    motion_loss,
    source_scale,
)
from training.machine import Machine, add_arguments
from training.nn.checkpoint import save
from training.run import Run, begin, descend, seeded, trainer_parser
from training.speech.ear import SHIPPED_EAR, load_ear
from training.speech.hubert import HubertFeatures
from training.speech.source import EarSpeech, HubertSpeech, PreparedSpeech
from training.systems.freetalk import recipes
from training.systems.freetalk.ats import (
    ANY_STYLE,
    CONFIGS,
    AtsConfig,
    AtsDenoiser,
    Sampling,
    SpeechInput,
)
from training.systems.freetalk.sampling import sample_motion

STEPS = 1500
DEBUG_STEPS = 20
TOKENS = 2048
CONCORDANCE = 0.3
PURE_NOISE_SHARE = 0.3
UNSEEN_WEIGHT = 0.1
NEUTRAL_GAP_M = 0.8e-3
"""Opening of the inner lips in metres in ICT's neutral face, from which motion is measured."""
UNLABELLED_SHARE = 0.6
SHARES = {"grid_s1": 0.3, "grid_five": 0.2, "facegood_zh": 0.25, "taught": 0.25}
"""How often each source of motion is drawn."""
HEARD_EVERY = 2
"""Closures are counted in every second held-out clip of speech without a face."""


@dataclass
class Step:
    """One training batch: the encoder's input, the true motion with weights, and the conditions.

    `affect` and `source` (the style) are as in `AtsDenoiser.forward`.
    """

    mel: torch.Tensor
    motion: torch.Tensor
    weight: torch.Tensor
    affect: torch.Tensor
    source: torch.Tensor


class AtsTrainer:
    """Data, model and one optimisation step."""

    def __init__(
        self,
        arguments,
        config: AtsConfig,
        speech: PreparedSpeech,
        denoiser: type[AtsDenoiser] = AtsDenoiser,
    ):
        self.config, self.speech = config, speech
        self.machine = Machine(arguments.device, arguments.precision)
        self.recipe = recipes.chosen(recipes.ATS, arguments)
        seed = self.machine.seed(arguments.seed)
        self.random = torch.Generator().manual_seed(seed)
        shares = source_shares(arguments, speech.entries)
        self.sources = list(shares)
        self.scale_m = measured_scales(self.sources, speech.entries)
        self.sampler = speech.sampler(self.sources, list(shares.values()), seed)
        self.heard = judged_by_phones(arguments, speech.entries)
        self.validated = arguments.validation_clips
        self.alphas = config.diffusion.alphas()
        self.model = denoiser(config, dropout=self.recipe.dropout)
        self.landmark_weight = landmark_weights()
        self._measure_scale()
        self.machine.place(self.model, arguments.seed)

    @torch.no_grad()
    def draw(self, count: int, frames: int) -> Step:
        """Draws a batch of motion with its sound and conditions."""
        batch = self.sampler.batch(count, frames)
        withheld = torch.rand(count, generator=self.random) < (1.0 if self.recipe.plain else UNLABELLED_SHARE)
        label = torch.tensor([self.config.styles.index(s) for s in self.sources])[batch.source]
        label = torch.where(withheld, self.config.styles.index(ANY_STYLE), label)
        weight = batch.weight
        if not self.recipe.plain:
            scale = source_scale(self.sources, batch.source, self.scale_m)
            weight = weight.clamp_min(UNSEEN_WEIGHT) * self.landmark_weight / scale.square()
        tensors = [batch.mel, batch.motion, weight, batch.affect, label]
        return Step(*[t.to(self.machine.device) for t in tensors])

    def loss(self, step: Step) -> tuple[torch.Tensor, dict[str, float]]:
        """x₀ loss at random noise levels: eq. 15 in mm, or ours plus the concordance of visible features."""
        count, frames = step.motion.shape[:2]
        device = self.machine.device
        t, noise = self._noise(step.motion.shape)
        clean = self.model.standardise(step.motion)
        noisy = add_noise(clean, noise.to(device), self.alphas[t][:, None, None].to(device))
        room = self.config.window_frames - frames
        offset = int(torch.randint(0, room + 1, (1,), generator=self.random))
        with self.machine.autocast():
            predicted = self.model(noisy, t.to(device), step.mel, step.affect, step.source, offset).float()
        error = (predicted - clean) * self.model.std
        shares = (self.recipe.velocity, self.recipe.acceleration)
        if self.recipe.plain:
            motion = 3e6 * motion_loss(error, step.weight, *shares)
            return motion, {"motion": motion.item()}
        motion = motion_loss(error, step.weight, *shares) * step.weight.mean() / self.landmark_weight.mean()
        agreement, parts = feature_concordance(self.model.to_metres(predicted) * 1e3, step.motion * 1e3)
        return motion + CONCORDANCE * agreement, {"motion": motion.item()} | parts

    def _noise(self, shape: torch.Size) -> tuple[torch.Tensor, torch.Tensor]:
        """Levels [B] and noise of `shape` [B, T, D]. Ours is often pure noise with a random amplitude."""
        if not self.recipe.plain:
            return noise_levels(shape, len(self.alphas), PURE_NOISE_SHARE, self.random)
        t = torch.randint(0, len(self.alphas), shape[:1], generator=self.random)
        return t, torch.randn(shape, generator=self.random)

    def _measure_scale(self) -> None:
        """Sets the model's mean and deviation to those of the training motion."""
        frames = min(self.config.window_frames, 96)
        motion = torch.cat([self.sampler.batch(16, frames).motion for _ in range(12)]).flatten(0, 1)
        self.model.mean.copy_(motion.mean(dim=0))
        self.model.std.copy_(motion.std(dim=0).clamp_min(2e-4))


def source_shares(arguments, entries: list[Entry]) -> dict[str, float]:
    """How often each source is drawn: corpus folders in proportion to length, our sources by `--shares`."""
    if arguments.corpus:
        return lasting(entries)
    sources = {e.source for e in entries if not e.held_out}
    shares = dict(zip(SHARES, arguments.shares, strict=True))
    return {s: shares[s] for s in SHARES if s in sources and s not in arguments.leave_out}


def judged_by_phones(arguments, entries: list[Entry]) -> list[Entry]:
    """Held-out speech with phones, on which closures are counted."""
    if arguments.corpus:
        return with_phones([e for e in entries if e.held_out])
    if arguments.config != "compact":
        return []
    held_out = [e for e in entries if e.source == spoken.SOURCE and e.held_out]
    return held_out[::HEARD_EVERY]


@torch.no_grad()
def validate(trainer: AtsTrainer, model: AtsDenoiser, sampling: Sampling) -> dict:
    """r and slope of every feature on unseen clips, in the source's own style and in `any`."""
    report, speech = {}, trainer.speech
    entries = speech.entries
    model.eval()
    for source in sorted({e.source for e in entries} - {spoken.SOURCE}):
        known = source in trainer.sources
        chosen = [e for e in entries if e.source == source and (e.held_out or not known)]
        chosen = chosen[: trainer.validated]
        if not chosen:
            continue
        for name in (source, ANY_STYLE) if known else (ANY_STYLE,):
            style = trainer.config.styles.index(name)
            pairs = [(clip_motion(speech, model, e, style, sampling), e.motion) for e in chosen]
            report |= {f"{source} {name} {k}": v for k, v in feature_scores(pairs).items()}
    if trainer.validated:
        report |= closure_report(trainer, model, sampling)
    model.train()
    return report


def closure_report(trainer: AtsTrainer, model: AtsDenoiser, sampling: Sampling) -> dict[str, float]:
    """Share of p, b and m at which the lips meet in the style `any`, for each source of speech."""
    met: dict[str, list[bool]] = {}
    style = trainer.config.styles.index(ANY_STYLE)
    for entry in trainer.heard:
        gap = lip_gap(clip_motion(trainer.speech, model, entry, style, sampling))
        label = entry.name.split("/")[0]
        met.setdefault(label, []).extend(closures_met(gap + NEUTRAL_GAP_M, entry.phones))
    return {f"{label} closed": sum(flags) / len(flags) for label, flags in sorted(met.items()) if flags}


@torch.no_grad()
def clip_motion(speech, model, entry, style: int, sampling: Sampling, seed: int = 0) -> torch.Tensor:
    """Predicted motion [T, 204] of one clip in metres, moved to the CPU."""
    affect = entry.affect().expand(len(entry.motion), -1)
    return sample_motion(model, speech.clip(entry), affect, style, seed, sampling).cpu()


def train(arguments, denoiser: type[AtsDenoiser] = AtsDenoiser) -> Path:
    """Runs the training; writes `ats.pt` with the averaged weights and returns its path.

    `denoiser` may be a class that lacks a part, for comparison. The engine runs only the complete one.
    """
    seeded(arguments)
    config = CONFIGS[arguments.config]()
    source = speech_source(arguments, config)
    leave_clips(source.entries, arguments.leave_clips)
    if arguments.corpus:
        fit_to_corpora(config, source.entries)
    trainer = AtsTrainer(arguments, config, source, denoiser)
    if arguments.init is not None:
        start_from(trainer, arguments.init)
    steps = steps_of(arguments, trainer)
    run = start(arguments, trainer, steps)
    lengths = [n for n in (64, 96, 128, 192, 256) if n <= config.window_frames] or [24]

    def loss(_step: int) -> tuple[torch.Tensor, dict[str, float]]:
        frames = lengths[int(torch.randint(0, len(lengths), (1,), generator=trainer.random))]
        return trainer.loss(trainer.draw(batch_of(arguments, trainer.recipe, frames), frames))

    def judge(averaged: AtsDenoiser) -> dict[str, float]:
        scores = validate(trainer, averaged, config.sampling)
        save(run.out / "ats.pt", averaged, recipe=trainer.recipe.record())
        return scores

    descend(arguments, run, loss, judge)
    return arguments.out / "ats.pt"


def steps_of(arguments, trainer: AtsTrainer) -> int:
    """Number of steps: `--steps`, else the recipe's epochs over the training clips, else 1500; `debug` takes
    20 at most."""
    clips = sum(not e.held_out for e in trainer.speech.entries)
    usual = trainer.recipe.steps(clips) if trainer.recipe.epochs else STEPS
    steps = arguments.steps or usual
    return min(steps, DEBUG_STEPS) if arguments.config == "debug" else steps


def batch_of(arguments, recipe: recipes.Recipe, frames: int) -> int:
    """Number of windows of `frames` frames in a batch."""
    if arguments.tokens is None and recipe.batch is not None:
        return recipe.batch
    tokens = 192 if arguments.config == "debug" else arguments.tokens or TOKENS
    return max(1, tokens // frames)


def start(arguments, trainer: AtsTrainer, steps: int) -> Run:
    """Starts a run of `steps` by the trainer's recipe, or resumes it where it stopped."""
    recipe = trainer.recipe
    generators = {"trainer": trainer.random, "windows": trainer.sampler.random}
    factor = None if recipe.annealed else lambda _: 1.0
    groups = [{"params": list(trainer.model.parameters()), "lr": recipe.rate}]
    return begin(
        arguments, trainer.model, generators, groups=groups,
        steps=steps, decay=recipe.weight_decay, factor=factor, average=recipe.average,
        machine=trainer.machine,
    )  # fmt: skip


def start_from(trainer: AtsTrainer, path: Path) -> None:
    """Loads the weights of an `ats.pt`."""
    trainer.model.load_state_dict(torch.load(path)["state"])


def fit_to_corpora(config: AtsConfig, entries: list[Entry]) -> None:
    """Sets the styles to the names of the corpora. Emotions are learned if a training clip has one."""
    config.styles = [*sorted({e.source for e in entries}), ANY_STYLE]
    config.closing_styles = [ANY_STYLE]
    has_emotion = any(e.emotion != "neutral" and e.intensity > 0 and not e.held_out for e in entries)
    config.emotion = "learned" if has_emotion else "added"


def speech_source(arguments, config: AtsConfig) -> PreparedSpeech:
    """The source of speech features that the configuration asks for."""
    if hears_hubert(arguments, config):
        features = HubertFeatures(arguments.hubert)
        config.speech = SpeechInput(features.kind, features.channels)
        return HubertSpeech(features, own_clips(arguments))
    if arguments.config == "debug":
        arguments.limit, arguments.leave_out = arguments.limit or 4, [spoken.SOURCE]
    body = load_ear(arguments.speech or SHIPPED_EAR)
    config.speech = SpeechInput(body.config.model, body.config.channels)
    return EarSpeech(body, ear.for_systems(arguments, body.config.taps))


def hears_hubert(arguments, config: AtsConfig) -> bool:
    """Whether features come from `--hubert`: if it is set, and for `paper` unless `--speech` is set."""
    return arguments.hubert is not None or (config.speech.encoder == "hubert" and arguments.speech is None)


def own_clips(arguments) -> list[Clip]:
    """Clips of the corpus folders, or else of the project's own sources, before they are encoded."""
    if arguments.corpus:
        return bank.clips_of_folders(arguments.corpus, arguments.limit)
    sources = [bank.few(read(arguments.data), arguments.limit) for read in bank.READERS.values()]
    return [clip for clips in sources for clip in clips]


def add_speech_flags(parser: argparse.ArgumentParser, validation_clips: int) -> None:
    """Adds the flags for the encoder, the machine and the log, which `speech_source` and `descend` read."""
    parser.add_argument("--speech", type=Path, help="ear.pt of training.speech.train_ear, or a model folder")
    parser.add_argument("--hubert", type=Path, help="folder of a HuBERT or wav2vec2 checkpoint, such as XLSR")
    parser.add_argument("--leave-speech", nargs="*", default=[], help="speech to leave out (nathalie_nl, …)")
    parser.add_argument("--minutes", type=float, default=5.0, help="minutes of each language by espeak-ng")
    parser.add_argument("--limit", type=int, help="clips of each source, for a quick look")
    add_arguments(parser, "bfloat16")
    parser.add_argument("--tensorboard", action="store_true", help="also log for TensorBoard, into --out")
    parser.add_argument("--stop-at", type=int, help="stop after this step; the same command goes on")
    clips = "held-out clips of each source, at every log"
    parser.add_argument("--validation-clips", type=int, default=validation_clips, help=clips)


def parser() -> argparse.ArgumentParser:
    """Command line."""
    parser = trainer_parser(__doc__, "runs/ats", None, None)
    parser.add_argument("--config", choices=list(CONFIGS), default="compact")
    add_speech_flags(parser, validation_clips=40)
    parser.add_argument("--leave-out", nargs="*", default=[], choices=[*SHARES], help="sources of motion")
    parser.add_argument("--leave-clips", nargs="*", default=[], help="hold out clips whose names begin so")
    default = list(SHARES.values())
    parser.add_argument("--shares", type=float, nargs=len(SHARES), default=default, help=f"of {[*SHARES]}")
    parser.add_argument("--init", type=Path, help="start from this ats.pt")
    parser.add_argument("--tokens", type=int, help=f"frames in a batch: {TOKENS}, or the batch of the recipe")
    recipes.add_arguments(parser)
    parser.add_argument("--dropout", type=float, help="dropout, instead of the recipe's")
    return parser


if __name__ == "__main__":
    train(parser().parse_args())
