"""Trains FaceTalk's speech model: from the compact encoder's features to expression codes (§4).

    python -m training.systems.facetalk.train_motion --corpus DIR [DIR ...] --out runs/facetalk_motion
    python -m training.systems.facetalk.train_motion --head runs/facetalk/head.pt --data ../shared/data

`--corpus` trains on corpus folders (`training/corpus/folder.py`) and nothing else. The head's map turns ARKit
weights into codes. Captured weights are used as they are. Recorded landmarks, and landmarks of recorded
vertices, are first fitted with weights that move ICT's landmarks in the same way. Each window is scaled about
the face at rest by r ~ U(low, high) (eq. 8), and r is an input of the model. `--without` leaves a part out,
for table 2. `--memory landmarks` instead trains the small model that follows landmark motion from any source.
`--recipe paper` uses the paper's loss and rate. Seeded; resumes from `--out/last.pt` bit for bit; `--device`
and `--precision` set where and how it computes (`training/machine.py`).
"""

import argparse
from dataclasses import replace
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from training import shipped
from training.corpus import bank, ear
from training.corpus.arkit import as_weights, landmarks_of
from training.corpus.faces import CHANNELS
from training.corpus.grid import tracked_lids
from training.corpus.poses import LIDS, UPPER, emotion_prototypes
from training.corpus.shares import lasting
from training.corpus.windows import Batch
from training.diffusion.schedule import add_noise
from training.losses import feature_concordance, feature_scores, motion_loss
from training.machine import Machine, add_arguments
from training.nn.checkpoint import save
from training.nn.config import SpeechInput
from training.run import begin, descend, seeded, trainer_parser
from training.speech.ear import SHIPPED_EAR, load_ear
from training.speech.hubert import FPS, HubertFeatures
from training.speech.source import EarSpeech, HubertSpeech
from training.systems.cafe_talk.train import solved
from training.systems.facetalk.head import Head
from training.systems.facetalk.motion import (
    CM,
    LANDMARKS,
    Denoiser,
    MotionConfig,
    debug_config,
    landmark_config,
    paper_config,
    sample,
)
from training.systems.facetalk.recipes import MOTION
from training.systems.facetalk.stored import load_head_and_motions, load_motion
from training.systems.freetalk import recipes

SHARES = {"grid_s1": 0.45, "grid_five": 0.2, "facegood_zh": 0.35}
DROPPED_SHARE = 0.25
"""Share of rows that train without their input (speech or landmarks), for classifier-free guidance."""
PURE_NOISE_SHARE = 0.3
CONCORDANCE = 0.3
LANDMARK_WEIGHT = 1.0
LANDMARK_SCALE_MM = 3.0
LEAST_DEVIATION = 0.02
PARTS = ["augmentation", "film", "alignment", "diffusion"]
WIDE_BAND = 1000
CONFIGS = {"compact": MotionConfig, "paper": paper_config, "debug": debug_config}
BESIDE_SHARE, BESIDE_FRAMES = 0.7, (6, 40)
"""Share of rows of landmark motion that get an added emotion and moving brows, and the shortest and longest
time in frames from their peak to their end. Apart from this share, lids shut in half of the rows.
"""
UPPER_FACE = [i for i, name in enumerate(CHANNELS) if name.startswith(("brow", "eyeBlink", "eyeS", "eyeW"))]
TRACKED_LIDS = [i for i in UPPER_FACE if CHANNELS[i].startswith("eye")]
"""Channels of brows and lids, and those among them that the tracker of GRID reads itself."""
UNEVEN_MM = 1.5
"""Largest standard deviation, in mm, of the noise on landmarks that imitates tracking errors. Each row draws
its own deviation between 0 and this.
"""


class Codes:
    """Maps ARKit weights to a head's z_ex, and z_ex back to weights with the pseudo-inverse."""

    def __init__(self, head):
        with torch.no_grad():
            self.matrix = head.expression_code.weight.detach().clone()
            self.at_rest = head.expression(torch.zeros(1, len(head.config.channels)))[0].detach()
        self.back = torch.linalg.pinv(self.matrix)

    def of(self, weights: Tensor) -> Tensor:
        """[..., 51] → [..., X]."""
        return weights @ self.matrix.T + self.at_rest

    def weights(self, codes: Tensor) -> Tensor:
        """[..., X] → [..., 51]."""
        return (codes - self.at_rest) @ self.back.T

    def to(self, device: torch.device) -> None:
        """Moves the maps to a device."""
        self.matrix, self.at_rest, self.back = (x.to(device) for x in (self.matrix, self.at_rest, self.back))


