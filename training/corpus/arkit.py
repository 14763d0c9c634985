"""Clips whose motion is ARKit weights [T, 51], from any kind of recording.

Captured weights stay as they are. Landmarks become weights by bounded least squares on ICT's modes, so that
the weights move ICT's landmarks in the same way as the recorded ones. An `Entry` then holds weights instead
of landmarks; everything else is the same.
"""

from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from training.corpus import bank
from training.corpus.bank import Entry
from training.corpus.clip import FPS
from training.corpus.facegood import CAPTURE_FPS, arkit_takes, channel_rows, resample
from training.corpus.facegood import SOURCE as FACEGOOD
from training.corpus.faces import CHANNELS
from training.corpus.folder import CorpusFolder
from training.corpus.folder_clips import arkit_modes, blend_weights
from training.corpus.tracks import Track
from training.losses import landmark_weights, lip_gap, mouth_width

HIGHEST = 1.0
RIDGE, SPARSE = 1e-3, 4e-4
STEPS = 300
CHUNK = 20000
EYES = [i for i, c in enumerate(CHANNELS) if c.startswith(("eyeBlink", "eyeLook"))]
"""Channels of lids and gaze. The fit leaves them out: no voice moves them, and readers look down."""
LEAST_M = 1e-6
SIDEWAYS = [CHANNELS.index(c) for c in ("mouthLeft", "mouthRight", "jawLeft", "jawRight")]
"""Channels that the fit leaves out.

Symmetric motion does not use them, and left and right together would cancel out.
"""
COSTS = {
    "mouthShrugUpper": 4.0,
    "mouthPress": 6.0,
    "mouthRoll": 2.0,
    "noseSneer": 8.0,
    "cheekSquint": 8.0,
    "mouthFrown": 3.0,
    "jawForward": 4.0,
    "jawOpen": 0.2,
    "mouthFunnel": 0.2,
    "mouthPucker": 0.2,
    "mouthClose": 0.5,
}
"""How unlikely channels are in speech: a factor on the fit's ridge and sparsity.

A name stands for every channel that begins with it. Channels that are not listed count 1.
"""
GAP_WEIGHT, WIDTH_WEIGHT = 3.0, 6.0
"""Factors on the lip gap and the mouth's width, which the fit compares beside the landmarks."""


@lru_cache(maxsize=1)
def modes() -> Tensor:
    """Displacement of the landmarks at weight 1 of each channel, [51, 204] canonical metres."""
    by_name = arkit_modes()
    return torch.from_numpy(np.stack([by_name[c].reshape(-1) for c in CHANNELS])).float()


@lru_cache(maxsize=1)
def mirrored() -> list[int]:
    """For each channel, the index of its counterpart on the other side."""
    swap = {"Left": "Right", "Right": "Left"}
    other = [next((c[: -len(a)] + b for a, b in swap.items() if c.endswith(a) and len(c) > len(a) + 4), c)
             for c in CHANNELS]  # fmt: skip
    return [CHANNELS.index(c) if c in CHANNELS else i for i, c in enumerate(other)]


def weights_of(motion: Tensor, visible: Tensor) -> Tensor:
    """Weights [T, 51] in 0 … 1 that bring the landmarks nearest to `motion` [T, 204] metres.

    `visible` [204] is 1 in the columns that the fit uses.

    FISTA (Beck & Teboulle 2009) on squared distances in centimetres, landmarks weighted as in training. A
    little ridge and sparsity is added, since several channels move the same landmarks.
    """
    a = _measured(modes(), visible)
    a[[*EYES, *SIDEWAYS]] = 0.0
    cost = torch.tensor([_cost(c) for c in CHANNELS])
    gram = a @ a.T + RIDGE * len(CHANNELS) * cost.diag()
    step = 1.0 / torch.linalg.eigvalsh(gram)[-1]
    pulled = SPARSE * len(CHANNELS) * cost
    parts = motion.float().split(CHUNK)
    weights = torch.cat([_fista(_measured(m, visible) @ a.T - pulled, gram, step) for m in parts])
    weights[:, [*EYES, *SIDEWAYS]] = 0.0
    return weights


def _measured(motion: Tensor, visible: Tensor) -> Tensor:
    """The features of a motion [..., 204] metres that the fit compares: landmarks, lip gap and mouth width.

    All are in centimetres and weighted.
    """
    features = (
        torch.stack([GAP_WEIGHT * lip_gap(motion), WIDTH_WEIGHT * mouth_width(motion)], dim=-1) * visible[186]
    )
    return 100.0 * torch.cat([motion * (landmark_weights() * visible).sqrt(), features], dim=-1)


