"""Golden of the `static` decoder: a procedural face, the plate's weights and a debug network."""

from pathlib import Path

import numpy as np
import torch

from training.align import canonical_landmarks
from training.deform import tension_screened_biharmonic as plate
from training.deform.static_weights import (
    CONFIGS,
    StaticWeights,
    VertexGeometry,
    deform,
)
from training.goldens import write_golden


def procedural_face(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A bent sheet with a hole for the mouth. Vertices [V, 3] m, triangles [F, 3], landmarks [N].

    The vertices are jittered so that no four lie on a circle and the Delaunay edges are unique.
    """
    columns, rows = 26, 30
    x, y = np.meshgrid(np.linspace(-0.085, 0.085, columns), np.linspace(-0.11, 0.06, rows))
    x, y = x + rng.uniform(-1e-3, 1e-3, x.shape), y + rng.uniform(-1e-3, 1e-3, y.shape)
    z = 0.09 - 9.0 * x**2 - 3.0 * (y + 0.03) ** 2
    vertices = np.stack([x, y, z], -1).reshape(-1, 3).astype(np.float32)
    number = np.arange(rows * columns).reshape(rows, columns)
    a, b, c, d = number[:-1, :-1], number[:-1, 1:], number[1:, :-1], number[1:, 1:]
    triangles = np.concatenate([np.stack(t, -1).reshape(-1, 3) for t in ((a, b, d), (a, d, c))])
    centre = vertices[triangles].mean(1)
    mouth = (abs(centre[:, 0]) < 0.02) & (abs(centre[:, 1] + 0.059) < 0.004)
    distance = np.linalg.norm(vertices[None] - canonical_landmarks()[:, None], axis=-1)
    return vertices, triangles[~mouth], distance.argmin(1)


def write(out: Path, shared: Path) -> Path:
    """Writes `static_weights_debug.safetensors`: the mesh (canonical metres), `base` [V, N],
    `remoteness` [V], `weights.*`, the input `landmark_motion` [T, N, 3] m and `output` [T, V, 3] m."""
    rng = np.random.default_rng(4)
    torch.manual_seed(4)
    vertices, triangles, landmarks = procedural_face(rng)
    cm = 100.0 * vertices.astype(np.float64)
    laplacian, mass = plate.laplacian_and_mass(cm, triangles)
    remoteness = plate.landmark_remoteness(cm, laplacian, landmarks)
    base = plate.solve(cm, laplacian, mass, remoteness, landmarks, plate.TensionScreened())
    positions = torch.from_numpy(10.0 * vertices)
    geometry = VertexGeometry(
        positions,
        positions[torch.from_numpy(landmarks)],
        torch.from_numpy(base).float(),
        torch.from_numpy(remoteness).float(),
    )
    model = StaticWeights(CONFIGS["debug"]).eval()
    motion = 0.01 * torch.randn(2, 68, 3)
    with torch.no_grad():
        for parameter in model.parameters():
            parameter.normal_(0.0, 0.15)
        model.feature_mean.normal_(0.0, 0.2)
        model.feature_scale.uniform_(0.5, 1.5)
        # Learn one kind near the face and one far from it, so that the face is half familiar.
        near = geometry.landmarks + 0.0078 * torch.randn(68, 3) + 0.002 * torch.randn(20, 68, 3)
        model.learn_shapes(0, near)
        model.learn_shapes(1, near + 0.1)
        output = 0.1 * deform(model, geometry, 10.0 * motion, learned=1.0)
    tensors = {
        "vertices": torch.from_numpy(vertices),
        "triangles": torch.from_numpy(triangles).int(),
        "landmarks": torch.from_numpy(landmarks).int(),
        "base": geometry.base,
        "remoteness": geometry.remoteness,
        "landmark_motion": motion,
        "output": output,
    }
    about = {
        "source": "random weights, seed 4, procedural mesh",
        "tolerance": "1e-4 absolute for base and output, relative for remoteness",
    }
    path = out / "static_weights_debug.safetensors"
    return write_golden(path, tensors, "static_weights", model, CONFIGS["debug"].to_json(), **about)
