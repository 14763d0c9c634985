"""Classifier-free guidance (Ho & Salimans 2021), with a second condition that acts within a mask."""

from torch import Tensor


def guided(unconditional: Tensor, conditional: Tensor, alpha: float) -> Tensor:
    """`G_∅ + α (G_AC − G_∅)`, all of one shape."""
    return unconditional + alpha * (conditional - unconditional)


def mask_guided(base: Tensor, fine: Tensor, other: Tensor, strength: Tensor) -> Tensor:
    """Adds `βZ ⊙ (G_ACF − other)` to `base`, Cafe-Talk eq. 6.

    The paper prints `G_∅` for `other`. With `G_AC` the speech does not count α + β times within a slot.
    `strength` is βZ, 0 outside the slots, [B, T, 1] or a shape that broadcasts alike.
    """
    return base + strength * (fine - other)