def _cost(channel: str) -> float:
    return next((cost for name, cost in COSTS.items() if channel.startswith(name)), 1.0)


def _fista(goal: Tensor, gram: Tensor, step: Tensor) -> Tensor:
    x = torch.zeros_like(goal)
    y, momentum = x, 1.0
    for _ in range(STEPS):
        following = (y - step * (y @ gram - goal)).clamp(0.0, HIGHEST)
        grown = (1.0 + (1.0 + 4.0 * momentum**2) ** 0.5) / 2.0
        y = following + (momentum - 1.0) / grown * (following - x)
        x, momentum = following, grown
    return x


def landmarks_of(weights: Tensor) -> Tensor:
    """Motion of ICT's landmarks [..., 204] metres under weights [..., 51]."""
    return weights @ modes().to(weights)


def of_folders(folders: list[Path], voices: int, seed: int = 0) -> list[Entry]:
    """Clips of corpus folders with weights [T, 51] as motion."""
    return as_weights(bank.of_folders(folders, voices, seed), folders=folders)


def as_weights(entries: list[Entry], data: Path | None = None, folders: Sequence[Path] = ()) -> list[Entry]:
    """The same clips with ARKit weights [T, 51] as motion; `weight` says which of them were observed.

    Captured weights come from `data` and the corpus `folders`.
    """
    captured = facegood_weights(data) if data is not None else {}
    recorded = folder_weights(folders)
    return [
        _captured(e, captured)
        if e.source == FACEGOOD and captured
        else _recorded(e, *recorded[e.source, e.name])
        if (e.source, e.name) in recorded
        else _solved(e)
        for e in entries
    ]


def _solved(entry: Entry) -> Entry:
    visible = entry.weight[0].float()
    if not entry.weight.any():
        visible = torch.ones_like(visible)
    motion = entry.motion.float()
    weights = weights_of(motion, visible)
    if entry.emotion == "neutral":
        weights = 0.5 * (weights + weights[:, mirrored()])
    frames = entry.weight.float().amax(dim=1, keepdim=True)
    shown = (modes().abs() * visible).amax(dim=1) > LEAST_M
    shown[EYES] = False
    return replace(entry, motion=weights, weight=frames * shown.float())


def _captured(entry: Entry, captured: dict[str, tuple[Tensor, Tensor]]) -> Entry:
    take, _, part = entry.name.partition("/")
    weights, channel_mask = captured[take]
    count = len(entry.motion)
    rows = weights[:count] if part == "start" else weights[len(weights) - count :]
    return replace(entry, motion=rows, weight=channel_mask.expand(count, -1).clone())


def _recorded(entry: Entry, track: Track, channel_mask: Tensor) -> Entry:
    """A clip of a corpus folder with its own captured weights, at 25 fps."""
    times, values = np.arange(len(entry.motion)) / FPS, dict(zip(track.names, track.values.T, strict=True))
    rows = [np.interp(times, track.seconds, values.get(c, np.zeros(len(track.seconds)))) for c in CHANNELS]
    weights = torch.from_numpy(np.stack(rows, 1)).float().clamp(0.0, HIGHEST)
    if entry.emotion == "neutral":
        weights = 0.5 * (weights + weights[:, mirrored()])
    return replace(entry, motion=weights, weight=channel_mask.expand(len(weights), -1).clone())


def folder_weights(folders: Sequence[Path]) -> dict[tuple[str, str], tuple[Track, Tensor]]:
    """Captured weights of the clips that have no other motion, by folder name and clip, each with a mask [51]
    of the captured channels."""
    tracks = {}
    for folder in map(CorpusFolder, folders):
        for row in folder.rows:
            track = blend_weights(folder, row)
            if track is not None:
                channel_mask = torch.tensor([float(c in track.names) for c in CHANNELS])
                tracks[folder.name, row.clip] = track, channel_mask
    return tracks


def facegood_weights(data: Path) -> dict[str, tuple[Tensor, Tensor]]:
    """For each take the weights [T, 51] at 25 fps and a mask [51] of the captured channels."""
    takes = {}
    for name, columns in arkit_takes(data):
        rows = resample(channel_rows(columns), CAPTURE_FPS, FPS)
        weights = torch.from_numpy(rows).clamp(0.0, HIGHEST)
        channel_mask = [float(c in columns and c.startswith(("jaw", "mouth", "cheekPuff"))) for c in CHANNELS]
        takes[name] = 0.5 * (weights + weights[:, mirrored()]), torch.tensor(channel_mask)
    return takes
