"""Trains EmoFace: two branches, Mesh Attention and the self-growing scheme (§3.3).

    python -m training.systems.emoface.train --data ../shared/data --out runs/emoface

Reads the recorded motion of grid_s1 and facegood_zh and the acted speech of emodb_de. The faces of emodb_de
are made from its phones and labels. `--corpus` reads vertex sequences of a corpus folder instead, as the
paper does. Then recordings of one speaker and sentence in two emotions are crossed (`pairs`), and the frame
rate is that of `--config`. The emotion encoder is that of `training.systems.emoface.train_emotion_encoder`.
With `--emotion-hubert` it is a second checkpoint, as in the paper. Both encoders are frozen unless
`--tune-encoders` trains them too, with eq. 10. `--recipe paper` is eq. 11 as printed, eq. 10 included, unless
`--no-tune-encoders` leaves it out. Training is seeded and resumes from `--out/last.pt` with the same bits.
"""

import argparse
import math
from pathlib import Path

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from training import shipped
from training.corpus.folder import CorpusFolder
from training.losses import feature_concordance, feature_scores
from training.nn.checkpoint import save
from training.nn.spiral_conv import spirals
from training.run import begin, descend, seeded, trainer_parser
from training.speech.ear import SHIPPED_EAR
from training.systems.cafe_talk.train import lips_met
from training.systems.emoface import folder_clips
from training.systems.emoface.clips import load_clips, of_corpus, template_of
from training.systems.emoface.encoders import UNTAUGHT, Encoders
from training.systems.emoface.model import CONFIGS, EmoFace, EmoFaceConfig, FaceMotion, Inputs
from training.systems.emoface.recipes import EMOFACE, EmoFaceRecipe
from training.systems.emoface.recorded_rows import RecordedRows
from training.systems.emoface.rows import Batch, Rows, Spoken, prototypes
from training.systems.freetalk import recipes

SHARES = {"grid_s1": 0.25, "grid_five": 0.12, "facegood_zh": 0.23, "emodb_de": 0.4}
GUIDED_SHARE = 0.2
"""θ of eq. 6, as a share of the N steps. Until θ the model sees only true previous frames."""
LENGTHS = (36, 48, 60)
PROTOTYPE_CLIPS = 8
"""Most clips of each emotion that encoders in training hear again to compute the prototypes."""
MODELS = "models"
"""Name of the folder in a run that receives trained encoders."""


class Learner(nn.Module):
    """All modules that training changes: the model, and the encoders if they learn."""

    def __init__(self, face: EmoFace, encoders: Encoders | None):
        super().__init__()
        self.face = face
        self.encoders = encoders if encoders is not None and encoders.learn else None

    def groups(self, recipe: EmoFaceRecipe) -> list[dict]:
        """The parameters with their learning rates."""
        groups = [{"params": list(self.face.parameters()), "lr": recipe.rate}]
        if self.encoders is not None:
            rate = recipe.encoder_share * recipe.rate
            groups.append({"params": list(self.encoders.parameters()), "lr": rate})
        return groups


