"""How FaceTalk's speech model is trained: ours, and as the paper (Aneja et al. 2024) prints it.

`--recipe paper` has eq. 4 alone and Adam at 1e-4, which stays; every step of the noise is as likely as any
other. The paper is silent about batch, number of steps and the range of r: there ours stays. Its head is
NPHM's, of whose training it says nothing.
"""

from training.losses import ACCELERATION, VELOCITY
from training.systems.freetalk.recipes import Recipe

MOTION = {
    "ours": Recipe("ours", 1e-3, 1e-2, True, VELOCITY, ACCELERATION, False, average=0.995),
    "paper": Recipe("paper", 1e-4, 0.0, False, 0.0, 0.0, True),
}
