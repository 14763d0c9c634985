"""Golden of creases: random points on a procedural face, and the creases another face gets from them."""

from pathlib import Path

import numpy as np
import torch

from training.deform.creases import Creases
from training.deform.golden_static_weights import procedural_face
from training.goldens import write_golden

POINTS, RANK = 300, 3


def write(out: Path, shared: Path) -> Path:
    """Writes `creases_debug.safetensors`: the creases as `weights.debug.*`, the other face as `positions`
    [V, 3] dm, `triangles` [F, 3] and `landmarks` [N, 3] dm, and its `s B` as `carried` [V, 3, K]."""
    rng = np.random.default_rng(6)
    vertices, triangles, numbers = procedural_face(rng)
    vertices = 10.0 * vertices.astype(np.float64)
    normals = np.array([0.0, 0.0, 1.0]) + rng.normal(0.0, 0.6, vertices.shape)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    chosen = rng.choice(len(vertices), POINTS, replace=False)
    motion = rng.normal(0.0, 1.0, (RANK, 204))
    cross = rng.normal(0.0, 1.0, (POINTS, 3, RANK))
    reference = vertices[numbers] + rng.normal(0.0, 0.02, (68, 3))
    creases = Creases(vertices[chosen], normals[chosen], reference, cross, motion)
    other = vertices * [1.1, 0.9, 1.05] + rng.normal(0.0, 0.01, vertices.shape)
    carried = creases.transferred(other, triangles, other[numbers])
    tensors = {f"weights.debug.{k}": v for k, v in vars(creases).items()}
    tensors |= {"positions": other, "landmarks": other[numbers], "carried": carried}
    tensors = {k: torch.from_numpy(np.asarray(v, np.float32)) for k, v in tensors.items()}
    tensors["triangles"] = torch.from_numpy(triangles.astype(np.int32))
    about = {
        "source": "random weights, seed 6, procedural mesh",
        "tolerance": "1e-3 absolute: weights of points that are hit exactly are steep",
    }
    config = {"faces": [{"name": "debug", "points": POINTS, "rank": RANK}]}
    return write_golden(out / "creases_debug.safetensors", tensors, "creases", None, config, **about)
