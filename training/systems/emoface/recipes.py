"""Training recipes of EmoFace: ours, and the paper's (eq. 7 to 11, appendix A.1).

`--recipe paper` uses eq. 11 with its printed weights, trains both encoders (eq. 10), and uses Adam at a
constant rate of 1e-4 for 200 epochs. A batch is one whole recording with its crossed pair. The recording's
first frame also serves as the frame before it. An epoch shows every training clip once. The paper does not
mention averaged weights, a bound of gradients or decay, so there are none. Its norms are means here.
"""

import math
from dataclasses import dataclass

from training.systems.freetalk.recipes import Recipe


@dataclass(frozen=True, kw_only=True)
class EmoFaceRecipe(Recipe):
    """A recipe with lengths in metres. Its `velocity` is λ3 of eq. 11.

    If it is `plain`, L_self and L_cross are summed as printed. Otherwise one mean covers all rows.
    """

    average: float | None = None
    """Decay of the running average of the weights, which is saved. None saves the last weights."""
    velocity: float = 500.0
    acceleration: float = 0.0
    length: int | None = None
    """Length of the training in steps. None means that `epochs` sets it."""
    clip: float
    """Gradients are clipped to this norm."""
    concordance: float
    """Loss weight of the mouth features that a viewer sees. Our addition to the paper."""
    classification: float
    """λ4 of eq. 11: loss weight of the classification of the emotion."""
    whole: bool
    """Whether a batch is one whole recording and one of its pairs. Otherwise it holds stretches of many."""
    encoder_share: float
    """Learning rate of encoders in training, as a share of the model's rate."""
    tunes_encoders: bool
    """Whether both encoders train too, unless the command line says otherwise."""
    reconstruction: float = 1000.0
    """λ1 = λ2 of eq. 11."""

    def steps(self, windows: int) -> int:
        """Number of steps for this many training clips."""
        return self.length or super().steps(windows)


EMOFACE = {
    "ours": EmoFaceRecipe(
        name="ours", rate=1e-3, weight_decay=0.01, annealed=True, length=6000, average=0.99, clip=1.0,
        concordance=0.5, classification=0.1, plain=False, whole=False, encoder_share=0.1,
        tunes_encoders=False,
    ),
    "paper": EmoFaceRecipe(
        name="paper", rate=1e-4, weight_decay=0.0, annealed=False, epochs=200, clip=math.inf,
        concordance=0.0, classification=1e-4, plain=True, whole=True, encoder_share=1.0,
        tunes_encoders=True,
    ),
}  # fmt: skip
