"""Training-free weights from 68 landmarks to every vertex: a thin plate under tension.

Mirrors `rust-core/src/deform/tension_screened_biharmonic.rs`. Per landmark j the weight field w
minimises bending, tension, and, far from every landmark, its own size:

    (L M^-1 L + tau L + S M + C) w = C e_j

L the robust cotan Laplacian (Sharp & Crane 2020), M lumped mass, S the screening (zero near the
landmarks), C a stiff spring at each landmark's vertex. Lengths are centimetres of a human-sized
head: the mesh comes in the canonical frame.

Tension stops the plate from overshooting between the lips and on the cheeks; the screen lets the
back of the head rest. Without it errors double. A plate also drags along all the skin between lid
and brow, where real skin folds. So `lid_profile` makes the lids' weights end within a centimetre.
"""

from dataclasses import dataclass

import numpy as np
import robust_laplacian
import scipy.sparse as sp
from scipy.sparse.csgraph import dijkstra
from scipy.sparse.linalg import splu

REACHES = [
    (range(17), 1.0),
    (range(17, 27), 2.0),
    (range(27, 36), 2.0),
    (range(36, 48), 0.5),
    (range(48, 68), 6.0),
]
"""Landmarks of each kind, and how many centimetres along the surface they move the skin.

The kinds are contour, brows, nose, eyes and lips. A lid's motion stops at the skull that holds the
eye, while the lining of the mouth follows the lips a long way in.
"""


LIDS = (range(36, 42), range(42, 48))
"""Landmarks around each eye, corner to corner and back."""

CURVE_POINTS = 8
"""Number of points on the lid's edge from one landmark to the next."""

OUTER_CM, INNER_CM = (0.3, 0.8), (0.5, 1.5)
"""Distances from the lid's edge, for the outer skin and for the lining behind the edge.

Up to the first distance skin follows the lid fully. From the second on it does not move. They were
measured on ICT FaceKit's eyeBlink.
"""

BEHIND_CM = (0.1, 0.25)
"""Depths behind the nearest point of the lid's edge.

At the first depth skin begins to count as lining. From the second on it counts fully.
"""


@dataclass(frozen=True)
class TensionScreened:
    """Constants of the plate, in centimetres; chosen by random search on both faces of `corpus`."""

    tension: float = 2.5
    """The tension tau, in 1/cm²."""
    screen: float = 10.0
    """The screening S, in 1/cm⁴. It is full from twice the reach of the nearest landmark on."""
    spring: float = 1e4
    """Stiffness of a landmark's spring, unitless. It holds the landmark to a few micrometres."""


def edge_graph(vertices: np.ndarray, laplacian: sp.csc_matrix) -> sp.csr_matrix:
    """Straight lengths of the edges of the Laplacian's intrinsic triangulation. [V, V].

    Paths along them come out a few per cent too long, which is good enough to tell near from far.
    """
    entries = laplacian.tocoo()
    off = entries.row != entries.col
    rows, columns = entries.row[off], entries.col[off]
    length = np.linalg.norm(vertices[rows] - vertices[columns], axis=1)
    return sp.csr_matrix((np.maximum(length, 1e-12), (rows, columns)), laplacian.shape)


def laplacian_and_mass(vertices: np.ndarray, triangles: np.ndarray) -> tuple[sp.csc_matrix, np.ndarray]:
    """Positive semidefinite robust Laplacian [V, V] and lumped mass [V], unit of the vertices²."""
    laplacian, mass = robust_laplacian.mesh_laplacian(np.asarray(vertices), np.asarray(triangles))
    return laplacian.tocsc(), mass.diagonal()


def weights(
    vertices: np.ndarray,
    triangles: np.ndarray,
    landmarks: np.ndarray,
    plate: TensionScreened = TensionScreened(),
) -> np.ndarray:
    """The weights of a mesh. vertices: [V, 3] canonical metres; landmarks: [N] vertex numbers. [V, N]."""
    cm = 100.0 * np.asarray(vertices, np.float64)
    laplacian, mass = laplacian_and_mass(cm, triangles)
    remoteness = landmark_remoteness(cm, laplacian, landmarks)
    return solve(cm, laplacian, mass, remoteness, landmarks, plate)


