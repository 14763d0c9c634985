"""Trains Cafe-Talk: first the base, then the adapter for fine control while the base is frozen.

    python -m training.systems.cafe_talk.train --data ../shared/data --out runs/cafe_base
    python -m training.systems.cafe_talk.train --base runs/cafe_base/cafe_talk.pt ... --out runs/cafe_fine

`--corpus` trains on corpus folders only. With a folder of CLIP, `--text` makes the model learn its places of
the emotions, as in the paper, instead of those of the built-in text space. `--recipe paper` uses the losses,
rate, batch and steps of the paper (`training/systems/cafe_talk/recipes.py`). Training is seeded and resumes
from `--out/last.pt` with the same bits. `--device` and `--precision` choose where and how it computes
(`training/machine.py`).
"""

import argparse
import hashlib
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import torch
from torch import nn

from training import shipped
from training.corpus import arkit, spoken
from training.corpus.action_units import active_units, random_events, sparse, unit_matrix
from training.corpus.bank import Entry
from training.corpus.emotion_weights import with_emotion
from training.corpus.faces import CHANNELS
from training.corpus.shares import lasting
from training.diffusion.schedule import add_noise, noise_levels
from training.losses import feature_concordance, feature_scores, lip_gap, motion_loss
from training.machine import Machine
from training.nn.checkpoint import save
from training.run import begin, descend, seeded, trainer_parser
from training.speech.source import EarSpeech, HubertSpeech
from training.systems.cafe_talk.denoiser import ANY_STYLE, CONFIGS, CafeTalkConfig, Coarse, Denoiser
from training.systems.cafe_talk.recipes import CAFE_TALK, Stages
from training.systems.cafe_talk.sampling import Request, sample_weights
from training.systems.cafe_talk.stored import ADAPTER, EMOTIONS
from training.systems.cafe_talk.stored import load as load_stored
from training.systems.freetalk import recipes
from training.systems.freetalk.train import SHARES, add_speech_flags, speech_source
from training.text.emotions import SYNONYMS
from training.text.stored import load_places

TOKENS = 2000
MASKED_SHARE = 0.2
"""Share of rows without speech and, independently, of rows without the coarse condition (§3.1.2)."""
CONCORDANCE = 0.3
PURE_NOISE_SHARE = 0.3
UNSEEN_WEIGHT = 0.1
UNLABELLED_SHARE = 0.6
FELT_SHARE, CHANGING_SHARE = 0.75, 0.2
LEAST_DEVIATION = 0.05
MOUTH_WEIGHT = 2.0
EVENT_SHARE, SWAPPED_SHARE = 0.5, 0.5
EVENT_WEIGHT = 4.0
"""Loss weight of a channel while an event controls it. A recorded channel weighs 1. In rows with a swapped
label only the controlled channels count, each with 1.
"""
TOLD_INTENSITY = (0.3, 1.2)
"""Lowest and highest intensity of the emotion that a row with a swapped label is given."""
CONTACT_FRAMES, SPOKEN_M = 6, 2.5e-3
"""Lips that meet count as speaking, not as resting, if within this many frames before or after they open
this far (metres, relative to the neutral face).
"""
MET_M, PARTED_M = -0.3e-3, 1.0e-3
"""Openings in metres, relative to the neutral face, at which lips count as fully closed and as fully parted.
Between them `lips_met` falls linearly from 1 to 0.
"""


@dataclass
class Step:
    """One batch: `weights` and their `visibility` in the loss [B, T, 51], and `events` [B, T, 32].

    `coarse` has the form that the denoiser takes. `swapped` [B] marks rows with a swapped label.
    """

    mel: torch.Tensor
    weights: torch.Tensor
    visibility: torch.Tensor
    coarse: Coarse
    events: torch.Tensor
    swapped: torch.Tensor


