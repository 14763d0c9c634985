"""Vertex sequences of corpus folders as EmoFace trains on them: the paper's own setting (§4).

The template is the neutral mesh of the folder's topology in canonical axes; motion is the displacement of
each speaker's vertices from his own neutral mesh. A style is a speaker, a level the intensity of `clips.tsv`.
"""

from collections.abc import Callable

import numpy as np
import torch
from torch import Tensor

from training.corpus.clip import FPS
from training.corpus.conditions import EMOTIONS
from training.corpus.folder import CorpusFolder, Row
from training.corpus.folder_clips import to_canonical_axes
from training.corpus.topology import Topology
from training.corpus.windows import interpolate
from training.systems.emoface.model import Template
from training.systems.emoface.rows import NEUTRAL, Spoken

Hears = Callable[[np.ndarray, int], Tensor]
"""Samples [S] at 16 kHz and a number of frames → what is heard in them, [T, C]."""


def template_of(folder: CorpusFolder) -> Template:
    """The neutral mesh of the folder's first clip."""
    topology = folder.topology(folder.rows[0])
    places = topology.landmarks(topology.vertices)
    vertices = topology.vertices @ to_canonical_axes(places)
    nearest = np.asarray(topology.nearest)
    if len(set(nearest.tolist())) < len(nearest) // 2:
        raise ValueError(
            f"{folder.path}: expected landmarks at vertices of their own, got {nearest.tolist()}"
        )
    return Template(vertices, np.asarray(topology.triangles), nearest)


def spoken(folder: CorpusFolder, hears: Hears, feels: Hears) -> list[Spoken]:
    """Every clip with vertices, `weights` [T, 3 V] metres; `feels` hears how it is said, [T, E]."""
    if folder.head_moves:
        raise ValueError(f"{folder.path}: head: expected still vertices for EmoFace, got moves")
    found = []
    for row in folder.rows:
        motion = _motion(folder, row, folder.topology(row))
        if motion is None:
            continue
        samples = folder.sound(row)
        frames = min(len(motion), int(len(samples) / 16000 * FPS))
        heard = feels(samples, frames)
        label = row.emotion if row.emotion in EMOTIONS else NEUTRAL
        content = [hears(samples, frames).half()]
        about = (row.clip, row.speaker, row.held_out, content, heard, motion[:frames], label, row.intensity)
        found.append(Spoken(*about, is_recorded=True))
    if not found:
        raise ValueError(f"{folder.path}: expected clips with vertices, got none")
    return found


def _motion(folder: CorpusFolder, row: Row, topology: Topology) -> Tensor | None:
    """Displacements at 25 fps, [T, 3 V] metres in canonical axes."""
    track = folder.vertices(row)
    if track is None:
        return None
    turn = to_canonical_axes(topology.landmarks(topology.vertices))
    moved = (folder.unit_m * np.asarray(track.values, np.float32) - topology.vertices) @ turn
    at = np.arange(int(track.seconds[-1] * FPS + 1e-6) + 1) / FPS
    rows = np.interp(at, track.seconds, np.arange(len(track.seconds)))
    return interpolate(torch.from_numpy(moved).flatten(1), torch.from_numpy(rows)).float()
