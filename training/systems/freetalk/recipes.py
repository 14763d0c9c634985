"""Recipes for training the models: ours, and the one that FreeTalk (Nocentini et al. 2026) prints.

`--recipe paper` uses the losses of eqs. 15 and 16 and the hyperparameters of section 7. The paper does not
mention a schedule of the learning rate, averaged weights or dropout, so this recipe has none. It has no
speaking styles either: every window gets the style `any`. An epoch shows every clip once.
"""

import argparse
from dataclasses import asdict, dataclass, replace


@dataclass(frozen=True)
class Recipe:
    """Losses, learning rate and length of a training."""

    name: str
    rate: float
    weight_decay: float
    annealed: bool
    """Whether the rate rises at first and falls to zero at the end. Otherwise it is constant."""
    velocity: float
    """λ_v of eq. 15."""
    acceleration: float
    """λ_a of eq. 15."""
    plain: bool
    """Whether the loss is eq. 15 alone and weighs all points alike. If not, the trainer adds terms."""
    dropout: float = 0.0
    average: float = 0.0
    """Decay of the running average of the weights, which is saved. 0 saves the last weights."""
    epochs: int | None = None
    batch: int | None = None

    def steps(self, windows: int) -> int:
        """Number of steps that its epochs take over this many windows."""
        return max(1, self.epochs * windows // (self.batch or 1))

    def record(self) -> dict:
        """The recipe as the checkpoint stores it."""
        return asdict(self)


ATS = {
    "ours": Recipe("ours", 8e-4, 2e-2, True, 0.3, 0.1, False, dropout=0.05, average=0.995),
    "paper": Recipe("paper", 1e-4, 1e-2, False, 0.3, 0.1, True, epochs=100, batch=16),
}
STM = {
    "ours": Recipe("ours", 1.5e-3, 1e-2, True, 0.5, 0.2, False),
    "paper": Recipe("paper", 1e-4, 1e-2, False, 0.5, 0.2, True, epochs=30),
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Adds `--recipe`, and `--rate`, which overrides the recipe's rate."""
    parser.add_argument("--recipe", choices=["ours", "paper"], default="ours")
    parser.add_argument("--rate", type=float, help="learning rate, instead of the recipe's")


def chosen(recipes: dict[str, Recipe], arguments: argparse.Namespace) -> Recipe:
    """The recipe that the command line chooses, with its overrides."""
    overrides = {key: getattr(arguments, key, None) for key in ("rate", "dropout")}
    return replace(recipes[arguments.recipe], **{k: v for k, v in overrides.items() if v is not None})