def with_weights(entries: list[bank.Entry], arguments) -> list[bank.Entry]:
    """The same clips with ARKit weights as motion. Clips of GRID have the lids that were tracked."""
    if arguments.corpus:
        return as_weights(entries, folders=arguments.corpus)
    lids = tracked_lids(arguments.data, [CHANNELS[i] for i in TRACKED_LIDS])
    return [with_lids(e, lids.get((e.source, e.name))) for e in solved(entries, arguments)]


def with_lids(entry: bank.Entry, lids: np.ndarray | None) -> bank.Entry:
    """The clip with tracked weights of the lids [T, L] in its motion, if there are any."""
    if lids is None:
        return entry
    motion, weight = entry.motion.clone(), entry.weight.expand(entry.motion.shape).clone()
    motion[:, TRACKED_LIDS] = torch.from_numpy(lids[: len(motion)]).to(motion)
    weight[:, TRACKED_LIDS] = 1.0
    return replace(entry, motion=motion, weight=weight)


class Trainer:
    """Data, model and one step."""

    def __init__(self, arguments, speech: EarSpeech | HubertSpeech, heard: SpeechInput, head):
        self.codes, self.speech = Codes(head), speech
        self.machine = Machine(arguments.device, arguments.precision)
        self.recipe = recipes.chosen(MOTION, arguments)
        seed = self.machine.seed(arguments.seed)
        self.random = torch.Generator().manual_seed(seed)
        self.without = arguments.without
        self.by_landmarks = arguments.memory == LANDMARKS
        codes = head.config.expression_code
        config = replace(CONFIGS[arguments.config](), codes=codes, speech=heard)
        if self.by_landmarks:
            config = landmark_config(codes)
        self.prototypes = emotion_prototypes()
        config.film = "film" not in self.without
        if "alignment" in self.without:
            config.band = WIDE_BAND
        if "diffusion" in self.without:
            config.sampling = replace(config.sampling, steps=1, temperature=0.0)
        still = self.by_landmarks or "augmentation" in self.without
        self.low, self.high = (1.0, 1.0) if still else arguments.augment
        shares = lasting(speech.entries) if arguments.corpus else SHARES
        self.sampler = speech.sampler(list(shares), list(shares.values()), seed)
        self.alphas = config.diffusion.alphas()
        self.model = Denoiser(config)
        rows = torch.cat([self.weights(self.sampler.batch(16, 96)).flatten(0, 1) for _ in range(12)])
        codes = self.codes.of(rows)
        self.model.mean.copy_(codes.mean(0))
        self.model.std.copy_(codes.std(0).clamp_min(LEAST_DEVIATION))
        if self.by_landmarks:
            rows = torch.cat([self.beside(self.weights(self.sampler.batch(32, 48))) for _ in range(20)])
            self.model.begin_direct(self.memory(None, rows).flatten(0, 1), self.codes.of(rows).flatten(0, 1))
        if arguments.start is not None:
            self.model.go_on_from(motion_of(arguments.start, arguments.memory))
        self.machine.place(self.model, arguments.seed)
        self.codes.to(self.machine.device)

    def loss(self, count: int, frames: int) -> tuple[Tensor, dict[str, float]]:
        """Eq. 4. Our recipe adds the same loss on landmarks that the codes move, and their concordance."""
        device = self.machine.device
        batch = self.sampler.batch(count, frames)
        r = self.low + (self.high - self.low) * torch.rand(count, generator=self.random)
        weights = r[:, None, None] * self.weights(batch)
        if self.by_landmarks:
            weights = self.beside(weights)
        t, noise = self._noise(count, frames)
        has_speech = torch.rand(count, generator=self.random) >= DROPPED_SHARE
        with torch.no_grad(), self.machine.autocast():
            memory = self.memory(batch, weights)
        weights, has_speech = weights.to(device), has_speech.to(device)
        clean = self.model.standardise(self.codes.of(weights))
        noisy = add_noise(clean, noise.to(device), self.alphas[t][:, None, None].to(device))
        if "diffusion" in self.without:
            noisy = torch.zeros_like(noisy)
        with self.machine.autocast():
            predicted = self.model(noisy, t.to(device), memory, has_speech, r.to(device)).float()
        shares = (self.recipe.velocity, self.recipe.acceleration)
        simple = motion_loss(predicted - clean, torch.ones_like(clean), *shares)
        if self.recipe.plain:
            return simple, {"simple": simple.item()}
        shown, truth = (
            1e3 * landmarks_of(w) for w in (self.codes.weights(self.model.to_codes(predicted)), weights)
        )
        near = motion_loss((shown - truth) / LANDMARK_SCALE_MM, torch.ones_like(shown))
        agreement, parts = feature_concordance(shown[has_speech], truth[has_speech])
        total = simple + LANDMARK_WEIGHT * near + CONCORDANCE * agreement
        return total, {"simple": simple.item(), "landmarks": near.item()} | parts

    def weights(self, batch: Batch) -> Tensor:
        """Weights of a batch, [B, T, 51], with brows and lids in every row.

        Speech hardly determines brows and lids, and some recordings lack them. At rest there, they would
        teach that such voices never blink. So these rows get those of other rows of the batch.
        """
        weights = batch.motion.float().clone()
        if self.by_landmarks:
            return weights
        sees_upper = batch.weight[..., UPPER_FACE].flatten(1).amax(1) > 0.0
        donors, blind = sees_upper.nonzero()[:, 0], (~sees_upper).nonzero()[:, 0]
        if len(donors) and len(blind):
            chosen = donors[torch.randint(0, len(donors), (len(blind),), generator=self.random)]
            weights[blind[:, None, None], torch.arange(weights.shape[1])[:, None], UPPER_FACE] = weights[
                chosen[:, None, None], torch.arange(weights.shape[1])[:, None], UPPER_FACE
            ]
        return weights

    def _noise(self, count: int, frames: int) -> tuple[Tensor, Tensor]:
        """Noise levels [B] and noise for codes [B, T, X]. Our recipe often draws the level of pure noise."""
        t = torch.randint(0, len(self.alphas), (count,), generator=self.random)
        if not self.recipe.plain:
            pure = torch.rand(count, generator=self.random) < PURE_NOISE_SHARE
            t = torch.where(pure, len(self.alphas) - 1, t)
        if "diffusion" in self.without:
            t = torch.full_like(t, len(self.alphas) - 1)
        noise = torch.randn(count, frames, len(self.model.mean), generator=self.random)
        return t, torch.zeros_like(noise) if "diffusion" in self.without else noise

    def memory(self, batch, weights: Tensor) -> Tensor:
        """Memory of the model, [B, T, C]: speech features, or the landmarks that `weights` move."""
        if not self.by_landmarks:
            return batch.mel.to(self.machine.device)
        moved = landmarks_of(weights)
        off = 1e-3 * UNEVEN_MM * torch.rand(len(moved), 1, 1, generator=self.random)
        moved = moved + off * torch.randn(moved.shape, generator=self.random)
        return (CM * moved).to(self.model.mean.device)

    def beside(self, weights: Tensor) -> Tensor:
        """Adds to weights [B, T, 51] what recordings of speech lack: emotions, moving brows and shut lids."""
        count, frames = weights.shape[:2]

        def uniform(*shape: int) -> Tensor:
            return torch.rand(*shape, generator=self.random)

        added = self.prototypes[
            torch.randint(0, len(self.prototypes), (count,), generator=self.random)
        ] * uniform(count, 1)
        added[:, UPPER] += uniform(count, len(UPPER)) * (uniform(count, len(UPPER)) < 0.2)
        added = added * (uniform(count, 1) < BESIDE_SHARE)
        low, high = BESIDE_FRAMES
        at = torch.arange(frames) - frames * uniform(count, 1)
        length = low + (high - low) * uniform(count, 1)
        out = weights + added[:, None] * (1.0 - (at / length).square()).clamp_min(0.0)[..., None]
        shut = (1.0 - ((torch.arange(frames) - frames * uniform(count, 1)) / 4.0).square()).clamp_min(0.0)
        out[..., LIDS] = torch.maximum(out[..., LIDS], (shut * (uniform(count, 1) < 0.5))[..., None])
        return out.clamp(0.0, 1.3)


