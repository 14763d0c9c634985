"""Fits MakeHuman's head to ICT's mean face by landmarks, rims and surface, with ever less stiffness.

Non-rigid ICP (Amberg et al. 2007) with point-to-plane distances and a bi-Laplacian of the displacement.
All lengths are centimetres in ICT's frame.
"""

from dataclasses import dataclass

import numpy as np
from scipy import sparse
from scipy.interpolate import RBFInterpolator
from scipy.sparse.linalg import splu
from scipy.spatial import cKDTree

from training.align import Similarity, similarity
from training.head_topology.quads import Quads, normals

# Number of rings of quads added below MakeHuman's cut at the neck, down to a collar.
COLLAR_RINGS = 4
ICT_SKIN = 11248
ICT_SKIN_AND_SOCKETS = 14062
RIMS = [range(60, 68), range(36, 42), range(42, 48)]
STEPS = 24
STIFFNESS = (30.0, 0.35)
REACH_CM = (3.0, 0.8)
LOOSE, MEAN_OF = 0.05, 24
"""How strongly a vertex without a partner follows the mean of the nearest `MEAN_OF` vertices.

Vertices of the ears follow ICT's vertices. Vertices behind lips and lids follow the skin over them.
"""
AGREE = 0.55
"""The normals of two partners have at least this dot product."""


@dataclass
class Target:
    """ICT's mean face: `points` `[26719, 3]`, `triangles` `[F, 3]`, `quads` `[Q, 4]`, `landmarks` `[68]`."""

    points: np.ndarray
    triangles: np.ndarray
    quads: np.ndarray
    landmarks: np.ndarray

    def rims(self) -> Quads:
        """Skin and sockets as quads."""
        skin = self.quads[(self.quads < ICT_SKIN_AND_SOCKETS).all(1)]
        return Quads(skin, len(self.points))


@dataclass
class Template:
    """MakeHuman's head before the fit.

    `vertices` `[V]` are vertex numbers of the body. `start` `[V, 3]` are their places, aligned to ICT. `mesh`
    holds the quads, and `faces` their numbers in the body. `landmarks` `[68]`. `rims` are the loops of lips
    and lids. `mouth` and `sockets` `[V]` mark the vertices behind the rims. `onto` maps the body to ICT.
    """

    vertices: np.ndarray
    start: np.ndarray
    mesh: Quads
    faces: np.ndarray
    landmarks: np.ndarray
    rims: list[list[int]]
    mouth: np.ndarray
    sockets: np.ndarray
    onto: Similarity


def cut(body, head: dict, target: Target) -> Template:
    """Cuts the skin of the head at the collar, then aligns and bends it by the landmarks."""
    selected = np.zeros(len(body.points), bool)
    selected[head["base_index"]] = True
    faces = selected[body.quads].all(1)
    for _ in range(COLLAR_RINGS):
        selected[body.quads[faces].ravel()] = True
        faces = selected[body.quads].any(1)
    vertices, numbers = np.unique(body.quads[faces], return_inverse=True)
    mesh = Quads(numbers.reshape(-1, 4), len(vertices))
    landmarks = np.searchsorted(vertices, head["base_index"][head["landmarks68"]])
    points, marks = body.points[vertices], target.points[target.landmarks]
    onto = similarity(points[landmarks], marks)
    aligned = onto(points)
    bend = RBFInterpolator(
        aligned[landmarks], marks - aligned[landmarks], kernel="linear", smoothing=0.05, degree=1
    )
    far = cKDTree(aligned[landmarks]).query(aligned)[0]
    start = aligned + bend(aligned) * np.exp(-((np.maximum(far - 3, 0) / 6) ** 2))[:, None]
    rims = [mesh.loop(landmarks[list(numbers)].tolist(), start) for numbers in RIMS]
    behind = [mesh.behind(rim, deepest(rim, start)) for rim in rims]
    return Template(
        vertices, start, mesh, np.flatnonzero(faces), landmarks, rims, behind[0], behind[1] | behind[2], onto
    )