class CafeTalkTrainer:
    """Data, model and one optimisation step of either stage."""

    def __init__(self, arguments, config: CafeTalkConfig, speech: EarSpeech | HubertSpeech):
        self.config, self.speech = config, speech
        self.joint = arguments.one_stage
        self.fine = self.joint or arguments.base is not None
        self.swapped_share = arguments.swapped_share
        self.recipe: Stages = recipes.chosen(CAFE_TALK, arguments)
        self.machine = Machine(arguments.device, arguments.precision)
        seed = self.machine.seed(arguments.seed)
        self.generator = np.random.default_rng(seed)
        self.random = torch.Generator().manual_seed(seed)
        self.sources, shares = source_shares(speech.entries)
        self.sampler = speech.sampler(self.sources, shares, seed)
        self.alphas = config.diffusion.alphas()
        self.words = load_places(arguments.text)
        self.model = Denoiser(config)
        self.channel_weight = torch.ones(len(CHANNELS))
        self.channel_weight[[i for i, c in enumerate(CHANNELS) if c.startswith(("jaw", "mouth"))]] = (
            MOUTH_WEIGHT
        )
        self.unit_channels = unit_matrix()
        self._measure_scale()
        if arguments.base is not None:
            self._begin_at(arguments.base)
        if arguments.init is not None:
            saved = torch.load(arguments.init, map_location="cpu")["state"]
            self.model.load_state_dict({k: v for k, v in saved.items() if k != EMOTIONS})
        if self.fine and not self.joint:
            self.model.requires_grad_(False)
            self.model.adapter.requires_grad_(True)
        self.machine.place(self.model, arguments.seed)

    def parameters(self) -> list[nn.Parameter]:
        """The parameters that this stage trains."""
        if self.joint:
            return list(self.model.parameters())
        return list(self.model.adapter.parameters()) if self.fine else self.model.base_parameters()

    def _begin_at(self, path: Path) -> None:
        """Loads a finished base. Ignores any adapter in it: training starts with a new one."""
        stored = load_stored(path)
        for part in ("blocks", "width", "coarse", "styles"):
            expected, actual = getattr(self.config, part), getattr(stored.config, part)
            if expected != actual:
                raise ValueError(f"{path}: expected a base with {part} {expected}, got {actual}")
        adapter = {k: v for k, v in self.model.state_dict().items() if k.startswith(ADAPTER)}
        self.model.load_state_dict(stored.base | adapter)

    @torch.no_grad()
    def draw(self, count: int, frames: int) -> Step:
        """A batch of speech with random emotions and, in the second stage, with events."""
        batch = self.sampler.batch(count, frames)
        rows = [self._acted(*row) for row in zip(batch.motion.float(), batch.affect, strict=True)]
        weights, emotion, intensity, events = (torch.stack(column) for column in zip(*rows, strict=True))
        withheld = torch.rand(count, generator=self.random) < UNLABELLED_SHARE
        label = torch.tensor([self.config.styles.index(s) for s in self.sources])[batch.source]
        label = torch.where(withheld, self.config.styles.index(ANY_STYLE), label)
        swapped = torch.rand(count, generator=self.random) < self.swapped_share
        swapped &= events.any(dim=-1).any(dim=-1)
        has_label = (torch.rand(count, generator=self.random) >= MASKED_SHARE) | swapped
        label_places = self._label_places(emotion, swapped)
        visibility = torch.maximum(
            batch.weight.float().clamp_min(UNSEEN_WEIGHT), (intensity[..., None] > 0).float()
        )
        if self.fine:
            visibility = torch.maximum(visibility, EVENT_WEIGHT * self._controlled(events))
            label_intensity = torch.from_numpy(self.generator.uniform(*TOLD_INTENSITY, (count, 1))).float()
            intensity = torch.where(swapped[:, None], label_intensity, intensity)
        device = self.machine.device
        coarse = Coarse(*(t.to(device) for t in (label, label_places, intensity, has_label)))
        return Step(
            *(t.to(device) for t in (batch.mel, weights, visibility)),
            coarse,
            events.to(device),
            swapped.to(device),
        )

    def _controlled(self, events: torch.Tensor) -> torch.Tensor:
        """Z_ctrl of eq. 5: channels of active units, [B, T, 51] of 0 and 1; `events` [B, T, 32]."""
        return (events @ self.unit_channels.to(events.device)).clamp(max=1.0)

    def _acted(self, spoken_weights: torch.Tensor, affect: torch.Tensor):
        """Weights, emotion [T, 15], intensity [T] and events [T, 32] of one row."""
        frames = len(spoken_weights)
        emotion, intensity = affect[:, :-1], affect[:, -1]
        weights = spoken_weights
        closed = lips_met(spoken_weights)
        if not intensity.any() and self.generator.random() < FELT_SHARE:
            emotion, intensity = self._emotion(frames)
            weights = with_emotion(spoken_weights, emotion, intensity, closed)
        if not self.fine:
            return weights, emotion, intensity, torch.zeros(frames, len(self.unit_channels))
        events = sparse(active_units(weights, self.generator), self.generator)
        if self.generator.random() < EVENT_SHARE:
            added = random_events(frames, lips_touch(spoken_weights), self.generator)
            weights = torch.maximum(weights, (weights + added.weights).clamp(max=1.0))
            events = torch.maximum(events, added.active)
        return weights, emotion, intensity, events

    def _emotion(self, frames: int) -> tuple[torch.Tensor, torch.Tensor]:
        """A random emotion and intensity; in some rows both change smoothly."""
        rows = torch.zeros(2, len(self.config.emotions))
        rows[[0, 1], torch.from_numpy(self.generator.integers(0, rows.shape[1], 2))] = 1.0
        levels = torch.from_numpy(self.generator.uniform(0.0, 1.5, 2)).float()
        share = torch.zeros(frames)
        if self.generator.random() < CHANGING_SHARE:
            middle, width = self.generator.uniform(0, frames), self.generator.uniform(5, 20)
            share = torch.sigmoid((torch.arange(frames) - middle) / width * 4.0)
        emotion = (1 - share)[:, None] * rows[0] + share[:, None] * rows[1]
        return emotion, (1 - share) * levels[0] + share * levels[1]

    def _label_places(self, emotion: torch.Tensor, swapped: torch.Tensor) -> torch.Tensor:
        """Places in the text space for the label of each row and frame, [B, T, E].

        They are those of words for the row's emotion, or for another emotion if the label is swapped.
        """
        out = []
        for row, other in zip(emotion, swapped, strict=True):
            names = [self.generator.choice(SYNONYMS[e]) for e in self.config.emotions]
            places = torch.from_numpy(np.stack([self.words.of(str(n)) for n in names]))
            if other:
                places = places.roll(int(self.generator.integers(1, len(places))), dims=0)
            out.append(row @ places)
        return torch.stack(out)

    def loss(self, step: Step) -> tuple[torch.Tensor, dict[str, float]]:
        """Eq. 4, or eq. 5 in rows with a swapped label. Our recipe adds the concordance of mouth features."""
        count, device = len(step.weights), self.machine.device
        pure_noise = 0.0 if self.recipe.plain else PURE_NOISE_SHARE
        t, noise = noise_levels(step.weights.shape, len(self.alphas), pure_noise, self.random)
        clean = self.model.standardise(step.weights)
        noisy = add_noise(clean, noise.to(device), self.alphas[t][:, None, None].to(device))
        has_speech = (torch.rand(count, generator=self.random) >= MASKED_SHARE).to(device)
        with self.machine.autocast():
            events = step.events if self.fine else None
            predicted = self.model(noisy, t.to(device), step.mel, step.coarse, has_speech, events).float()
        plain = torch.ones_like(step.visibility) if self.recipe.plain else step.visibility
        visibility = torch.where(step.swapped[:, None, None], self._controlled(step.events), plain)
        if not self.recipe.plain:
            visibility = visibility * self.channel_weight.to(device)
        error, shares = predicted - clean, (self.recipe.velocity, self.recipe.acceleration)
        if self.fine:
            rows = zip(error.split(1), visibility.split(1), strict=True)
            simple = torch.stack([motion_loss(*row, *shares) for row in rows]).mean()
        else:
            simple = motion_loss(error, visibility, *shares)
        if self.recipe.plain:
            return simple, {"simple": simple.item()}
        as_it_is = has_speech & step.coarse.has_label & ~step.swapped
        shown = [
            arkit.landmarks_of(x[as_it_is]) * 1e3 for x in (self.model.to_weights(predicted), step.weights)
        ]
        agreement, parts = feature_concordance(*shown)
        return simple + CONCORDANCE * agreement, {"simple": simple.item()} | parts

    def _measure_scale(self) -> None:
        """Sets the model's mean and deviation to those of the training weights, emotions included."""
        rows = [self.draw(16, min(self.config.window_frames, 96)).weights for _ in range(12)]
        weights = torch.cat(rows).flatten(0, 1)
        self.model.mean.copy_(weights.mean(dim=0))
        self.model.std.copy_(weights.std(dim=0).clamp_min(LEAST_DEVIATION))


