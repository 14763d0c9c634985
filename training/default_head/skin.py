"""The skin of the default head: our own symmetric triangulation over the ICT model.

The left half is remeshed and mirrored, so every vertex has its mirror image on the other side. The skin
is one surface: face, neck, mouth bag and eye sockets; its only opening is the neck.
"""

from dataclasses import dataclass

import numpy as np
from scipy import sparse
from scipy.spatial import cKDTree

from training.default_head.remesh import Cells, Surface, boundary_paths, defects, dual, subdivide
from training.deform.tension_screened_biharmonic import catmull_rom

# ICT vertices: face, head and neck, mouth bag and eye sockets, in this order.
LAST_SKIN_VERTEX = 14061
MOUTH_BAG = (11248, 13293)
# (landmarks, edge length there, distance up to which it applies), centimetres.
DETAIL = [
    (range(60, 68), 0.13, 0.15),
    (range(48, 60), 0.17, 0.30),
    (range(36, 48), 0.14, 0.20),
    (range(31, 36), 0.22, 0.60),
    (range(27, 31), 0.35, 0.80),
    (range(17, 27), 0.40, 0.60),
    (range(0, 17), 0.65, 1.00),
]
EARS_CM, EAR_SIZE_CM, EAR_REACH_CM = [8.0, 2.3, 0.5], 0.42, 2.6
COARSEST_CM, GROWTH_PER_CM = 1.15, 0.17
INSIDE_CM = 0.45
LIP_LINE_STEP_CM = 0.17


@dataclass
class Skin:
    """`triangles` `[F, 3]`, `weights` `[V, ICT vertices]` sparse, `landmarks` `[68]`,
    `mouth` and `lips` `[F]` whether a triangle lines the mouth bag or belongs to the red of the lips."""

    triangles: np.ndarray
    weights: sparse.csr_matrix
    landmarks: np.ndarray
    mouth: np.ndarray
    lips: np.ndarray


def edge_length(points: np.ndarray, landmarks: np.ndarray, outside: np.ndarray) -> np.ndarray:
    """Target edge length at every point, centimetres: fine at lips and lids, coarse on the skull."""
    size = np.full(len(points), COARSEST_CM)
    features = [(landmarks[list(which)], s, r) for which, s, r in DETAIL]
    features.append((np.array([EARS_CM]), EAR_SIZE_CM, EAR_REACH_CM))
    for places, finest, reach in features:
        distance, _ = cKDTree(places).query(points)
        size = np.minimum(size, finest + GROWTH_PER_CM * np.maximum(0, distance - reach))
    # Only the rim of the mouth and sockets is visible, so their inside may be coarser.
    return np.where(outside > 0.5, size, np.maximum(size, np.minimum(INSIDE_CM, 2.2 * size)))


def half_surface(neutral: np.ndarray, triangles: np.ndarray) -> Surface:
    """The subject's left half of the skin, each triangle split into sixteen."""
    skin = triangles[(triangles <= LAST_SKIN_VERTEX).all(1)]
    left = skin[(neutral[skin][:, :, 0] > -1e-4).all(1)]
    used, renumbered = np.unique(left, return_inverse=True)
    weights = sparse.csr_matrix((np.ones(len(used)), (np.arange(len(used)), used)), (len(used), len(neutral)))
    surface = Surface(neutral[used], renumbered.reshape(-1, 3), weights)
    return subdivide(subdivide(surface))


def corners(surface: Surface) -> list[int]:
    """Vertices where the middle line meets the neck's rim. Without a point there the rim gets a notch."""
    (loop,) = boundary_paths(surface.triangles)
    middle = np.abs(surface.points[loop, 0]) < 1e-3
    return loop[middle & ~(np.roll(middle, 1) & np.roll(middle, -1))].tolist()


def lip_line(points: np.ndarray) -> np.ndarray:
    """Edge of the red of the lips on the subject's left, from 51 over 54 to 57, `[n, 3]`: a
    Catmull-Rom curve through the outer lip landmarks (`points`: all 68)."""
    knots = points[[50, 51, 52, 53, 54, 55, 56, 57, 58]]
    line = []
    for before, start, end, after in zip(knots, knots[1:], knots[2:], knots[3:], strict=False):
        steps = max(2, round(np.linalg.norm(end - start) / LIP_LINE_STEP_CM))
        line += [catmull_rom(before, start, end, after, t) for t in np.arange(steps) / steps]
    return np.array([*line, knots[-2]])


