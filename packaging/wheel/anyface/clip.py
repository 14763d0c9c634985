"""The result of `animate`: a mesh that speaks, frame by frame."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .core.heard_emotion import HeardEmotion

Floats = NDArray[np.float32]


@dataclass(frozen=True)
class Weights:
    """The same motion as weights of the 52 ARKit shapes.

    `names` are `[52]`, `values` `[T, 52]` from 0 to 1. `left_out`, 0 to 1, is the share of the
    motion that the weights do not show.
    """

    names: tuple[str, ...]
    values: Floats
    left_out: float


@dataclass(frozen=True)
class Clip:
    """A performance of `T` frames on a mesh, in its own units, axes and vertex order.

    `rest` `[V, 3]` and `triangles` `[F, 3]` are the mesh. `displacements` `[T, V, 3]` are added to
    `rest`. `landmarks` `[68, 3]` lie on the mesh at rest, in the order of iBUG 300-W, and move by
    `landmark_displacements` `[T, 68, 3]`.

    `head` `[T, 3]` are rotation vectors in radians about +x to the subject's left, +y up and +z out
    of the face. `gaze` `[T, 2, 2]` holds yaw to the subject's left and pitch up, in radians, of the
    right and the left eye. The displacements include neither head nor gaze. `tongue` `[T, 4]` says
    how far the tongue is on its way to contact, 0 to 1: tip to the ridge behind the upper teeth,
    middle to the palate, back to the palate, tip to the upper teeth. The displacements include the
    tongue if the mesh has one.

    `largest_mm` is the largest displacement, scaled to a head of human size. `speaks` is False if
    nobody would see the lips move, as for a sound without speech. `weights` are present if the
    caller asked for them, `heard_emotion` if the motion depends on the emotion of the voice.

    It is a sequence of its frames: `clip[t]` is `[V, 3]`, the positions of all vertices.
    """

    fps: float
    rest: Floats
    triangles: NDArray[np.uint32]
    displacements: Floats
    landmarks: Floats
    landmark_displacements: Floats
    head: Floats
    gaze: Floats
    tongue: Floats
    largest_mm: float
    speaks: bool
    weights: Weights | None = None
    heard_emotion: HeardEmotion | None = None

    @property
    def vertices(self) -> Floats:
        """Positions `[T, V, 3]` of all vertices in all frames, computed anew at each access."""
        return self.rest + self.displacements

    @property
    def duration_s(self) -> float:
        """Length in seconds."""
        return len(self) / self.fps

    def __len__(self) -> int:
        return len(self.displacements)

    def __getitem__(self, frame: int) -> Floats:
        return self.rest + self.displacements[frame]

    def __iter__(self) -> Iterator[Floats]:
        return (self[frame] for frame in range(len(self)))
