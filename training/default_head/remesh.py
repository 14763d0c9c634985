"""A new triangulation of a surface by geodesic Voronoi clustering.

Lloyd's relaxation spreads points over a finely subdivided copy of the surface. Distances are measured along
its edges in units of the local edge length. Each place where three cells meet becomes a triangle (the dual of
the Voronoi diagram; after Valette & Chassery 2004, "Approximated centroidal Voronoi diagrams for uniform
polygonal mesh coarsening", with Dijkstra cells in place of their energy). Cells grow along the surface only,
so lips that touch stay apart.
"""

from dataclasses import dataclass

import numpy as np
from scipy import sparse
from scipy.sparse.csgraph import dijkstra

from training.corpus.remesh import quartered


@dataclass
class Surface:
    """`points` `[V, 3]`, `triangles` `[F, 3]`, `weights` `[V, original vertices]` (sparse)."""

    points: np.ndarray
    triangles: np.ndarray
    weights: sparse.csr_matrix


def edges_of(triangles: np.ndarray) -> np.ndarray:
    """Every edge once, `[E, 2]`, smaller number first."""
    pairs = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])
    return np.unique(np.sort(pairs, 1), axis=0)


def subdivide(surface: Surface) -> Surface:
    """Splits each triangle into four. All points have weights over the original vertices."""
    grow, triangles = quartered(surface.triangles, len(surface.points))
    return Surface(grow @ surface.points, triangles, grow @ surface.weights)


def boundary_paths(triangles: np.ndarray) -> list[np.ndarray]:
    """Closed loops of boundary vertices, in order."""
    pairs = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])
    edges = {(a, b) for a, b in pairs.tolist()}
    following = {a: b for a, b in edges if (b, a) not in edges}
    loops = []
    while following:
        first, after = following.popitem()
        loop = [first]
        while after != first:
            loop.append(after)
            after = following.pop(after)
        loops.append(np.array(loop))
    return loops


def sample_loop(points: np.ndarray, loop: np.ndarray, size: np.ndarray, fixed: set) -> np.ndarray:
    """Picks vertices of a loop about one edge length apart, always including the `fixed` ones."""
    stops = [i for i, v in enumerate(loop.tolist()) if v in fixed]
    if not stops:
        stops = [0]
    chosen = []
    for start, end in zip(stops, [*stops[1:], stops[0] + len(loop)], strict=True):
        piece = loop[np.arange(start, end + 1) % len(loop)]
        step = np.linalg.norm(np.diff(points[piece], axis=0), axis=1)
        along = np.concatenate([[0], np.cumsum(step / size[piece[1:]])])
        count = max(1, round(along[-1]))
        targets = np.arange(count) * along[-1] / count
        chosen.append(piece[np.abs(along[None] - targets[:, None]).argmin(1)])
    return np.unique(np.concatenate(chosen))


class Cells:
    """Lloyd's relaxation on one surface."""

    def __init__(self, surface: Surface, size: np.ndarray, fixed: np.ndarray):
        self.surface, self.size = surface, size
        pairs = edges_of(surface.triangles)
        length = np.linalg.norm(surface.points[pairs[:, 0]] - surface.points[pairs[:, 1]], axis=1)
        length /= 0.5 * (size[pairs[:, 0]] + size[pairs[:, 1]])
        count = len(surface.points)
        self.graph = sparse.csr_matrix((length, (pairs[:, 0], pairs[:, 1])), (count, count))
        self.mass = self._mass()
        loops = boundary_paths(surface.triangles)
        on_edge = [sample_loop(surface.points, loop, size, set(fixed.tolist())) for loop in loops]
        self.boundary = np.unique(np.concatenate(loops)) if loops else np.zeros(0, int)
        self.boundary_seeds = np.unique(np.concatenate(on_edge)) if loops else np.zeros(0, int)
        self.fixed = np.unique(np.concatenate([fixed, self.boundary_seeds]))

    def _mass(self) -> np.ndarray:
        """Area per vertex, in squares of the local edge length."""
        p, t = self.surface.points, self.surface.triangles
        area = 0.5 * np.linalg.norm(np.cross(p[t[:, 1]] - p[t[:, 0]], p[t[:, 2]] - p[t[:, 0]]), axis=1)
        return np.bincount(t.ravel(), np.repeat(area / 3, 3), len(p)) / self.size**2

    def label(self, seeds: np.ndarray) -> np.ndarray:
        """The number of the nearest seed for every vertex. Boundary vertices belong to boundary seeds."""
        _, _, source = dijkstra(
            self.graph, directed=False, indices=seeds, min_only=True, return_predecessors=True
        )
        number = np.full(len(self.surface.points), -1)
        number[seeds] = np.arange(len(seeds))
        labels = number[source]
        if len(self.boundary):
            _, _, source = dijkstra(
                self.graph,
                directed=False,
                indices=self.boundary_seeds,
                min_only=True,
                return_predecessors=True,
            )
            labels[self.boundary] = number[source[self.boundary]]
        return labels

    def relax(self, rng: np.random.Generator, rounds: int) -> tuple[np.ndarray, np.ndarray]:
        """Spreads seeds. Returns them (vertex numbers) and the label of every vertex."""
        count = int(self.mass.sum() * 2 / np.sqrt(3)) - len(self.fixed) // 2
        chance = self.mass.copy()
        chance[self.fixed] = 0
        chance[self.boundary] = 0
        free = rng.choice(len(chance), count, replace=False, p=chance / chance.sum())
        for _ in range(rounds):
            seeds = np.concatenate([self.fixed, free])
            free = self._centres(self.label(seeds), len(seeds))[len(self.fixed) :]
            free = np.setdiff1d(free, np.concatenate([self.fixed, self.boundary, [-1]]))
        seeds = np.concatenate([self.fixed, free])
        return seeds, self.label(seeds)

    def _centres(self, labels: np.ndarray, count: int) -> np.ndarray:
        """The vertex of each cell that lies nearest to the cell's centre of mass."""
        p = self.surface.points
        mass = np.bincount(labels, self.mass, count).clip(1e-12)
        centre = np.stack([np.bincount(labels, self.mass * p[:, i], count) / mass for i in range(3)], 1)
        distance = ((p - centre[labels]) ** 2).sum(1)
        order = np.lexsort((distance, labels))
        first = np.unique(labels[order], return_index=True)
        centres = np.full(count, -1)
        centres[first[0]] = order[first[1]]
        return centres


def dual(triangles: np.ndarray, labels: np.ndarray) -> np.ndarray:
    """A triangle wherever three cells meet, wound like the surface."""
    corner = labels[triangles]
    meet = (corner[:, 0] != corner[:, 1]) & (corner[:, 1] != corner[:, 2]) & (corner[:, 2] != corner[:, 0])
    corner = corner[meet]
    start = corner.argmin(1)
    turned = np.stack([corner[np.arange(len(corner)), (start + k) % 3] for k in range(3)], 1)
    return np.unique(turned, axis=0)


def defects(triangles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Vertices on edges used twice in one direction, and vertices on boundary edges."""
    pairs = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])
    unique, counts = np.unique(pairs, axis=0, return_counts=True)
    twice = np.unique(unique[counts > 1])
    known = {(a, b) for a, b in unique.tolist()}
    open_ends = [a for a, b in known if (b, a) not in known]
    return twice, np.array(sorted(set(open_ends)), int)
