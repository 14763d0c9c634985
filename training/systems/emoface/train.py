"""Trains EmoFace: two branches, Mesh Attention and the self-growing scheme (§3.3).

    python -m training.systems.emoface.train --data ../shared/data --out runs/emoface

Reads the recorded motion of grid_s1 and facegood_zh and the felt speech of emodb_de, whose faces are made
from its phones and labels; `--corpus` reads vertex sequences of a corpus folder instead, as the paper does.
The emotion encoder is that of `training.systems.emoface.train_feeling` and stays as it is, or with
`--feeling-hubert` a second checkpoint, as in the paper.
Seeded; resumes from `--out/last.pt` with the same bits.
"""

import argparse
import math
from pathlib import Path

import torch
from torch import Tensor

from training import shipped
from training.corpus.folder import CorpusFolder
from training.losses import feature_concordance, feature_scores
from training.nn.checkpoint import save
from training.nn.spiral_conv import spirals
from training.run import begin, descend, seeded, trainer_parser
from training.systems.cafe_talk.train import lips_met
from training.systems.emoface import folder_clips
from training.systems.emoface.clips import load_clips, template_of
from training.systems.emoface.model import CONFIGS, EmoFace, EmoFaceConfig, Inputs, Made
from training.systems.emoface.rows import Batch, Rows, Spoken, prototypes

SHARES = {"grid_s1": 0.35, "facegood_zh": 0.25, "emodb_de": 0.4}
RECONSTRUCTION, VELOCITY = 1000.0, 500.0
"""λ1 = λ2 and λ3 of eq. 11, for metres; crossed rows stand beside the others in every batch."""
CONCORDANCE = 0.5
"""Of what a viewer sees of the mouth; ours."""
GUIDED_SHARE = 0.2
"""θ of eq. 6 over N."""
LENGTHS = (36, 48, 60)


class EmoFaceTrainer:
    """Data, model and one optimisation step."""

    def __init__(self, arguments, config: EmoFaceConfig, clips: list[Spoken]):
        template, modes = _template(arguments, config)
        config.vertices = len(template.vertices)
        config.landmarks = template.landmarks.tolist()
        self.config, self.steps = config, arguments.steps
        self.grows = not arguments.guided
        self.random = torch.Generator().manual_seed(arguments.seed)
        present = {c.source for c in clips if not c.held_out}
        shares = {s: x for s, x in SHARES.items() if s in present} or {s: 1.0 for s in sorted(present)}
        self.rows = Rows(clips, config, shares, arguments.seed, lips_met, arguments.worn)
        self.modes = None if modes is None else torch.from_numpy(modes).float().flatten(1)
        around = spirals(template.vertices, template.triangles, config.kernel, config.dilation)
        self.model = EmoFace(config, around)
        self.model.prototypes.copy_(prototypes(clips, config))
        if arguments.base is not None:
            self.model.load_state_dict(torch.load(arguments.base, map_location="cpu")["state"])
        self.template = template

    def motion(self, weights: Tensor) -> Tensor:
        """Weights of a clip → displacements of the template [..., D] in units of `scale_m`."""
        moved = weights if self.modes is None else weights @ self.modes
        return moved / self.config.scale_m

    def loss(self, batch: Batch, step: int) -> tuple[Tensor, dict[str, float]]:
        """Eq. 7 to 9 on the second pass of the self-growing scheme, with the concordance of the mouth."""
        truth = self.motion(batch.weights)
        before = self.motion(batch.before)
        own = self.own_share(step)
        if own > 0.0:
            with torch.no_grad():
                found = self.model(before, batch.inputs).motion
            taken = torch.rand(before.shape[:2], generator=self.random) < own
            taken[:, 0] = False
            before = torch.where(taken[..., None], found.roll(1, dims=1), before)
        made = self.model(before, batch.inputs)
        metres = self.config.scale_m
        parts = {
            name: (getattr(made, name) - truth).abs().mean() * metres
            for name in ("motion", "content", "feeling")
        }
        velocity = (made.motion.diff(dim=1) - truth.diff(dim=1)).abs().mean() * metres
        shown, true = (self.landmarks(x) * metres * 1e3 for x in (made.motion, truth))
        agreement, features = feature_concordance(shown, true)
        total = RECONSTRUCTION * sum(parts.values()) + VELOCITY * velocity + CONCORDANCE * agreement
        report = {name: 1e3 * value.item() for name, value in parts.items()}
        return total, report | features | {"mask": made.mask.mean().item()}

    def own_share(self, step: int) -> float:
        """How many of the frames before are the model's own, eq. 6: 0 until θ, 1 from (N + θ)/2 on."""
        if not self.grows:
            return 0.0
        first = GUIDED_SHARE * self.steps
        if step < first:
            return 0.0
        return 1.0 - max(0.0, math.cos(math.pi * (step - first) / (self.steps - first)))

    def landmarks(self, motion: Tensor) -> Tensor:
        """[..., D] → [..., 204]."""
        return motion.unflatten(-1, (-1, 3))[..., self.config.landmarks, :].flatten(-2)


def _template(arguments, config: EmoFaceConfig):
    """The template, and what moves it at weight 1 of each channel; none where clips hold its vertices."""
    if not arguments.corpus:
        return template_of(arguments.data, config.vertices)
    return folder_clips.template_of(CorpusFolder(arguments.corpus)), None


