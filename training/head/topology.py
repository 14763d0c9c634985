"""Makes a head of the model `head_topology` from numbers. Twin of `rust-core/src/head/topology.rs`."""

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import spsolve_triangular


def sides(traits: np.ndarray) -> np.ndarray:
    """Splits sliders `[T]` into their amounts to the right and to the left, `[2 T]`."""
    return np.stack([np.maximum(traits, 0), np.maximum(-traits, 0)], 1).ravel()


def neighbour_means(faces: np.ndarray, count: int) -> sparse.csr_array:
    """Matrix `[S, S]` for the mean of each vertex's neighbours in `faces` `[F, 4]` that have lower numbers.

    A mode stores only what each vertex adds to that mean, because this packs smaller.
    """
    ends = np.sort(np.stack([faces, np.roll(faces, -1, axis=1)], axis=-1).reshape(-1, 2).astype(int), axis=1)
    low, high = np.unique(ends[ends[:, 0] != ends[:, 1]], axis=0).T
    shares = 1.0 / np.bincount(high, minlength=count)[high]
    return sparse.csr_array((shares, (high, low)), (count, count))


def decode_displacements(faces: np.ndarray, added: np.ndarray) -> np.ndarray:
    """Displacements `[S, 3]`, decoded from what each vertex adds to the mean of its earlier neighbours."""
    system = sparse.eye_array(len(added)) - neighbour_means(faces, len(added))
    return spsolve_triangular(system.tocsr(), added, lower=True, unit_diagonal=True)


def shape(
    state: dict[str, np.ndarray], config: dict, coefficients: np.ndarray, traits: np.ndarray
) -> np.ndarray:
    """Vertex positions `[V, 3]`, canonical metres, for coefficients `[100]` and sliders `[T]`."""
    points, numbers = state["positions"].copy(), np.r_[coefficients, sides(traits)]
    skin = config["skin_vertices"]
    added = np.tensordot(numbers, state["modes"], 1).T * config["step_m"]
    moved = decode_displacements(state["faces"][: config["skin_faces"]], added)
    points[:skin] += moved
    first = skin
    for part in config["parts"]:
        rows = slice(first, first + part["vertices"])
        first = rows.stop
        name = part["name"]
        if f"{name}.moves" in state:
            *shift, growth = numbers @ state[f"{name}.moves"]
            middle = points[rows].mean(0)
            points[rows] = middle + (1 + growth) * (points[rows] - middle) + shift
        else:
            corners = state[f"{name}.corners"].astype(int)
            points[rows] += np.einsum("pc,pcd->pd", state[f"{name}.shares"], moved[corners])
    return points