def speech_of(arguments) -> tuple[EarSpeech | HubertSpeech, SpeechInput]:
    """The source of speech features and its description. The paper uses wav2vec2 (section 4): `--hubert`."""
    if arguments.hubert is None:
        body = load_ear(arguments.speech or SHIPPED_EAR)
        speech = EarSpeech(body, ear.recorded(arguments, body.config.taps))
        heard = SpeechInput(body.config.model, body.config.channels)
    else:
        features = HubertFeatures(arguments.hubert, FPS)
        read = (c for reader in bank.READERS.values() for c in reader(arguments.data))
        clips = bank.clips_of_folders(arguments.corpus) if arguments.corpus else list(read)
        speech = HubertSpeech(features, clips)
        heard = SpeechInput(features.kind, features.channels, features.transformer_fps)
    speech.entries = with_weights(speech.entries, arguments)
    return speech, heard


@torch.no_grad()
def validate(trainer: Trainer, model: Denoiser, clips: int) -> dict[str, float]:
    """r and slope of the visible features (`feature_scores`) on held-out clips."""
    report, entries = {}, trainer.speech.entries
    model.eval()
    for source in sorted({e.source for e in entries if e.held_out}):
        pairs = []
        for entry in [e for e in entries if e.source == source and e.held_out][:clips]:
            truth = landmarks_of(entry.motion.float())
            memory = CM * truth if trainer.by_landmarks else trainer.speech.clip(entry)
            predicted = trainer.codes.weights(sample(model, memory)).cpu()
            pairs.append((landmarks_of(predicted), truth))
        if pairs:
            report |= {f"{source} {k}": v for k, v in feature_scores(pairs).items()}
    model.train()
    return report


