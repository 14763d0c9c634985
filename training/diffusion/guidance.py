"""Classifier-free guidance (Ho & Salimans 2021), with a second condition that acts where a mask says."""

from torch import Tensor


def guided(unconditional: Tensor, conditional: Tensor, alpha: float) -> Tensor:
    """`G_∅ + α (G_AC − G_∅)`, all of one shape."""
    return unconditional + alpha * (conditional - unconditional)


def mask_guided(base: Tensor, fine: Tensor, other: Tensor, strength: Tensor) -> Tensor:
    """Adds `βZ ⊙ (G_ACF − other)` to `base`, Cafe-Talk eq. 6.

    `other` is `G_∅` as printed, or `G_AC`, so that a slot does not hear the speech α + β times. `strength`
    is βZ, [B, T, 1] or alike, 0 outside the slots.
    """
    return base + strength * (fine - other)
