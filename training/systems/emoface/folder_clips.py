"""Turns vertex sequences of corpus folders into training clips of EmoFace: the paper's own setting (§4).

The template is the neutral mesh of the folder's topology in canonical axes. Motion is the displacement of
each speaker's vertices from his own neutral mesh, at the frame rate of the model. Each speaker is a style.
The level is the intensity in `clips.tsv`.
"""

import numpy as np
import torch
from torch import Tensor

from training.corpus.conditions import EMOTIONS
from training.corpus.folder import UNKNOWN_EMOTION, CorpusFolder, Row
from training.corpus.folder_clips import to_canonical_axes
from training.corpus.topology import Topology
from training.corpus.windows import interpolate
from training.systems.emoface.encoders import Encoders
from training.systems.emoface.model import Template
from training.systems.emoface.pairs import sentence
from training.systems.emoface.rows import NEUTRAL, Spoken


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


@torch.no_grad()
def spoken(folder: CorpusFolder, encoders: Encoders, fps: float) -> list[Spoken]:
    """Every clip that has vertices, with both encoders' features and `weights` [T, 3 V] in metres."""
    if folder.head_moves:
        raise ValueError(f"{folder.path}: head: expected still vertices for EmoFace, got moves")
    clips = []
    for row in folder.rows:
        motion = _motion(folder, row, folder.topology(row), fps)
        if motion is None:
            continue
        samples = torch.from_numpy(folder.sound(row))
        frames = min(len(motion), int(len(samples) / 16000 * fps))
        sound, voice = (part.prepare(samples, frames) for part in (encoders.speech, encoders.emotion))
        clip = Spoken(
            row.clip, row.speaker, row.held_out, [encoders.speech(sound, frames).half()],
            encoders.emotion(voice, frames), motion[:frames],
            row.emotion if row.emotion in EMOTIONS else NEUTRAL, row.intensity, is_recorded=True,
            text="" if row.emotion == UNKNOWN_EMOTION else sentence(row.text),
        )  # fmt: skip
        if encoders.learn:
            clip.sound, clip.voice = sound, voice
        clips.append(clip)
    if not clips:
        raise ValueError(f"{folder.path}: expected clips with vertices, got none")
    return clips


def _motion(folder: CorpusFolder, row: Row, topology: Topology, fps: float) -> Tensor | None:
    """Displacements at `fps`, [T, 3 V] metres in canonical axes."""
    track = folder.vertices(row)
    if track is None:
        return None
    turn = to_canonical_axes(topology.landmarks(topology.vertices))
    moved = (folder.unit_m * np.asarray(track.values, np.float32) - topology.vertices) @ turn
    at = np.arange(int(track.seconds[-1] * fps + 1e-6) + 1) / fps
    rows = np.interp(at, track.seconds, np.arange(len(track.seconds)))
    return interpolate(torch.from_numpy(moved).flatten(1), torch.from_numpy(rows)).float()
