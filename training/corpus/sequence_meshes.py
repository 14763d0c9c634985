"""Meshes of corpus folders with the vertex sequences recorded on them, for training Sparse-To-Mesh."""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from training.corpus.checked import CorpusError
from training.corpus.faces import Face, align
from training.corpus.folder import CorpusFolder, Row
from training.corpus.prepared import PreparedMesh, prepare
from training.corpus.warp import stylise


@dataclass
class SequenceMesh(PreparedMesh):
    """A speaker's neutral mesh and sequences [T, V, 3] in the file's own unit and axes, kept on disk.

    neutral: [V, 3], in the file's unit. turn: [3, 3], from the file's displacements to canonical decimetres.
    """

    face: Face
    sequences: list[np.ndarray]
    neutral: np.ndarray
    turn: np.ndarray

    def displacements(self, sequence: int, frames: np.ndarray, vertices: Tensor | None = None) -> Tensor:
        """Displacements in `frames` of a sequence at `vertices` (all if None), [T, P, 3] decimetres."""
        moved = np.asarray(self.sequences[sequence][frames], np.float64)
        chosen = slice(None) if vertices is None else vertices.numpy()
        return torch.from_numpy((moved[:, chosen] - self.neutral[chosen]) @ self.turn.T).float()

    def anywhere(self, rng: np.random.Generator, frames: int, vertices: Tensor) -> Tensor:
        """Random frames of one sequence, each scaled by a random 0.7 to 1.4."""
        sequence = self.draw(rng)
        chosen = rng.integers(len(self.sequences[sequence]), size=frames)
        strength = torch.from_numpy(rng.uniform(0.7, 1.4, (frames, 1, 1))).float()
        return strength * self.displacements(sequence, chosen, vertices)

    def in_a_row(self, rng: np.random.Generator, frames: int) -> Tensor:
        """Consecutive frames of one sequence, at all vertices."""
        sequence = self.draw(rng)
        first = rng.integers(max(len(self.sequences[sequence]) - frames, 0) + 1)
        last = len(self.sequences[sequence]) - 1
        return self.displacements(sequence, np.minimum(first + np.arange(frames), last))

    def draw(self, rng: np.random.Generator) -> int:
        """Draws a sequence, long ones more often."""
        lengths = np.array([len(s) for s in self.sequences], float)
        return int(rng.choice(len(lengths), p=lengths / lengths.sum()))


def sequence_meshes(folders: list[Path], held_out: bool) -> list[SequenceMesh]:
    """One mesh for each speaker and folder that has vertex sequences in the split."""
    meshes = []
    for path in folders:
        folder = CorpusFolder(path)
        speakers: dict[str, list[Row]] = {}
        for row in folder.rows:
            if row.held_out == held_out:
                speakers.setdefault(row.speaker, []).append(row)
        meshes += [mesh for rows in speakers.values() if (mesh := _mesh(folder, rows)) is not None]
    if not meshes and not held_out:
        expected = "vertices of one training clip or more"
        raise CorpusError(Path(folders[0]), None, expected, "none")
    return meshes


def _mesh(folder: CorpusFolder, rows: list[Row]) -> SequenceMesh | None:
    tracks = [track for row in rows if (track := folder.vertices(row)) is not None]
    if not tracks:
        return None
    if folder.head_moves:
        expected = "head: still, for vertex sequences with the head's motion taken out"
        raise CorpusError(folder.path / "corpus.json", None, expected, "moves")
    topology = folder.topology(rows[0])
    axes = np.repeat(np.eye(3)[:, None], len(topology.vertices), axis=1)
    name = f"{folder.name}_{rows[0].speaker}"
    face = align(Face(name, topology.vertices, topology.triangles, topology.nearest, axes))
    turn = 10.0 * folder.unit_m * face.modes[:, 0].T
    still = replace(face, modes=np.zeros((0, *topology.vertices.shape)))
    values = [track.values for track in tracks]
    return SequenceMesh(**vars(prepare(still)), face=still, sequences=values,
                        neutral=topology.vertices / folder.unit_m, turn=turn)  # fmt: skip


def neutral_shapes(rng: np.random.Generator, meshes: list[SequenceMesh], count: int) -> np.ndarray:
    """Landmarks of the neutral faces and of gentle warps of them, [count, 68, 3] dm."""
    shapes = []
    for number in range(count):
        face = meshes[number % len(meshes)].face
        at = face.landmarks
        alone = replace(face, vertices=face.vertices[at], modes=face.modes[:, at], landmarks=np.arange(68))
        shapes.append(10.0 * stylise(rng, alone, rng.uniform(0.0, 0.5)).vertices)
    return np.stack(shapes)


@torch.no_grad()
def held_out_errors(predict, meshes: list[SequenceMesh], frames: int = 50) -> tuple[float, float]:
    """Mean and lip error, mm, of `predict(mesh, landmark displacements [T, 68, 3])` on held-out clips."""
    mean, lips = [], []
    for mesh in meshes:
        for number, sequence in enumerate(mesh.sequences):
            chosen = np.linspace(0, len(sequence) - 1, min(frames, len(sequence))).astype(int)
            truth = mesh.displacements(number, chosen)
            error = 100.0 * (predict(mesh, truth[:, mesh.landmarks]) - truth).norm(dim=-1)
            mean.append(error.mean().item())
            lips.append(error[:, mesh.lips].mean().item())
    return float(np.mean(mean)), float(np.mean(lips))