def landmark_remoteness(vertices: np.ndarray, laplacian: sp.csc_matrix, landmarks: np.ndarray) -> np.ndarray:
    """Distance to the nearest landmark of a kind divided by the kind's reach, least over the kinds. [V].

    vertices: [V, 3] cm.
    """
    graph = edge_graph(vertices, laplacian)
    ratios = [
        dijkstra(graph, indices=np.unique(landmarks[list(kind)]), min_only=True) / reach
        for kind, reach in REACHES
    ]
    return np.min(ratios, axis=0)


def lid_edge(corners: np.ndarray) -> np.ndarray:
    """A closed Catmull-Rom curve through six landmarks of an eye, sharp at its corners. [P, 3].

    corners: [6, 3] cm, from corner to corner and back.
    """
    pieces = []
    for i in range(6):
        before, start, end, after = (corners[(i + k) % 6] for k in (-1, 0, 1, 2))
        before = start if i % 3 == 0 else before
        after = end if i % 3 == 2 else after
        t = np.arange(CURVE_POINTS)[:, None] / CURVE_POINTS
        pieces.append(catmull_rom(before, start, end, after, t))
    return np.concatenate(pieces)


def catmull_rom(before, start, end, after, t):
    """The Catmull-Rom curve from `start` (`t` = 0) to `end` (`t` = 1)."""
    bent = (2.0 * before - 5.0 * start + 4.0 * end - after) * t**2
    twisted = (3.0 * start - before - 3.0 * end + after) * t**3
    return 0.5 * (2.0 * start + (end - before) * t + bent + twisted)


def _ease_out(x: np.ndarray, span: tuple[float, float]) -> np.ndarray:
    """1 up to the span's start, 0 from its end on, smooth between."""
    s = np.clip((span[1] - x) / (span[1] - span[0]), 0.0, 1.0)
    return s * s * (3.0 - 2.0 * s)


def lid_profile(vertices: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """How far each vertex follows the lids of one eye, from 0 to 1. [V].

    vertices: [V, 3] cm, canonical. corners: [6, 3] cm, the eye's landmarks.
    """
    edge = lid_edge(corners)
    distance = np.linalg.norm(vertices[:, None] - edge, axis=-1)
    nearest = distance.argmin(1)
    distance = distance[np.arange(len(vertices)), nearest]
    behind = edge[nearest, 2] - vertices[:, 2]
    inner = np.clip((behind - BEHIND_CM[0]) / (BEHIND_CM[1] - BEHIND_CM[0]), 0.0, 1.0)
    return _ease_out(distance, OUTER_CM) * (1.0 - inner) + _ease_out(distance, INNER_CM) * inner


def solve(
    vertices: np.ndarray,
    laplacian: sp.csc_matrix,
    mass: np.ndarray,
    remoteness: np.ndarray,
    landmarks: np.ndarray,
    plate: TensionScreened,
) -> np.ndarray:
    """Solves the linear system at the head of the file and applies the lids' profile.

    vertices: [V, 3] cm. remoteness: [V]. Returns [V, N].
    """
    grown = np.clip(np.nan_to_num(remoteness, posinf=1e9) - 1.0, 0.0, 1.0)
    spring = np.zeros(len(mass))
    np.add.at(spring, landmarks, plate.spring)
    system = (
        laplacian @ sp.diags(1.0 / mass) @ laplacian
        + plate.tension * laplacian
        + sp.diags(plate.screen * grown**2 * mass + spring)
    )
    right = np.zeros((len(mass), len(landmarks)))
    right[landmarks, np.arange(len(landmarks))] = plate.spring
    factor = splu(system.tocsc(), permc_spec="MMD_AT_PLUS_A", options={"SymmetricMode": True})
    out = factor.solve(right)
    for eye in LIDS:
        out[:, eye] *= lid_profile(vertices, vertices[landmarks[eye]])[:, None]
    return out