def lips_met(weights: torch.Tensor) -> torch.Tensor:
    """1 where weights [T, 51] bring the lips together, 0 where they are parted, [T]."""
    gap = lip_gap(arkit.landmarks_of(weights))
    return ((PARTED_M - gap) / (PARTED_M - MET_M)).clamp(0.0, 1.0)


def lips_touch(weights: torch.Tensor) -> torch.Tensor:
    """Like `lips_met`, but 0 for lips at rest, which do not part within a quarter of a second, [T]."""
    gap = lip_gap(arkit.landmarks_of(weights))
    around = nn.functional.max_pool1d(gap[None, None], 2 * CONTACT_FRAMES + 1, 1, CONTACT_FRAMES)[0, 0]
    return lips_met(weights) * (around > SPOKEN_M).float()


def source_shares(entries: list[Entry]) -> tuple[list[str], list[float]]:
    """The sources to train on and how often to draw each: `SHARES` for our own, otherwise by length."""
    lengths = lasting(entries)
    shares = {s: share for s, share in SHARES.items() if s in lengths} or lengths
    return list(shares), list(shares.values())


@torch.no_grad()
def validate(trainer: CafeTalkTrainer, model: Denoiser, clips: int) -> dict[str, float]:
    """r and slope of mouth features on held-out clips, generated without an emotion."""
    report = {}
    model.eval()
    for source in sorted({e.source for e in trainer.speech.entries} - {spoken.SOURCE}):
        chosen = [e for e in trainer.speech.entries if e.source == source and e.held_out][:clips]
        pairs = []
        for entry in chosen:
            request = Request.neutral(trainer.config, trainer.words.emotions(), len(entry.motion))
            generated = sample_weights(model, trainer.speech.clip(entry), request).cpu()
            pairs.append((arkit.landmarks_of(generated), arkit.landmarks_of(entry.motion.float())))
        if pairs:
            report |= {f"{source} {k}": v for k, v in feature_scores(pairs).items()}
    model.train()
    return report


