"""Where an event gives way to the speech: jaw and chin follow the opening that the speech asks for.

Twin of `rust-core/src/systems/cafe_talk/priority.rs`. A dropped jaw that stays down for the whole of its
slot, or a chin that stays up, hides what is said (Cafe-Talk's own table 4: lower units cost four times the
SyncD of upper ones). Here they act in proportion to how far speech has the mouth open, beside its widest
opening nearby, and so give way where speech closes it; where nobody speaks they act in full.
"""

import torch
from torch import Tensor, nn

from training.corpus.faces import CHANNELS

YIELDING = [CHANNELS.index(c) for c in ("jawOpen", "mouthShrugLower")]
"""Shapes that hold the mouth open or shut."""
OPENS, CLOSES = CHANNELS.index("jawOpen"), CHANNELS.index("mouthClose")
NEAR_FRAMES = 12
"""Half a second to either side: a syllable or two."""
RESTING = 0.03
"""Weight of `jawOpen` that counts as nothing said."""


def yielding(strength: Tensor, spoken: Tensor) -> Tensor:
    """βZ of eq. 6, [B, T, 51], as far as `spoken` weights without events [B, T, 51] leave the mouth free.

    Strengths of `jawOpen` and `mouthShrugLower` are multiplied by the square of the share of the mouth's
    opening, `jawOpen − mouthClose`, of the widest within half a second.
    """
    opening = (spoken[..., OPENS] - spoken[..., CLOSES]).clamp_min(0.0)
    widest = nn.functional.max_pool1d(opening[:, None], 2 * NEAR_FRAMES + 1, 1, NEAR_FRAMES)[:, 0]
    share = torch.ones_like(strength)
    share[..., YIELDING] = (((opening + RESTING) / (widest + RESTING)) ** 2)[..., None]
    return strength * share
