"""Meshes of quads: edges, paths and loops through vertices, the part behind a loop, normals."""

import heapq
from collections import Counter, defaultdict

import numpy as np
from scipy import sparse


class Quads:
    """Faces `[Q, 4]` over `count` vertices. A face that repeats a corner is a triangle."""

    def __init__(self, faces: np.ndarray, count: int):
        self.faces, self.count = faces, count
        uses = Counter()
        for corner in range(4):
            ends = np.sort(faces[:, [corner, (corner + 1) % 4]], axis=1)
            uses.update(map(tuple, ends[ends[:, 0] != ends[:, 1]].tolist()))
        self.edges = np.array(list(uses))
        self.rim = np.unique([edge for edge, times in uses.items() if times == 1])
        self._beside = defaultdict(set)
        for a, b in uses:
            self._beside[a].add(b)
            self._beside[b].add(a)

    @property
    def triangles(self) -> np.ndarray:
        """Two triangles for each face."""
        return np.concatenate([self.faces[:, [0, 1, 2]], self.faces[:, [0, 2, 3]]])

    def laplacian(self) -> sparse.csr_matrix:
        """Mean of the neighbours minus the vertex, `[V, V]`."""
        a, b = self.edges.T
        beside = sparse.coo_matrix((np.ones(2 * len(a)), (np.r_[a, b], np.r_[b, a])), (self.count,) * 2)
        degree = np.maximum(np.asarray(beside.tocsr().sum(1)).ravel(), 1)
        return (sparse.diags(1 / degree) @ beside - sparse.eye(self.count)).tocsr()

    def path(self, start: int, end: int, points: np.ndarray) -> list[int]:
        """Vertices along the shortest path over edges, both ends included."""
        far, before, queue = {start: 0.0}, {}, [(0.0, start)]
        while queue:
            so_far, vertex = heapq.heappop(queue)
            if vertex == end:
                break
            for other in self._beside[vertex]:
                length = so_far + float(np.linalg.norm(points[vertex] - points[other]))
                if length < far.get(other, np.inf):
                    far[other], before[other] = length, vertex
                    heapq.heappush(queue, (length, other))
        way = [end]
        while way[-1] != start:
            way.append(before[way[-1]])
        return way[::-1]

    def loop(self, vertices: list[int], points: np.ndarray) -> list[int]:
        """A closed path through `vertices`."""
        ends = zip(vertices, vertices[1:] + vertices[:1], strict=True)
        return [v for a, b in ends for v in self.path(a, b, points)[:-1]]

    def behind(self, loop: list[int], seed: int) -> np.ndarray:
        """`[V]`: marks the vertices that can be reached from `seed` without crossing `loop`."""
        visited, stack, wall = {seed}, [seed], set(loop)
        while stack:
            for other in self._beside[stack.pop()] - wall - visited:
                visited.add(other)
                stack.append(other)
        reached = np.zeros(self.count, bool)
        reached[list(visited)] = True
        return reached


def normals(points: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Unit normals of vertices, weighted by area, `[V, 3]`."""
    a, b, c = (points[triangles[:, k]] for k in range(3))
    across = np.cross(b - a, c - a)
    total = np.zeros_like(points)
    for corner in range(3):
        np.add.at(total, triangles[:, corner], across)
    return total / np.maximum(np.linalg.norm(total, axis=1, keepdims=True), 1e-12)
