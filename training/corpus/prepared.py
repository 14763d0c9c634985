"""Meshes ready to train on: motion, landmarks and training-free weights, computed once and cached."""

import pickle
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from training.corpus.faces import Face, align, load_ict, load_makehuman
from training.corpus.remesh import remesh
from training.corpus.warp import stylise
from training.deform import tension_screened_biharmonic as plate
from training.deform.static_weights import VertexGeometry

LIPS_WITHIN_M = 0.01
"""A vertex nearer than this to a lip landmark (48 to 67) counts as lips."""


@dataclass
class PreparedMesh:
    """One mesh of the corpus.

    geometry: decimetres. triangles: [F, 3]. landmarks: [N] vertex numbers. modes: [M, V, 3] dm.
    lips: [V] bool.
    """

    name: str
    geometry: VertexGeometry
    triangles: np.ndarray
    landmarks: Tensor
    modes: Tensor
    lips: Tensor


def prepare(face: Face) -> PreparedMesh:
    """Computes everything about a face that does not depend on time."""
    cm = 100.0 * face.vertices
    laplacian, mass = plate.laplacian_and_mass(cm, face.triangles)
    remoteness = plate.landmark_remoteness(cm, laplacian, face.landmarks)
    base = plate.solve(cm, laplacian, mass, remoteness, face.landmarks, plate.TensionScreened())
    positions = torch.from_numpy(10.0 * face.vertices).float()
    landmarks = torch.from_numpy(face.landmarks)
    return PreparedMesh(
        face.name,
        VertexGeometry(
            positions,
            positions[landmarks],
            torch.from_numpy(base).float(),
            torch.from_numpy(np.nan_to_num(remoteness, posinf=1e3)).float(),
        ),
        face.triangles,
        landmarks,
        torch.from_numpy(10.0 * face.modes).float(),
        torch.cdist(positions, positions[landmarks[48:]]).min(1).values < 10.0 * LIPS_WITHIN_M,
    )


@dataclass
class Corpus:
    """Training and test meshes of each face. No identity and no warp is in both sets."""

    train: dict[str, list[PreparedMesh]]
    test: dict[str, list[PreparedMesh]]


@dataclass(frozen=True)
class Counts:
    """Number of meshes for each face, and the range of triangle counts of a mesh."""

    ict: int
    makehuman: int
    triangles: tuple[int, int]


COUNTS = Counts(70, 45, (3000, 7000))


def build(data: Path, counts: Counts, seed: int = 5) -> Corpus:
    """Draws identities, warps and triangulations; takes about a second for each mesh."""
    rng, test_rng = np.random.default_rng(seed), np.random.default_rng(seed + 1000)
    faces, makehuman = load_ict(data, "face"), load_makehuman(data)
    skins = load_ict(data, "skin")

    def ict(rng: np.random.Generator, i: int) -> Face:
        model = skins if i % 10 < 3 else faces
        person = model.person(rng.standard_normal(100) * rng.uniform(0.5, 1.4))
        return remesh(rng, stylise(rng, person, rng.uniform()), int(rng.integers(*counts.triangles)))

    def head(rng: np.random.Generator, i: int) -> Face:
        styled = stylise(rng, makehuman, rng.uniform(0.1, 1.0))
        return remesh(rng, styled, int(rng.integers(*counts.triangles)))

    def unseen_ict(rng: np.random.Generator, i: int) -> Face:
        person = stylise(rng, faces.person(rng.standard_normal(100)), 0.5)
        return remesh(rng, person, int(rng.integers(5000, 9000)))

    def as_it_is(rng: np.random.Generator, i: int) -> Face:
        return makehuman if i == 0 else remesh(rng, makehuman, int(rng.integers(5000, 8000)))

    def draw(source: Callable[[np.random.Generator, int], Face], rng, count: int):
        return [prepare(source(rng, i)) for i in range(count)]

    return Corpus(
        {"ict": draw(ict, rng, counts.ict), "makehuman": draw(head, rng, counts.makehuman)},
        {"ict": draw(unseen_ict, test_rng, 8), "makehuman": draw(as_it_is, test_rng, 3)},
    )


def landmark_shapes(rng: np.random.Generator, data: Path, face: str, count: int) -> np.ndarray:
    """Landmarks of neutral faces drawn as `build` draws them for training. [count, N, 3] dm."""
    ict, makehuman = load_ict(data, "face"), load_makehuman(data)
    identity = ict.identity[:, ict.mean.landmarks]
    mean, head = _landmarks_alone(ict.mean), _landmarks_alone(makehuman)
    shapes = []
    for _ in range(count):
        if face == "ict":
            coefficients = rng.standard_normal(100) * rng.uniform(0.5, 1.4)
            moved = mean.vertices + np.tensordot(coefficients, identity, 1)
            drawn = stylise(rng, align(replace(mean, vertices=moved)), rng.uniform())
        else:
            drawn = stylise(rng, head, rng.uniform(0.1, 1.0))
        shapes.append(10.0 * drawn.vertices)
    return np.stack(shapes)


def _landmarks_alone(face: Face) -> Face:
    at = face.landmarks
    return replace(face, vertices=face.vertices[at], modes=face.modes[:, at], landmarks=np.arange(len(at)))


def load_or_build(data: Path, cache: Path, counts: Counts) -> Corpus:
    """The corpus from `cache`, a file that this function writes the first time."""
    if cache.exists():
        return pickle.loads(cache.read_bytes())
    corpus = build(data, counts)
    cache.parent.mkdir(parents=True, exist_ok=True)
    cache.write_bytes(pickle.dumps(corpus))
    return corpus