def train(arguments) -> Path:
    """Trains one stage. Writes `cafe_talk.pt` with the averaged weights and returns its path."""
    seeded(arguments)
    config = CONFIGS[arguments.config]()
    speech = weights_source(arguments, config)
    config.text_width = load_places(arguments.text).width
    if arguments.corpus:
        config.styles = [*sorted({e.source for e in speech.entries}), ANY_STYLE]
    config.coarse = arguments.coarse
    trainer = CafeTalkTrainer(arguments, config, speech)
    generators = {"trainer": trainer.random, "events": trainer.generator, "windows": trainer.sampler.random}
    recipe = trainer.recipe
    groups = [{"params": trainer.parameters(), "lr": recipe.rate}]
    run = begin(
        arguments, trainer.model, generators, groups=groups, decay=recipe.weight_decay,
        steps=arguments.steps or (recipe.base if arguments.base is None else recipe.adapter),
        factor=None if recipe.annealed else lambda _: 1.0, average=recipe.average, machine=trainer.machine,
    )  # fmt: skip
    lengths = [n for n in (64, 96, 128, 192, 250) if n <= config.window_frames] or [24]

    def loss(_step: int) -> tuple[torch.Tensor, dict[str, float]]:
        frames = lengths[int(torch.randint(0, len(lengths), (1,), generator=trainer.random))]
        return trainer.loss(trainer.draw(batch_of(arguments, recipe, frames), frames))

    emotions = torch.from_numpy(trainer.words.emotions())

    def judge(averaged: Denoiser) -> dict[str, float]:
        scores = validate(trainer, averaged, arguments.validation_clips)
        save(run.out / "cafe_talk.pt", averaged, emotions=emotions, recipe=recipe.record())
        return scores

    descend(arguments, run, loss, judge)
    return arguments.out / "cafe_talk.pt"


