"""Training of the `paper` decoder.

Losses as in the paper (section 3.3): position, velocity and acceleration weighted 1, 0.5, 0.2.
Differs: distances instead of squared distances, which is what is measured afterwards.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from training.corpus.expressions import random_combinations, upper_face
from training.corpus.prepared import PreparedMesh
from training.corpus.sequence_meshes import SequenceMesh
from training.deform.static_weights import FLIP, MIRROR
from training.deform.surface import surface_operators, vertex_normals
from training.nn.diffusion_net import SurfaceOperators
from training.run import Run
from training.systems.freetalk.stm.paper import LANDMARKS, PaperConfig, PaperDecoder

FRAMES = 4
LANDMARK_GAIN = 20.0


@dataclass
class PaperMesh:
    """A mesh as the decoder takes it: inputs [V, C], operators, and what `corpus.prepared` holds."""

    mesh: PreparedMesh
    inputs: Tensor
    operators: SurfaceOperators


def paper_mesh(mesh: PreparedMesh, config: PaperConfig) -> PaperMesh:
    """Computes inputs and operators; about a second."""
    positions = mesh.geometry.positions.double().numpy()
    operators = surface_operators(positions, mesh.triangles, config.eigenpairs)
    normals = torch.from_numpy(vertex_normals(positions, mesh.triangles)).float()
    g = mesh.geometry
    return PaperMesh(mesh, vertex_inputs(g.positions, normals, g.landmarks, config.inputs), operators)


def vertex_inputs(positions: Tensor, normals: Tensor, landmarks: Tensor, inputs: int) -> Tensor:
    """Position and normal, and with 278 inputs the offset from and distance to each landmark, dm."""
    own = torch.cat([positions, normals], dim=1)
    if inputs == own.shape[1]:
        return own
    offsets = positions[:, None] - landmarks
    return torch.cat([own, offsets.flatten(1), offsets.norm(dim=-1)], dim=1)


def mirrored(seen: PaperMesh, inputs: int) -> PaperMesh:
    """The same seen in a mirror; the second tangent turns round, so that frames stay right-handed."""
    g = seen.mesh.geometry.mirrored()
    normals = seen.inputs[:, 3:6] * FLIP
    operators = replace(seen.operators, grad_y=-1.0 * seen.operators.grad_y)
    return PaperMesh(
        replace(seen.mesh, geometry=g),
        vertex_inputs(g.positions, normals, g.landmarks, inputs),
        operators,
    )


def sequence(rng: np.random.Generator, speech: np.ndarray) -> np.ndarray:
    """Channel weights of a few frames in a row. [FRAMES, M]."""
    phase = np.linspace(0.0, rng.uniform(0.2, 1.0), FRAMES)[:, None]
    if rng.random() < 0.25:
        ends = random_combinations(rng, 2)
        return ends[:1] + phase * (ends[1:] - ends[:1])
    start = rng.integers(len(speech) - 4 * FRAMES)
    spoken = speech[start : start + 4 * FRAMES : 4] * rng.uniform(0.7, 1.4)
    ends = upper_face(rng, 2)
    return spoken + ends[:1] + phase * (ends[1:] - ends[:1])


def motion_of(rng: np.random.Generator, mesh: PreparedMesh, speech: np.ndarray | None) -> Tensor:
    """Displacements of all vertices in a few frames in a row, [FRAMES, V, 3] dm."""
    if isinstance(mesh, SequenceMesh):
        return mesh.in_a_row(rng, FRAMES)
    weights = torch.from_numpy(sequence(rng, speech)).float()
    return torch.einsum("tm,mvx->tvx", weights, mesh.modes)


def predict(model: PaperDecoder, seen: PaperMesh, landmarks: Tensor) -> Tensor:
    """Displacements of all vertices, dm. landmarks: [T, N, 3] dm. Returns [T, V, 3]."""
    moved = model(seen.inputs, landmarks, seen.operators)
    if model.config.base:
        moved = moved + torch.einsum("vn,tnx->tvx", seen.mesh.geometry.base, landmarks)
    return moved


def distance(difference: Tensor) -> Tensor:
    """Mean length in centimetres, smooth at zero."""
    return (100.0 * difference.square().sum(-1) + 1e-5).sqrt().mean()


@torch.no_grad()
def prepare_weights(model: PaperDecoder) -> None:
    """Starts at no motion; alone, the weights that read landmarks are scaled to their size of 0.05 dm."""
    torch.nn.init.zeros_(model.decoder.last_lin.weight)
    torch.nn.init.zeros_(model.decoder.last_lin.bias)
    if not model.config.base:
        latent = model.config.latent
        model.landmark_encoder.layer_0.weight.mul_(LANDMARK_GAIN)
        model.decoder.first_lin.weight[:, latent : latent + 3 * LANDMARKS].mul_(LANDMARK_GAIN)


def train_paper(
    config: PaperConfig,
    speech: np.ndarray | None,
    seconds: float,
    steps: int | None,
    seed: int,
    prepared: dict[str, list[PaperMesh]],
    out: Path,
    save_every: int = 200,
    rate: float = 2e-3,
) -> PaperDecoder:
    """Trains for a number of steps, learning rate falling to zero; resumes from `out`.

    Without `steps` it trains for seconds of processor time, and cannot resume. `speech` are weights of the
    meshes' modes, none for meshes with sequences of their own.
    """
    faces = tuple(prepared)
    torch.manual_seed(seed)
    rng = np.random.default_rng(seed)
    model = PaperDecoder(config)
    prepare_weights(model)
    optimiser = torch.optim.AdamW(model.parameters(), lr=rate, weight_decay=1e-2)
    parts = {"model": model, "optimiser": optimiser}
    run = None if steps is None else Run(out, parts, steps, save_every, {"draws": rng})
    started, step = time.process_time(), 0 if run is None else run.first
    spent = lambda: (time.process_time() - started) / seconds  # noqa: E731
    while (share := spent() if steps is None else step / steps) < 1.0:
        for group in optimiser.param_groups:
            group["lr"] = rate * min(1.0, (step + 1) / 100) * max(0.0, 1.0 - share)
        seen = prepared[faces[step % len(faces)]]
        seen = seen[rng.integers(len(seen))]
        motion = motion_of(rng, seen.mesh, speech)
        landmarks = motion[:, seen.mesh.landmarks]
        if rng.random() < 0.5:
            seen, motion = mirrored(seen, config.inputs), motion * FLIP
            landmarks = landmarks[:, MIRROR] * FLIP
        error = predict(model, seen, landmarks) - motion
        loss = distance(error) + distance(error[:, seen.mesh.lips])
        loss = loss + 0.5 * distance(error.diff(dim=0)) + 0.2 * distance(error.diff(n=2, dim=0))
        optimiser.zero_grad()
        loss.backward()
        torch.nn.utils.clip_grad_norm_(model.parameters(), 1.0)
        optimiser.step()
        if run is not None:
            run.after(step, loss.item())
        elif step % 50 == 0:
            print(f"paper {faces} {step}: {loss.item():.4f} {share * seconds:.0f} s", flush=True)
        step += 1
    return model.eval()
