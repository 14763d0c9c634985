"""A basis whose weights lie within 0 and 1, as every importer and engine plays them.

Blender's own glTF importer clamps weights below 0, and so do game engines. `Σ w v` with `w` from
`m` to `M` equals `Σ (w - m)/(M - m) · (M - m) v + Σ m v`: the last sum is one shape more, which
stays at 1. Where sliders may still change the weights, `m` and `M` are the ends of what they reach.
"""

from dataclasses import replace

import numpy as np

from . import sliders
from .take import Basis

_SMALLEST_SPAN = 1e-6


def one_sided(basis: Basis) -> Basis:
    """The same motion with weights within 0 and 1, and one shape more where any was negative."""
    less, more = sliders.reach(basis.sliders) if basis.sliders else (0.0, 0.0)
    low = np.minimum((basis.weights + less).min(axis=0), 0.0)
    span = np.maximum((basis.weights + more).max(axis=0) - low, _SMALLEST_SPAN)
    vectors = basis.vectors * span[:, None, None].astype(np.float32)
    weights = np.clip((basis.weights - low) / span, 0.0, 1.0)
    changes = {
        name: replace(change, changes=change.changes / span)
        for name, change in basis.sliders.items()
    }
    if low.any():
        standing = np.tensordot(low, basis.vectors, axes=1)[None].astype(np.float32)
        vectors = np.concatenate([vectors, standing])
        weights = np.column_stack([weights, np.ones(len(weights))])
        for change in changes.values():
            change.changes = np.pad(change.changes, ((0, 0), (0, 0), (0, 1)))
    return replace(basis, vectors=vectors.astype(np.float32), weights=weights, sliders=changes)
