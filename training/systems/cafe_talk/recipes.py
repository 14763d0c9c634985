"""How Cafe-Talk is trained: ours, and as the paper (appendix C.1, eqs. 4 and 5) prints it.

`--recipe paper` has the squares of eqs. 4 and 5 alone, every channel alike, and AdamW at 1e-4 with 16 windows
a batch for 400,000 steps of the base and 300,000 of the adapter. Where the paper is silent (schedule of the
rate, decay, averaged weights) the plainest choice is made: the rate stays, PyTorch's own decay, none. Its
8 GPUs are 8 processes of `accelerate launch`, 16 windows in each. Ours is a rate that rises to 8e-4 and falls
to the end.
"""

from dataclasses import dataclass

from training.losses import ACCELERATION, VELOCITY
from training.systems.freetalk.recipes import Recipe


@dataclass(frozen=True)
class Stages(Recipe):
    """A recipe whose two stages last so many steps."""

    base: int = 6000
    adapter: int = 6000


CAFE_TALK = {
    "ours": Stages("ours", 8e-4, 2e-2, True, VELOCITY, ACCELERATION, False, average=0.995),
    "paper": Stages("paper", 1e-4, 1e-2, False, 0.0, 0.0, True, batch=16, base=400_000, adapter=300_000),
}