def batch_of(arguments, recipe: Stages, frames: int) -> int:
    """Number of windows of `frames` frames in a batch."""
    if arguments.tokens is None and recipe.batch is not None:
        return recipe.batch
    return max(1, (arguments.tokens or TOKENS) // frames)


def weights_source(arguments, config: CafeTalkConfig) -> EarSpeech | HubertSpeech:
    """The speech encoder, and all clips as ARKit weights. The cache keeps solved weights."""
    source = speech_source(arguments, config)
    if arguments.corpus:
        source.entries = arkit.as_weights(source.entries, folders=arguments.corpus)
    elif arguments.hubert is not None:
        source.entries = arkit.as_weights(source.entries, arguments.data)
    else:
        source.entries = solved(source.entries, arguments)
    return source


def solved(entries: list[Entry], arguments) -> list[Entry]:
    """`arkit.as_weights`, read from the cache if the same code already solved the same clips."""
    code = Path(arkit.__file__).read_bytes() + repr([(e.name, len(e.motion)) for e in entries]).encode()
    path = arguments.cache / f"arkit-{hashlib.sha256(code).hexdigest()[:12]}.pt"
    if path.exists():
        results = torch.load(path)
        return [replace(e, motion=m, weight=w) for e, (m, w) in zip(entries, results, strict=True)]
    results = arkit.as_weights(entries, arguments.data)
    partial = path.with_suffix(".partial")
    torch.save([(e.motion.half(), _constant_once(e.weight)) for e in results], partial)
    partial.rename(path)
    return results


def _constant_once(weight: torch.Tensor) -> torch.Tensor:
    """[T, 51] unchanged; if all its rows are equal, its first row expanded to all of them."""
    return weight[:1].expand(len(weight), -1) if weight.var(0).max() == 0 else weight


def parser() -> argparse.ArgumentParser:
    """Command line."""
    parser = trainer_parser(__doc__, "runs/cafe_base", None, None, log_every=300)
    recipes.add_arguments(parser)
    texts = "text space of training.text.space, model folder text_units, or folder of a CLIP checkpoint"
    parser.add_argument("--text", type=Path, default=shipped("text_units"), help=texts)
    parser.add_argument(
        "--base", type=Path, help="cafe_talk.pt of stage 1, or a model folder: trains the adapter beside it"
    )
    parser.add_argument("--init", type=Path, help="start from this cafe_talk.pt")
    parser.add_argument("--one-stage", action="store_true", help="base and adapter learn together (table 3)")
    parser.add_argument("--config", choices=list(CONFIGS), default="compact")
    add_speech_flags(parser, validation_clips=12)
    parser.add_argument(
        "--coarse",
        choices=["ada_ln", "film"],
        default="ada_ln",
        help="how the coarse condition enters (table 2)",
    )
    parser.add_argument("--swapped-share", type=float, default=SWAPPED_SHARE, help="share of rows with eq. 5")
    parser.add_argument("--tokens", type=int, help=f"frames in a batch: {TOKENS}, or the batch of the recipe")
    return parser


if __name__ == "__main__":
    train(parser().parse_args())
