"""A head of the model `head_topology` from its numbers; the twin of `rust-core/src/head/topology.rs`."""

import numpy as np


def sides(traits: np.ndarray) -> np.ndarray:
    """Sliders `[T]` as how far each goes to its right and its left, `[2 T]`."""
    return np.stack([np.maximum(traits, 0), np.maximum(-traits, 0)], 1).ravel()


def shape(
    state: dict[str, np.ndarray], config: dict, coefficients: np.ndarray, traits: np.ndarray
) -> np.ndarray:
    """Places `[V, 3]`, canonical metres, under coefficients `[100]` and sliders `[T]`."""
    points, numbers = state["positions"].copy(), np.r_[coefficients, sides(traits)]
    skin = config["skin_vertices"]
    moved = np.tensordot(numbers, state["modes"], 1) * config["step_m"]
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