def lips(points: np.ndarray, triangles: np.ndarray, landmarks: np.ndarray) -> np.ndarray:
    """`[F]`: whether a triangle is red of the lips, that is within the lip line as seen from the front."""
    left = lip_line(landmarks)
    outline = np.concatenate([left, left[-2:0:-1] * [-1, 1, 1]])[:, :2]
    middle = points[triangles].mean(1)
    x, y = middle[:, :1], middle[:, 1:2]
    (ax, ay), (bx, by) = outline.T, np.roll(outline, -1, 0).T
    with np.errstate(divide="ignore", invalid="ignore"):
        crossed = ((ay > y) != (by > y)) & (x < (bx - ax) * (y - ay) / (by - ay) + ax)
    within = crossed.sum(1) % 2 == 1
    return within & (middle[:, 2] > landmarks[60, 2] - 0.4)


def mirror_columns(weights: sparse.csr_matrix, neutral: np.ndarray) -> sparse.csr_matrix:
    """The same points on the subject's right: every ICT vertex is replaced by its mirror image."""
    _, mirror = cKDTree(neutral[: LAST_SKIN_VERTEX + 1]).query(neutral[: LAST_SKIN_VERTEX + 1] * [-1, 1, 1])
    swapped = weights.tocoo()
    return sparse.csr_matrix((swapped.data, (swapped.row, mirror[swapped.col])), weights.shape)


def build(neutral: np.ndarray, triangles: np.ndarray, landmarks: np.ndarray, seed: int) -> Skin:
    """Remeshes the mean head. Its `weights` apply the new triangulation to any identity."""
    surface = half_surface(neutral, triangles)
    is_outside = np.arange(len(neutral)) < MOUTH_BAG[0]
    size = edge_length(surface.points, neutral[landmarks], surface.weights @ is_outside)
    first_rows = np.flatnonzero(np.diff(surface.weights.indptr) == 1)
    number = {surface.weights.indices[surface.weights.indptr[r]]: r for r in first_rows}
    on_left = [i for i, v in enumerate(landmarks) if neutral[v, 0] > -1e-4]
    line = cKDTree(surface.points).query(lip_line(neutral[landmarks]))[1].tolist()
    fixed = np.array([number[landmarks[i]] for i in on_left] + corners(surface) + line)
    cells = Cells(surface, size, fixed)
    seeds, labels = cells.relax(np.random.default_rng(seed), 60)
    faces = dual(surface.triangles, labels)
    twice, _ = defects(faces)
    if len(twice):
        where = surface.points[seeds[twice]].round(1).tolist()
        raise RuntimeError(f"edges used twice near {where}: another --seed may avoid them")
    return mirrored(surface, seeds, faces, neutral, landmarks)


def mirrored(
    surface: Surface, seeds: np.ndarray, faces: np.ndarray, neutral: np.ndarray, landmarks: np.ndarray
) -> Skin:
    """Joins the left half and its mirror image along the middle."""
    points = surface.points[seeds]
    middle = np.abs(points[:, 0]) < 1e-3
    right = np.arange(len(seeds))
    right[~middle] = len(seeds) + np.arange((~middle).sum())
    left_weights = surface.weights[seeds]
    other = mirror_columns(left_weights, neutral)[~middle]
    weights = sparse.vstack([left_weights, other]).tocsr()
    both = np.concatenate([faces, right[faces][:, ::-1]])
    positions = weights @ neutral
    _, places = cKDTree(positions).query(neutral[landmarks])
    number = np.arange(len(neutral))
    in_bag = (number >= MOUTH_BAG[0]) & (number <= MOUTH_BAG[1])
    bag = (weights @ in_bag.astype(float))[both].mean(1) > 0.5
    red = lips(positions, both, neutral[landmarks]) & ~bag
    return Skin(both, weights, places, bag, red)
