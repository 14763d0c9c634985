"""New triangulations of a face that keep its motion and its landmarks.

Every new vertex lies on the old surface and is a barycentric mixture of old vertices *of its own
neighbourhood on the surface*, so motion carries over exactly and never jumps from lip to lip.

Shapes: `V` old and `W` new vertices, `F` triangles, `M` channels.
"""

from dataclasses import replace

import fast_simplification
import numpy as np
import scipy.sparse as sp

from training.corpus.faces import Face

MIN_AGGRESSION = 6
"""Least aggression. With less, fast_simplification stalls before it gets down to its target."""


def carry(face: Face, mixture: sp.csr_matrix, triangles: np.ndarray, landmarks: np.ndarray) -> Face:
    """The face on new vertices. mixture: [W, V], rows sum to one."""
    channels, old = face.modes.shape[:2]
    modes = mixture @ face.modes.transpose(1, 0, 2).reshape(old, channels * 3)
    return replace(
        face,
        vertices=mixture @ face.vertices,
        triangles=triangles,
        landmarks=landmarks,
        modes=modes.reshape(-1, channels, 3).transpose(1, 0, 2),
    )


def keep_faces(face: Face, keep: np.ndarray) -> Face | None:
    """The face with the triangles in `keep` [F] and no loose vertices; None if a landmark is lost."""
    triangles = face.triangles[keep]
    used, compact = np.unique(triangles, return_inverse=True)
    number = np.full(len(face.vertices), -1)
    number[used] = np.arange(len(used))
    landmarks = number[face.landmarks]
    if (landmarks < 0).any():
        return None
    pick = sp.csr_matrix((np.ones(len(used)), (np.arange(len(used)), used)), (len(used), len(face.vertices)))
    return carry(face, pick, compact.reshape(-1, 3), landmarks)


def subdivide(face: Face) -> Face:
    """Splits every triangle into four at its edge midpoints."""
    return carry(face, *quartered(face.triangles, len(face.vertices)), face.landmarks)


def quartered(triangles: np.ndarray, count: int) -> tuple[sp.csr_matrix, np.ndarray]:
    """The mixture that appends edge midpoints to `count` vertices, and four triangles for each old one."""
    edges = np.sort(np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]]), 1)
    unique, inverse = np.unique(edges, axis=0, return_inverse=True)
    ab, bc, ca = (count + inverse.reshape(-1)).reshape(3, -1)
    a, b, c = triangles.T
    smaller = np.concatenate([np.stack(t, 1) for t in ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))])
    half = sp.csr_matrix(
        (np.full(2 * len(unique), 0.5), (np.repeat(np.arange(len(unique)), 2), unique.reshape(-1))),
        (len(unique), count),
    )
    return sp.vstack([sp.identity(count), half]).tocsr(), smaller


def decimate(face: Face, target: int, aggression: int) -> Face | None:
    """Reduces a face to about `target` triangles. Returns None if two landmarks fall together.

    Each new vertex snaps to the surface around the old vertices that collapsed into it, and a
    landmark's vertex snaps back to the landmark itself.
    """
    reduction = 1.0 - target / len(face.triangles)
    if reduction <= 0.0:
        return face
    points = face.vertices.astype(np.float32)
    _, _, collapses = fast_simplification.simplify(
        points,
        face.triangles.astype(np.int32),
        target_reduction=reduction,
        agg=max(aggression, MIN_AGGRESSION),
        return_collapses=True,
    )
    positions, triangles, cluster = fast_simplification.replay_simplification(
        points, face.triangles.astype(np.int32), collapses
    )
    landmarks = cluster[face.landmarks]
    if len(np.unique(landmarks)) < len(landmarks):
        return None
    mixture = _snap(face, np.asarray(positions, np.float64), cluster)
    mixture = mixture.tolil()
    for new, old in zip(landmarks, face.landmarks, strict=True):
        mixture.rows[new], mixture.data[new] = [int(old)], [1.0]
    snapped = carry(face, mixture.tocsr(), np.asarray(triangles, np.int64), landmarks)
    area = triangle_areas(snapped.vertices, snapped.triangles)
    return keep_faces(snapped, area > 1e-12)


def triangle_areas(vertices: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Area of each triangle [F], in the square of the vertices' unit."""
    a, b, c = (vertices[triangles[:, i]] for i in range(3))
    return 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1)


