"""How EmoFace is trained: as we do, and as its paper prints it (eq. 7 to 11, appendix A.1).

`--recipe paper` takes eq. 11 with its printed weights, Adam at a rate of 1e-4 that stays, a batch of one
recording from end to end with its crossed pair, 200 epochs, and the first frame of a recording for the frame
before it. An epoch shows every training clip once. Where the paper is silent (averaged weights, bound of
gradients, decay) there is none; its norms are means here.
"""

import argparse
import math
from dataclasses import asdict, dataclass, replace


@dataclass(frozen=True)
class Recipe:
    """Losses, learning rate and length of a training; lengths are metres."""

    name: str
    rate: float
    weight_decay: float
    annealed: bool
    """Whether the rate rises at first and falls to zero at the end; otherwise it stays."""
    steps: int | None
    """None: of `epochs`."""
    average: float | None
    """Decay of the averaged weights that are kept; none keeps the last ones."""
    clip: float
    """Longest gradient."""
    concordance: float
    """Weight of what a viewer sees of the mouth; ours."""
    classification: float
    """λ4 of eq. 11."""
    plain: bool
    """Whether L_self and L_cross are summed as printed; otherwise all rows have one mean."""
    whole: bool
    """Whether a batch is one recording from end to end and one of its pairs; otherwise stretches of many."""
    encoder_share: float
    """Rate of encoders that learn too, over that of the model."""
    reconstruction: float = 1000.0
    """λ1 = λ2 of eq. 11."""
    velocity: float = 500.0
    """λ3 of eq. 11."""
    epochs: int = 200

    def steps_of(self, clips: int) -> int:
        """How many it takes with so many training clips."""
        return self.steps or self.epochs * clips

    def record(self) -> dict:
        """For the checkpoint."""
        return asdict(self)


RECIPES = {
    "ours": Recipe(
        "ours", 1e-3, 0.01, annealed=True, steps=6000, average=0.99, clip=1.0, concordance=0.5,
        classification=0.1, plain=False, whole=False, encoder_share=0.1,
    ),
    "paper": Recipe(
        "paper", 1e-4, 0.0, annealed=False, steps=None, average=None, clip=math.inf, concordance=0.0,
        classification=1e-4, plain=True, whole=True, encoder_share=1.0,
    ),
}  # fmt: skip


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """`--recipe`, and the rate that overrides its own."""
    parser.add_argument("--recipe", choices=list(RECIPES), default="ours")
    parser.add_argument("--rate", type=float, help="of learning, in place of the recipe's")


def choose(arguments: argparse.Namespace) -> Recipe:
    """The recipe of the command line."""
    recipe = RECIPES[arguments.recipe]
    return recipe if arguments.rate is None else replace(recipe, rate=arguments.rate)
