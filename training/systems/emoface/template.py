"""EmoFace's template: a subset of ICT FaceKit's vertices, dense at lips and lids.

The landmarks are chosen first. Each further vertex is the one farthest along the surface from all chosen ones
(Eldar et al. 1997). Edges around lips and lids count as longer, edges where nothing moves as shorter. Every
other vertex belongs to the cell of its nearest chosen vertex. Triangles join chosen vertices whose cells meet
(the dual of a geodesic Voronoi diagram). Paths never cross the slit between the lips, so neither do
triangles.
"""

from pathlib import Path

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import dijkstra

from training.corpus.faces import Face, load_ict
from training.systems.emoface.model import Template

FINE = {"lips": (range(48, 68), 9e-3, 3.0), "lids": (range(36, 48), 6e-3, 2.0)}
"""Landmarks, the radius around them in metres, and the factor on the length of edges within it."""
STILL_M, STILL = 5e-4, 0.5
"""Where no channel moves a vertex as far as the first number (metres), the second is the factor on the length
of edges.
"""


def ict_template(data: Path, vertices: int) -> tuple[Template, np.ndarray]:
    """The template, and the numbers of its vertices in ICT's face region, [V]."""
    return chosen(load_ict(data, "face").mean, vertices)


def chosen(face: Face, vertices: int) -> tuple[Template, np.ndarray]:
    """Chooses this many of a face's vertices as a template; fewer if some have no triangle."""
    graph = _graph(face)
    seeds = list(dict.fromkeys(face.landmarks.tolist()))
    near = np.full(len(face.vertices), np.inf)
    for seed in seeds:
        near = np.minimum(near, dijkstra(graph, indices=seed))
    while len(seeds) < vertices:
        far = int(np.argmax(np.where(np.isfinite(near), near, -1.0)))
        seeds.append(far)
        near = np.minimum(near, dijkstra(graph, indices=far, limit=float(near[far]) + 1e-9))
    order = np.array(seeds)
    _, _, source = dijkstra(graph, indices=order, min_only=True, return_predecessors=True)
    number = np.full(len(face.vertices) + 1, -1)
    number[order] = np.arange(len(order))
    cells = number[source][face.triangles]
    distinct = (cells[:, 0] != cells[:, 1]) & (cells[:, 1] != cells[:, 2]) & (cells[:, 0] != cells[:, 2])
    triangles = cells[distinct & (cells >= 0).all(axis=1)]
    _, once = np.unique(np.sort(triangles, axis=1), axis=0, return_index=True)
    triangles = triangles[np.sort(once)]
    used = np.unique(triangles)
    renumbered = np.full(len(order), -1)
    renumbered[used] = np.arange(len(used))
    landmarks = renumbered[number[face.landmarks]]
    if (landmarks < 0).any():
        at = int(np.argmin(landmarks))
        raise ValueError(f"template: expected a triangle at every landmark, got none at {at}")
    return Template(face.vertices[order[used]], renumbered[triangles], landmarks), order[used]


def _graph(face: Face) -> sp.csr_matrix:
    """Graph of edge lengths: longer around lips and lids, shorter where nothing moves."""
    a, b = np.concatenate([face.triangles[:, [i, j]] for i, j in ((0, 1), (1, 2), (2, 0))]).T
    length = np.linalg.norm(face.vertices[a] - face.vertices[b], axis=1)
    moved = np.linalg.norm(face.modes, axis=-1).max(axis=0)
    factor = np.where(moved < STILL_M, STILL, 1.0)
    for landmarks, reach, times in FINE.values():
        points = face.vertices[face.landmarks[list(landmarks)]]
        distance = np.linalg.norm(face.vertices[:, None] - points, axis=-1).min(axis=1)
        factor = np.where(distance < reach, times, factor)
    length = length * 0.5 * (factor[a] + factor[b])
    count = len(face.vertices)
    edges = {(min(i, j), max(i, j)): x for i, j, x in zip(a.tolist(), b.tolist(), length, strict=True)}
    i, j = np.array(list(edges)).T
    return sp.csr_matrix((list(edges.values()), (i, j)), (count, count)).maximum(
        sp.csr_matrix((list(edges.values()), (j, i)), (count, count))
    )
