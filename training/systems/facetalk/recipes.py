"""Recipes for training FaceTalk's speech model: ours, and the one that the paper (Aneja et al. 2024) prints.

`--recipe paper` uses eq. 4 alone and Adam at a constant rate of 1e-4, and draws every noise level equally
often. The paper does not give the batch, the number of steps or the range of r, so these stay ours. Its
head is NPHM's; the paper does not say how that head was trained.
"""

from training.losses import ACCELERATION, VELOCITY
from training.systems.freetalk.recipes import Recipe

MOTION = {
    "ours": Recipe("ours", 1e-3, 1e-2, True, VELOCITY, ACCELERATION, False, average=0.995),
    "paper": Recipe("paper", 1e-4, 0.0, False, 0.0, 0.0, True),
}