def motion_of(path: Path, memory: str) -> Denoiser:
    """Loads a motion.pt, or from a model folder the model with that input."""
    if path.is_file():
        return load_motion(path)
    name = "landmark_motion" if memory == LANDMARKS else "motion"
    return load_head_and_motions(path)[1][name]


def head_of(path: Path) -> Head:
    """Loads a head.pt, or the head of a model folder."""
    return load_head_and_motions(path)[0]


def train(arguments) -> Path:
    """Runs the training; writes `motion.pt` with the averaged weights and returns its path."""
    seeded(arguments)
    trainer = Trainer(arguments, *speech_of(arguments), head_of(arguments.head))
    recipe = trainer.recipe
    generators = {"trainer": trainer.random, "windows": trainer.sampler.random}
    groups = [{"params": list(trainer.model.parameters()), "lr": recipe.rate}]
    run = begin(
        arguments, trainer.model, generators, groups=groups,
        decay=recipe.weight_decay, warm=0.05, factor=None if recipe.annealed else lambda _: 1.0,
        average=recipe.average, machine=trainer.machine,
    )  # fmt: skip

    def judge(averaged: Denoiser) -> dict[str, float]:
        save(run.out / "motion.pt", averaged, recipe=recipe.record())
        return validate(trainer, averaged, arguments.validation_clips)

    descend(arguments, run, lambda _: trainer.loss(arguments.windows, arguments.frames), judge)
    return arguments.out / "motion.pt"


def parser() -> argparse.ArgumentParser:
    """Command line."""
    parser = trainer_parser(__doc__, "runs/facetalk_motion", 4000, None, log_every=200, save_every=500)
    parser.add_argument("--head", type=Path, default=shipped("facetalk_compact"))
    parser.add_argument("--start", type=Path, help="motion.pt, or a model folder, to go on from")
    parser.add_argument("--speech", type=Path, help="ear.pt of training.speech.train_ear, or a model folder")
    parser.add_argument("--hubert", type=Path, help="folder of a wav2vec2 or HuBERT checkpoint instead")
    parser.add_argument(
        "--memory", choices=["speech", LANDMARKS], default="speech", help="input of the model"
    )
    parser.add_argument("--config", choices=list(CONFIGS), default="compact")
    recipes.add_arguments(parser)
    add_arguments(parser, "float32")
    parser.add_argument("--stop-at", type=int, help="stop after this step; the same command goes on")
    clips = "held-out clips of each source, at every log"
    parser.add_argument("--validation-clips", type=int, default=12, help=clips)
    parser.add_argument(
        "--without", nargs="*", choices=PARTS, default=[], help="parts to leave out (table 2)"
    )
    parser.add_argument("--augment", type=float, nargs=2, default=[0.7, 1.3], metavar=("LOW", "HIGH"))
    parser.add_argument("--windows", type=int, default=24, help="windows in a batch")
    parser.add_argument("--frames", type=int, default=48, help="frames of a window")
    return parser


if __name__ == "__main__":
    train(parser().parse_args())
