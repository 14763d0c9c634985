"""Makes events yield to speech: jaw and chin follow the mouth opening that speech needs.

Twin of `rust-core/src/systems/cafe_talk/priority.rs`. A jaw that stays down for its whole slot, or a chin
that stays up, hides the speech (Cafe-Talk's own table 4: lower units cost four times the SyncD of upper
ones). So these shapes act in proportion to how far speech opens the mouth, relative to its widest opening
nearby. They yield where speech closes the mouth and act in full where nobody speaks.
"""

import torch
from torch import Tensor, nn

from training.corpus.faces import CHANNELS

YIELDING = [CHANNELS.index(c) for c in ("jawOpen", "mouthShrugLower")]
"""Indices of the shapes that hold the mouth open or shut. In events they yield to speech."""
OPENS, CLOSES = CHANNELS.index("jawOpen"), CHANNELS.index("mouthClose")
NEAR_FRAMES = 12
"""Frames to either side in which the widest opening counts: half a second, a syllable or two."""
RESTING = 0.03
"""Added to the opening and to the widest opening. Where the widest opening is far smaller than this, nobody
speaks and the shapes act almost in full.
"""


def yielding(strength: Tensor, spoken: Tensor) -> Tensor:
    """βZ of eq. 6, [B, T, 51], reduced where speech needs the mouth.

    `spoken` [B, T, 51] are the weights without events. The strengths of `jawOpen` and `mouthShrugLower` are
    multiplied by the square of a share: the mouth's opening, `jawOpen − mouthClose`, over its widest within
    half a second.
    """
    opening = (spoken[..., OPENS] - spoken[..., CLOSES]).clamp_min(0.0)
    widest = nn.functional.max_pool1d(opening[:, None], 2 * NEAR_FRAMES + 1, 1, NEAR_FRAMES)[:, 0]
    share = torch.ones_like(strength)
    share[..., YIELDING] = (((opening + RESTING) / (widest + RESTING)) ** 2)[..., None]
    return strength * share