class EmoFaceTrainer:
    """Data, model and one optimisation step."""

    def __init__(
        self, arguments, config: EmoFaceConfig, clips: list[Spoken], encoders: Encoders | None = None
    ):
        template, modes = _template(arguments, config)
        config.vertices = len(template.vertices)
        config.landmarks = template.landmarks.tolist()
        self.config = config
        self.recipe: EmoFaceRecipe = recipes.chosen(EMOFACE, arguments)
        self.grows = not arguments.guided
        self.random = torch.Generator().manual_seed(arguments.seed)
        present = {c.source for c in clips if not c.held_out}
        if not present:
            raise ValueError("expected training clips, got none; mark some as train in clips.tsv")
        self.steps = arguments.steps or self.recipe.steps(sum(not c.held_out for c in clips))
        self.tokens = arguments.tokens
        if encoders is not None:
            self.rows = RecordedRows(clips, config, encoders, arguments.seed, arguments.worn)
        else:
            shares = {s: x for s, x in SHARES.items() if s in present}
            self.rows = Rows(clips, config, shares, arguments.seed, lips_met, arguments.worn)
        self.modes = None if modes is None else torch.from_numpy(modes).float().flatten(1)
        around = spirals(template.vertices, template.triangles, config.kernel, config.dilation)
        self.model = EmoFace(config, around)
        self.model.prototypes.copy_(prototypes(clips, config))
        if arguments.base is not None:
            saved = torch.load(arguments.base, map_location="cpu")["state"]
            self.model.load_state_dict({name: saved[name] for name in self.model.state_dict()})
        if arguments.branches is not None:
            saved = torch.load(arguments.branches, map_location="cpu", weights_only=True)["state"]
            for branch in (self.model.content, self.model.emotion):
                branch.load_state_dict(saved)
        self.template = template
        self.learner = Learner(self.model, encoders)

    def draw(self, step: int) -> Batch:
        """The batch of a step."""
        if self.recipe.whole:
            return self.rows.whole(step)
        frames = LENGTHS[int(torch.randint(0, len(LENGTHS), (1,), generator=self.random))]
        return self.rows.batch(max(1, self.tokens // frames), frames)

    def motion(self, weights: Tensor) -> Tensor:
        """Weights of a clip → displacements of the template [..., D] in units of `scale_m`."""
        moved = weights if self.modes is None else weights @ self.modes
        return moved / self.config.scale_m

    def loss(self, batch: Batch, step: int) -> tuple[Tensor, dict[str, float]]:
        """The losses of eq. 7 to 10, on the second pass of the self-growing scheme.

        The paper's recipe sums them as in eq. 11. Ours takes one mean over all rows and adds the concordance
        of the mouth.
        """
        truth = self.motion(batch.weights)
        before = self.motion(batch.before)
        own_share = self.own_share(step)
        if own_share > 0.0:
            with torch.no_grad():
                own_motion = self.model(before, batch.inputs).motion
            from_model = torch.rand(before.shape[:2], generator=self.random) < own_share
            from_model[:, 0] = False
            before = torch.where(from_model[..., None], own_motion.roll(1, dims=1), before)
        predicted = self.model(before, batch.inputs)
        metres = self.config.scale_m
        errors = {name: (getattr(predicted, name) - truth).abs() for name in ("motion", "content", "emotion")}
        quickness = (predicted.motion.diff(dim=1) - truth.diff(dim=1)).abs()
        recipe, report = self.recipe, {}
        if recipe.plain:
            rows = [x for x in (~batch.crossed, batch.crossed) if x.any()]
            apart = sum(error[x].mean() for error in errors.values() for x in rows) * metres
            velocity = sum(quickness[x].mean() for x in rows) * metres
            total = recipe.reconstruction * apart + recipe.velocity * velocity
        else:
            apart = sum(error.mean() * metres for error in errors.values())
            velocity = quickness.mean() * metres
            shown, true = (self.landmarks(x) * metres * 1e3 for x in (predicted.motion, truth))
            agreement, features = feature_concordance(shown, true)
            total = (
                recipe.reconstruction * apart + recipe.velocity * velocity + recipe.concordance * agreement
            )
            report |= features
        if batch.logits is not None:
            options = {"reduction": "sum", "ignore_index": UNTAUGHT}
            total = total + recipe.classification * F.cross_entropy(batch.logits, batch.labels, **options)
            report["class right"] = (batch.logits.argmax(dim=1) == batch.labels).float().mean().item()
        if batch.crossed is not None and batch.crossed.any():
            report["crossed"] = 1e3 * metres * errors["motion"][batch.crossed].mean().item()
        sizes = {name: 1e3 * metres * error.mean().item() for name, error in errors.items()}
        return total, sizes | report | {"mask": predicted.mask.mean().item()}

    def own_share(self, step: int) -> float:
        """Share of the frames before that the model made, eq. 6: 0 until θ, 1 from (N + θ)/2 on."""
        if not self.grows:
            return 0.0
        first = GUIDED_SHARE * self.steps
        if step < first:
            return 0.0
        return 1.0 - max(0.0, math.cos(math.pi * (step - first) / (self.steps - first)))

    def landmarks(self, motion: Tensor) -> Tensor:
        """Motion of vertices [..., D] → motion of landmarks [..., 204]."""
        return motion.unflatten(-1, (-1, 3))[..., self.config.landmarks, :].flatten(-2)


def _template(arguments, config: EmoFaceConfig):
    """The template and its displacement at weight 1 of each channel (None if clips hold vertices)."""
    if not arguments.corpus:
        return template_of(arguments.data, config.vertices)
    return folder_clips.template_of(CorpusFolder(arguments.corpus)), None


@torch.no_grad()
def validate(trainer: EmoFaceTrainer, model: EmoFace, clips: list[Spoken]) -> dict[str, float]:
    """r and slope of mouth features on held-out clips, except those of emodb_de.

    The model performs them frame by frame from rest.
    """
    report, model = {}, model.eval()
    for source in sorted({c.source for c in clips} - {"emodb_de"}):
        chosen = [c for c in clips if c.source == source]
        frames = max(len(c) for c in chosen)
        inputs = together(chosen, trainer.config, frames)
        predicted = model.perform(inputs)
        shown = trainer.landmarks(predicted.motion) * trainer.config.scale_m
        true = [trainer.landmarks(trainer.motion(c.weights)) * trainer.config.scale_m for c in chosen]
        pairs = [(x[: len(c)], y) for x, y, c in zip(shown, true, chosen, strict=True)]
        report |= {f"{source} {k}": v for k, v in feature_scores(pairs).items()}
    model.train()
    return report


def together(clips: list[Spoken], config: EmoFaceConfig, frames: int) -> Inputs:
    """Puts clips into one batch. Shorter clips repeat their last frame."""

    def padded(x: Tensor) -> Tensor:
        return torch.cat([x.float(), x[-1:].float().expand(frames - len(x), -1)])

    style = torch.full((len(clips),), config.styles.index(config.default_style))
    level = torch.tensor([c.share if c.is_recorded else 1.0 for c in clips])[:, None]
    content = torch.stack([padded(c.content[0]) for c in clips])
    emotion = torch.stack([padded(c.emotion) for c in clips])
    return Inputs(content, emotion, style, level.expand(-1, frames))


def train(arguments) -> Path:
    """Runs the training. Writes `emoface.pt` with the averaged weights and returns its path."""
    seeded(arguments)
    config = CONFIGS[arguments.config]()
    config.vertices = arguments.vertices or config.vertices
    config.kernel, config.dilation, config.delta = (
        arguments.kernel or config.kernel,
        arguments.dilation or config.dilation,
        arguments.delta or config.delta,
    )
    config.fusion = arguments.fusion
    if arguments.corpus:
        clips, encoders = of_corpus(arguments, config)
    else:
        clips, encoders = load_clips(arguments, config), None
    trainer = EmoFaceTrainer(arguments, config, clips, encoders)
    recipe, learner = trainer.recipe, trainer.learner
    if encoders is not None:
        rows = trainer.rows
        print(f"crossed: {rows.pair_count} of {len(rows.training)} training clips have a partner "
              "(the same speaker and text, another emotion)", flush=True)  # fmt: skip
    generators = {"trainer": trainer.random, "rows": trainer.rows.random}
    run = begin(
        arguments, learner, generators, groups=learner.groups(recipe), steps=trainer.steps,
        decay=recipe.weight_decay, factor=None if recipe.annealed else lambda _: 1.0, average=recipe.average,
    )  # fmt: skip
    held_out = [c for c in clips if c.held_out]
    chosen = [c for s in sorted({c.source for c in held_out})
              for c in [c for c in held_out if c.source == s][: arguments.validation_clips]]  # fmt: skip

    def loss(step: int) -> tuple[Tensor, dict[str, float]]:
        return trainer.loss(trainer.draw(step), step)

    template = trainer.template
    extra = {"vertices": torch.from_numpy(template.vertices).float(),
            "triangles": torch.from_numpy(template.triangles), "recipe": recipe.record(),
            "tuned": learner.encoders is not None}  # fmt: skip

    def judge(averaged: Learner) -> dict[str, float]:
        face, heard = averaged.face, chosen
        if averaged.encoders is not None:
            heard = averaged.encoders.hear(chosen)
            face.prototypes.copy_(prototypes(averaged.encoders.hear(few_of_each(clips)), config))
            averaged.encoders.write(run.out / MODELS)
        scores = validate(trainer, face, heard)
        save(run.out / "emoface.pt", face, **extra, spirals=face.mesh_attention.conv.spirals)
        return scores

    descend(arguments, run, loss, judge, clip=recipe.clip)
    return arguments.out / "emoface.pt"


def few_of_each(clips: list[Spoken]) -> list[Spoken]:
    """A few training clips of each emotion, enough to compute prototypes."""
    labels = sorted({c.label for c in clips})
    groups = ([c for c in clips if c.label == label and not c.held_out] for label in labels)
    return [c for group in groups for c in group[:: max(1, len(group) // PROTOTYPE_CLIPS)][:PROTOTYPE_CLIPS]]


def performed(model: EmoFace, clip: Spoken, layer: str = "motion", first: Tensor | None = None) -> FaceMotion:
    """Performs a clip with its own emotion, from rest or from a first pose."""
    return model.perform(together([clip], model.config, len(clip)), first, layer)


def parser() -> argparse.ArgumentParser:
    """Command line."""
    parser = trainer_parser(__doc__, "runs/emoface", None, None, log_every=300, save_every=100, corpus=False)
    recipes.add_arguments(parser)
    parser.add_argument("--corpus", type=Path, help="corpus folder with vertex sequences")
    parser.add_argument(
        "--tune-encoders", action=argparse.BooleanOptionalAction,
        help="train both encoders too, on a corpus folder; the paper's recipe does (default: as the recipe)",
    )  # fmt: skip
    parser.add_argument("--speech", type=Path, default=SHIPPED_EAR, help="ear.pt or folder of the ear")
    parser.add_argument("--hubert", type=Path, help="folder of a HuBERT or wav2vec2 checkpoint")
    parser.add_argument(
        "--emotion-hubert", type=Path, help="such a checkpoint for the emotion, with --corpus"
    )
    parser.add_argument(
        "--emotion-encoder", type=Path, default=shipped("emotion_encoder"), help="emotion encoder"
    )
    parser.add_argument("--config", choices=list(CONFIGS), default="compact")
    parser.add_argument("--vertices", type=int, help="vertices of the template")
    parser.add_argument("--kernel", type=int, help="vertices of a spiral")
    parser.add_argument("--dilation", type=int, help="step along the spiral")
    parser.add_argument("--delta", type=int, help="frames that the convolution sees")
    parser.add_argument("--fusion", choices=["mesh_attention", "sum"], default="mesh_attention")
    parser.add_argument(
        "--guided", action="store_true", help="true frames before until the end, no self-growing"
    )
    parser.add_argument(
        "--worn", type=float, default=0.0, help="share of rows whose frames before show another emotion"
    )
    parser.add_argument("--base", type=Path, help="emoface.pt to go on from")
    both = "decoder of training.import_checkpoint emoface-branches, with which both branches begin"
    parser.add_argument("--branches", type=Path, help=both)
    parser.add_argument("--limit", type=int, help="clips of each source, for a quick look")
    parser.add_argument("--tokens", type=int, default=600, help="frames in a batch")
    parser.add_argument(
        "--validation-clips", type=int, default=24, help="held-out clips of each source to judge at every log"
    )
    return parser


if __name__ == "__main__":
    train(parser().parse_args())