def deepest(rim: list[int], points: np.ndarray) -> int:
    """A vertex behind the opening, as seen from the front: the foremost one deep enough."""
    middle = points[rim].mean(0)
    near = np.linalg.norm(points[:, :2] - middle[:2], axis=1) < 1.0
    candidates = np.flatnonzero(near & (points[:, 2] < middle[2] - 0.6))
    return int(candidates[points[candidates, 2].argmax()])


class Samples:
    """Points on ICT's skin, their normals, and each point as weights of ICT's vertices."""

    SHARES = np.array([[1, 1, 1], [1.8, 0.6, 0.6], [0.6, 1.8, 0.6], [0.6, 0.6, 1.8]]) / 3

    def __init__(self, target: Target):
        skin = target.triangles[(target.triangles < ICT_SKIN).all(1)]
        used = np.unique(skin)
        every = sparse.eye(len(target.points), format="csr")
        rows = [every[used]]
        for shares in self.SHARES:
            rows.append(sum(share * every[skin[:, corner]] for corner, share in enumerate(shares)))
        self.weights = sparse.vstack(rows).tocsr()
        self.points = self.weights @ target.points
        along = self.weights @ normals(target.points, target.triangles)
        self.normals = along / np.linalg.norm(along, axis=1, keepdims=True)
        self.tree = cKDTree(self.points)

    def partners(self, points: np.ndarray, along: np.ndarray, reach: float) -> tuple[np.ndarray, np.ndarray]:
        """The nearest sample that faces the same way, and whether it lies within `reach`; both `[V]`."""
        far, numbers = self.tree.query(points, k=12)
        agree = np.einsum("vkd,vd->vk", self.normals[numbers], along) > AGREE
        far = np.where(agree, far, np.inf)
        best = far.argmin(1)
        rows = np.arange(len(points))
        return numbers[rows, best], far[rows, best] < reach


def rim_partners(template: Template, target: Target) -> tuple[np.ndarray, sparse.csr_matrix]:
    """Vertices on the rims of lips and lids, and their places as weights of ICT's vertices.

    A vertex lies at the same share of the way from one landmark to the next on both heads.
    """
    theirs = target.rims()
    vertices, entries, count = [], [], len(target.points)
    for numbers in map(list, RIMS):
        for a, b in zip(numbers, numbers[1:] + numbers[:1], strict=True):
            ours = template.mesh.path(int(template.landmarks[a]), int(template.landmarks[b]), template.start)
            way = theirs.path(int(target.landmarks[a]), int(target.landmarks[b]), target.points)
            places = np.interp(shares(template.start[ours]), shares(target.points[way]), np.arange(len(way)))
            for vertex, place in zip(ours[:-1], places[:-1], strict=True):
                low = min(int(place), len(way) - 2)
                entries += [
                    (len(vertices), way[low], 1 - (place - low)),
                    (len(vertices), way[low + 1], place - low),
                ]
                vertices.append(vertex)
    rows, columns, values = map(np.array, zip(*entries, strict=True))
    return np.array(vertices), sparse.csr_matrix((values, (rows, columns)), (len(vertices), count))


def shares(points: np.ndarray) -> np.ndarray:
    """How far along a polyline each of its points lies, from 0 to 1."""
    so_far = np.r_[0, np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))]
    return so_far / so_far[-1]


def ears(points: np.ndarray) -> np.ndarray:
    """`[V]`: marks both ears, whose folds get no partners."""
    x, y, z = points.T
    return (np.abs(x) > 6.7) & (y > -2.4) & (y < 5.6) & (z < 2.5) & (z > -3.4)


@dataclass
class Fit:
    """`points` `[V, 3]` and how ICT's vertices move them.

    `weights` `[V, 26719]` mix ICT's vertices. `strength` `[V]` says how much each row counts. `over` `[V, N]`
    are the skin vertices nearest to each vertex.
    """

    points: np.ndarray
    weights: sparse.csr_matrix
    strength: np.ndarray
    over: np.ndarray