@torch.no_grad()
def validate(trainer: EmoFaceTrainer, model: EmoFace, clips: list[Spoken]) -> dict[str, float]:
    """r and slope of what a viewer sees, frame after frame from rest, on held-out neutral clips."""
    report, model = {}, model.eval()
    for source in sorted({c.source for c in clips} - {"emodb_de"}):
        chosen = [c for c in clips if c.source == source]
        frames = max(len(c) for c in chosen)
        inputs = together(chosen, trainer.config, frames)
        made = model.perform(inputs)
        shown = trainer.landmarks(made.motion) * trainer.config.scale_m
        true = [trainer.landmarks(trainer.motion(c.weights)) * trainer.config.scale_m for c in chosen]
        pairs = [(x[: len(c)], y) for x, y, c in zip(shown, true, chosen, strict=True)]
        report |= {f"{source} {k}": v for k, v in feature_scores(pairs).items()}
    model.train()
    return report


def together(clips: list[Spoken], config: EmoFaceConfig, frames: int) -> Inputs:
    """Clips in one batch, the last frame held to the end."""

    def padded(x: Tensor) -> Tensor:
        return torch.cat([x.float(), x[-1:].float().expand(frames - len(x), -1)])

    style = torch.full((len(clips),), config.styles.index(config.default_style))
    content = torch.stack([padded(c.content[0]) for c in clips])
    feeling = torch.stack([padded(c.feeling) for c in clips])
    return Inputs(content, feeling, style, torch.ones(len(clips), frames))


def train(arguments) -> Path:
    """Runs the training; writes `emoface.pt` with the averaged weights and returns its path."""
    seeded(arguments)
    config = CONFIGS[arguments.config]()
    config.vertices = arguments.vertices or config.vertices
    config.kernel, config.dilation, config.delta = (
        arguments.kernel or config.kernel,
        arguments.dilation or config.dilation,
        arguments.delta or config.delta,
    )
    config.fusion = arguments.fusion
    clips = load_clips(arguments, config)
    trainer = EmoFaceTrainer(arguments, config, clips)
    generators = {"trainer": trainer.random, "rows": trainer.rows.random}
    run = begin(arguments, trainer.model, generators, average=0.99)
    held_out = [c for c in clips if c.held_out]
    chosen = [c for s in sorted({c.source for c in held_out})
              for c in [c for c in held_out if c.source == s][: arguments.validation_clips]]  # fmt: skip

    def loss(step: int) -> tuple[Tensor, dict[str, float]]:
        frames = LENGTHS[int(torch.randint(0, len(LENGTHS), (1,), generator=trainer.random))]
        return trainer.loss(trainer.rows.batch(max(1, arguments.tokens // frames), frames), step)

    template = trainer.template
    kept = {"vertices": torch.from_numpy(template.vertices).float(),
            "triangles": torch.from_numpy(template.triangles)}  # fmt: skip

    def judge(averaged: EmoFace) -> dict[str, float]:
        scores = validate(trainer, averaged, chosen)
        save(run.out / "emoface.pt", averaged, **kept, spirals=averaged.mesh_attention.conv.spirals)
        return scores

    descend(arguments, run, loss, judge)
    return arguments.out / "emoface.pt"


def performed(model: EmoFace, clip: Spoken, layer: str = "motion") -> Made:
    """A held-out clip with its own feeling, from rest."""
    return model.perform(together([clip], model.config, len(clip)), layer=layer)


def parser() -> argparse.ArgumentParser:
    """Command line."""
    parser = trainer_parser(__doc__, "runs/emoface", 6000, 1e-3, log_every=300, save_every=100, corpus=False)
    parser.add_argument("--corpus", type=Path, help="corpus folder with vertex sequences")
    parser.add_argument("--hubert", type=Path, help="folder of a HuBERT or wav2vec2 checkpoint")
    parser.add_argument(
        "--feeling-hubert", type=Path, help="the same for the feeling, of a model on a corpus folder"
    )
    parser.add_argument("--feeling", type=Path, default=shipped("feeling"), help="emotion encoder")
    parser.add_argument("--config", choices=list(CONFIGS), default="compact")
    parser.add_argument("--vertices", type=int, help="of the template")
    parser.add_argument("--kernel", type=int, help="vertices of a spiral")
    parser.add_argument("--dilation", type=int, help="every so many of them")
    parser.add_argument("--delta", type=int, help="frames that the convolution sees")
    parser.add_argument("--fusion", choices=["mesh_attention", "sum"], default="mesh_attention")
    parser.add_argument(
        "--guided", action="store_true", help="true frames before to the end: no self-growing"
    )
    parser.add_argument("--worn", type=float, default=0.0, help="rows whose past wears another feeling")
    parser.add_argument("--base", type=Path, help="emoface.pt to go on from")
    parser.add_argument("--voices", type=int, default=4)
    parser.add_argument("--limit", type=int, help="clips of each source, for a quick look")
    parser.add_argument("--tokens", type=int, default=600, help="frames in a batch")
    parser.add_argument("--validation-clips", type=int, default=24, help="of each source, at every log")
    return parser


if __name__ == "__main__":
    train(parser().parse_args())
