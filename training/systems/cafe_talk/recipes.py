"""Training recipes of Cafe-Talk: ours, and the paper's (appendix C.1, eqs. 4 and 5).

`--recipe paper` uses only the squared errors of eqs. 4 and 5, with the same weight for every channel. AdamW
runs at 1e-4 with 16 windows a batch, for 400,000 steps of the base and 300,000 of the adapter. Where the
paper is silent, we make the plainest choice: the learning rate is constant, the weight decay is PyTorch's
default, and weights are not averaged. The paper's 8 GPUs are 8 processes of `accelerate launch` with 16
windows each. The rate of our recipe rises to 8e-4 and then falls until the end.
"""

from dataclasses import dataclass

from training.losses import ACCELERATION, VELOCITY
from training.systems.freetalk.recipes import Recipe


@dataclass(frozen=True)
class Stages(Recipe):
    """A recipe with the number of steps of each of its two stages."""

    base: int = 6000
    adapter: int = 6000


CAFE_TALK = {
    "ours": Stages("ours", 8e-4, 2e-2, True, VELOCITY, ACCELERATION, False, average=0.995),
    "paper": Stages("paper", 1e-4, 1e-2, False, 0.0, 0.0, True, batch=16, base=400_000, adapter=300_000),
}