def fit(template: Template, target: Target) -> Fit:
    """Brings the template onto the face."""
    mesh, start = template.mesh, template.start
    samples = Samples(target)
    outside = ~(template.mouth | template.sockets)
    rim, rim_weights = rim_partners(template, target)
    rim_places = rim_weights @ target.points
    others = [n for n in range(68) if not any(n in numbers for numbers in RIMS)]
    laplacian = mesh.laplacian()
    stiff = sparse.kron(laplacian.T @ laplacian, sparse.eye(3)).tocsr()
    points = start.copy()
    for step in range(STEPS):
        share = step / (STEPS - 1)
        partner, near = samples.partners(
            points, normals(points, mesh.triangles), np.interp(share, [0, 1], REACH_CM)
        )
        counts = (near & outside & ~ears(start)).astype(float)
        counts[mesh.rim] *= 0.3
        along, places = samples.normals[partner], samples.points[partner]
        blocks = counts[:, None, None] * (np.einsum("vi,vj->vij", along, along) + 0.12 * np.eye(3))
        pulls = np.einsum("vij,vj->vi", blocks, places - start)
        marks = 10.0 - 7.0 * share
        for number in others:
            vertex = template.landmarks[number]
            blocks[vertex] += marks * np.eye(3)
            pulls[vertex] += marks * (target.points[target.landmarks[number]] - start[vertex])
        for vertex, place in zip(rim, rim_places, strict=True):
            blocks[vertex] += 20 * np.eye(3)
            pulls[vertex] += 20 * (place - start[vertex])
        rows = np.arange(mesh.count + 1)
        pull_matrix = sparse.bsr_matrix((blocks, rows[:-1], rows), shape=stiff.shape).tocsr()
        system = np.interp(share, [0, 1], STIFFNESS) * stiff + pull_matrix + 1e-6 * sparse.eye(stiff.shape[0])
        points = start + splu(system.tocsc()).solve(pulls.ravel()).reshape(-1, 3)
    on_rim = sparse.csr_matrix((np.ones(len(rim)), (rim, np.arange(len(rim)))), (mesh.count, len(rim)))
    counts[rim] = 0
    partner_weights = (
        sparse.diags((counts > 0).astype(float)) @ samples.weights[partner] + on_rim @ rim_weights
    )
    counts[rim] = 20
    skin = np.flatnonzero(outside)
    within = skin[cKDTree(points[skin]).query(points, k=MEAN_OF)[1]]
    loose = (counts == 0) & outside
    return Fit(
        points,
        (partner_weights + sparse.diags(loose.astype(float)) @ around(points, target)).tocsr(),
        np.where(loose, LOOSE, counts),
        within,
    )


def around(points: np.ndarray, target: Target) -> sparse.csr_matrix:
    """Weights of the mean of the ICT vertices around each point, skin and sockets only, `[V, 26719]`."""
    near = cKDTree(target.points[:ICT_SKIN_AND_SOCKETS]).query(points, k=MEAN_OF)[1]
    rows = np.repeat(np.arange(len(points)), MEAN_OF)
    shape = (len(points), len(target.points))
    return sparse.csr_matrix((np.full(near.size, 1 / MEAN_OF), (rows, near.ravel())), shape)


def carried(template: Template, fitted: Fit, moved: np.ndarray) -> np.ndarray:
    """Carries motion of ICT's vertices, `[K, 26719, 3]`, over to the template's, `[K, V, 3]`.

    Vertices follow their partners. The others move as smoothly as possible.
    """
    laplacian = template.mesh.laplacian()
    inside = template.mouth | template.sockets
    smooth = laplacian.T @ laplacian
    # Move the skin first. The vertices behind it then follow the skin over them.
    skin = splu((smooth + sparse.diags(3 * fitted.strength + 1e-9)).tocsc()).solve
    firm = np.where(inside, LOOSE, 1e3)
    behind = splu((smooth + sparse.diags(firm)).tocsc()).solve
    rows = []
    for one in moved:
        first = skin(3 * fitted.strength[:, None] * (fitted.weights @ one))
        goal = np.where(inside[:, None], first[fitted.over].mean(1), first)
        rows.append(behind(firm[:, None] * goal))
    return np.stack(rows)