def _snap(face: Face, positions: np.ndarray, cluster: np.ndarray) -> sp.csr_matrix:
    """Snaps each new position onto the triangles at the nearest vertex of its cluster.

    positions: [W, 3]. cluster: [V], the new vertex of each old one. Returns [W, V].
    """
    distance = np.linalg.norm(face.vertices - positions[cluster], axis=1)
    order = np.lexsort((distance, cluster))
    new, first = np.unique(cluster[order], return_index=True)
    nearest = np.zeros(len(positions), np.int64)
    nearest[new] = order[first]
    corner_of = sp.csr_matrix(
        (np.ones(face.triangles.size), (face.triangles.ravel(), np.arange(face.triangles.size) // 3)),
        (len(face.vertices), len(face.triangles)),
    )
    rows = corner_of[nearest]
    owner = np.repeat(np.arange(len(positions)), np.diff(rows.indptr))
    weights, gap = barycentric(
        positions[owner], face.vertices[face.triangles[rows.indices]].transpose(1, 0, 2)
    )
    order = np.lexsort((gap, owner))
    owners, first = np.unique(owner[order], return_index=True)
    best = order[first]
    corners = face.triangles[rows.indices[best]]
    return sp.csr_matrix(
        (weights[best].ravel(), (np.repeat(owners, 3), corners.ravel())),
        (len(positions), len(face.vertices)),
    )


def barycentric(points: np.ndarray, corners: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Clamped barycentric weights of points over triangles, and the remaining distance.

    points: [P, 3]; corners: [3, P, 3]. Returns [P, 3] and [P]. The clamp (negative weights to
    zero, then scaled to one) stays on the triangle but is not the exact nearest point.
    """
    a, b, c = corners
    u, v, w = b - a, c - a, points - a
    uu, uv, vv = (u * u).sum(1), (u * v).sum(1), (v * v).sum(1)
    wu, wv = (w * u).sum(1), (w * v).sum(1)
    scale = 1.0 / np.maximum(uu * vv - uv * uv, 1e-30)
    beta, gamma = (vv * wu - uv * wv) * scale, (uu * wv - uv * wu) * scale
    weights = np.clip(np.stack([1.0 - beta - gamma, beta, gamma], 1), 0.0, 1.0)
    weights /= weights.sum(1, keepdims=True)
    nearest = np.einsum("pk,kpx->px", weights, corners)
    return weights, np.linalg.norm(points - nearest, axis=1)


def crop(rng: np.random.Generator, face: Face) -> Face | None:
    """Cuts off everything on one side of a random plane that spares the landmarks."""
    normal = rng.normal(size=3) * [0.5, 1.0, 1.0]
    normal /= np.linalg.norm(normal)
    height = face.vertices @ normal
    lowest = height[face.landmarks].min()
    limit = lowest - rng.uniform(0.003, 0.03)
    return keep_faces(face, (height[face.triangles] > limit).all(1))


def tear(rng: np.random.Generator, face: Face, holes: int) -> Face | None:
    """Tears small holes away from the landmarks."""
    keep = np.ones(len(face.triangles), bool)
    centres = face.vertices[rng.integers(len(face.vertices), size=holes)]
    for centre in centres:
        clearance = np.linalg.norm(face.vertices[face.landmarks] - centre, axis=1).min()
        if clearance > 0.008:
            near = np.linalg.norm(face.vertices - centre, axis=1) < rng.uniform(0.002, 0.007)
            keep &= ~near[face.triangles].all(1)
    return keep_faces(face, keep)


def component_of_landmarks(face: Face) -> Face | None:
    """Keeps only the connected parts that hold landmarks."""
    t = face.triangles
    count = len(face.vertices)
    edges = sp.coo_matrix((np.ones(2 * len(t)), (t[:, :2].ravel(), t[:, 1:].ravel())), (count, count))
    label = sp.csgraph.connected_components(edges)[1]
    keep = np.isin(label[t[:, 0]], label[face.landmarks])
    return keep_faces(face, keep)


def remesh(rng: np.random.Generator, face: Face, triangles: int) -> Face:
    """A random triangulation of about `triangles` triangles, sometimes cropped or torn."""
    for _ in range(20):
        mesh = face
        if rng.random() < 0.5:
            mesh = crop(rng, mesh) or mesh
        if rng.random() < 0.5:
            mesh = subdivide(mesh)
        mesh = decimate(mesh, triangles, int(rng.integers(6, 9)))
        if mesh is not None and rng.random() < 0.4:
            mesh = tear(rng, mesh, 6)
        mesh = mesh and component_of_landmarks(mesh)
        if mesh is not None:
            return mesh
        triangles = int(1.2 * triangles)
    raise RuntimeError(f"remesh: 68 separate landmarks expected, none of 20 tries kept them ({face.name})")
