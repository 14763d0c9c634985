"""Single frames of ARKit weights, [N, 51]: poses from recordings, and others that users may set."""

import json
from pathlib import Path

import numpy as np
import torch
from safetensors import safe_open
from torch import Tensor

from training.corpus.arkit import facegood_weights
from training.corpus.emotions import shape_weights
from training.corpus.faces import CHANNELS
from training.corpus.split import facegood_first_held_out, grid_held_out

REST_SHARE, SINGLE_SHARE, SPARSE_SHARE, CAPTURED_SHARE = 0.12, 0.15, 0.28, 0.3
"""Shares of poses at rest, with one channel, with a few random channels, and from facegood_zh.

The other poses are tracked frames of grid_s1.
"""
FELT_SHARE = 0.25
SPARSE_CHANNELS = 0.12
BLINK_SHARE = 0.25
"""Share of poses that also close the lids. Half of these close them fully, the others partly."""
UPPER_SHARE, UPPER_CHANNELS = 0.35, 0.4
"""Share of poses that also move brows, cheeks and nose, and share of those channels that they move.

Recordings of speech hardly move them, and a field that learns a median leaves out rare motion.
"""
UPPER = [i for i, name in enumerate(CHANNELS) if name.startswith(("brow", "cheekS", "eyeSq", "noseS"))]
LIDS = [CHANNELS.index("eyeBlinkLeft"), CHANNELS.index("eyeBlinkRight")]


def recorded(data: Path, held_out: bool) -> tuple[Tensor, Tensor]:
    """Training or held-out frames of facegood_zh [N, 51] and of grid_s1's tracker [M, 51]."""
    spoken = []
    for weights, _ in facegood_weights(data).values():
        cut = facegood_first_held_out(len(weights))
        spoken.append(weights[cut:] if held_out else weights[:cut])
    with safe_open(data / "motion/grid_s1/face_track.safetensors", "np") as file:
        names = json.loads(file.metadata()["weight_names"])
        clips = json.loads(file.metadata()["clips"])
        offsets, tracked_frames = file.get_tensor("clip_offsets"), file.get_tensor("found").astype(bool)
        weights = file.get_tensor("weights")[:, [names.index(c) for c in CHANNELS]]
    left = grid_held_out(clips)
    chosen = np.concatenate([
        np.arange(offsets[i], offsets[i + 1]) for i, name in enumerate(clips) if (name in left) == held_out
    ])  # fmt: skip
    chosen = chosen[tracked_frames[chosen]]
    return torch.cat(spoken).float(), torch.from_numpy(weights[chosen]).float() / 255.0


def emotion_prototypes() -> Tensor:
    """Each emotion's prototype as weights, clamped to 0 … 1, [E, 51]."""
    return torch.from_numpy(shape_weights()).float().clamp(0.0, 1.0)


class Poses:
    """Draws weights: recorded frames (some with an added emotion), sparse ones, single channels and rest."""

    def __init__(self, data: Path, held_out: bool = False):
        self.captured, self.tracked = recorded(data, held_out)
        self.prototypes = emotion_prototypes()

    @classmethod
    def of(cls, recorded: Tensor) -> "Poses":
        """Draws from frames [N, 51] of the user's recordings in place of ours."""
        poses = cls.__new__(cls)
        poses.captured, poses.tracked, poses.prototypes = recorded, recorded, emotion_prototypes()
        return poses

    def draw(self, count: int, random: torch.Generator) -> Tensor:
        """Weights [count, 51] in 0 … 1."""

        def pick(rows: Tensor) -> Tensor:
            return rows[torch.randint(0, len(rows), (count,), generator=random)]

        def uniform(*shape: int) -> Tensor:
            return torch.rand(*shape, generator=random)

        sparse = uniform(count, len(CHANNELS)) * (uniform(count, len(CHANNELS)) < SPARSE_CHANNELS)
        single = uniform(count, 1) * pick(torch.eye(len(CHANNELS)))
        kinds = torch.stack(
            [torch.zeros_like(single), single, sparse, pick(self.captured), pick(self.tracked)]
        )
        shares = torch.tensor([REST_SHARE, SINGLE_SHARE, SPARSE_SHARE, CAPTURED_SHARE]).cumsum(0)
        kind = torch.bucketize(uniform(count), shares)
        weights = kinds[kind, torch.arange(count)]
        emotional = (uniform(count) < FELT_SHARE) & (kind >= 3)
        added = uniform(count, 1) * pick(self.prototypes) * emotional[:, None]
        blinks = uniform(count, 1) < BLINK_SHARE
        upper = uniform(count, len(UPPER)) * (uniform(count, len(UPPER)) < UPPER_CHANNELS)
        upper = upper * (uniform(count, 1) < UPPER_SHARE)
        weights[:, UPPER] = torch.maximum(weights[:, UPPER], upper)
        shut = (2.0 * uniform(count, 1)).clamp(max=1.0) * blinks
        weights[:, LIDS] = torch.maximum(weights[:, LIDS], shut)
        return (weights + added).clamp(0.0, 1.0)
