"""Training of the `paper` decoder.

Losses as in the paper (section 3.3): position, velocity and acceleration weighted 1, 0.5, 0.2. Ours are
distances instead of squared distances, which is what is measured afterwards; `--recipe paper` has the
printed ones.
"""

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
from training.machine import Machine
from training.nn.diffusion_net import SurfaceOperators
from training.run import Run
from training.systems.freetalk.recipes import STM, Recipe
from training.systems.freetalk.stm.paper import LANDMARKS, PaperConfig, PaperDecoder

FRAMES = 4
SAVE_EVERY = 200
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
    normals = seen.inputs[:, 3:6] * FLIP.to(seen.inputs.device)
    operators = replace(seen.operators, grad_y=-1.0 * seen.operators.grad_y)
    return PaperMesh(
        replace(seen.mesh, geometry=g),
        vertex_inputs(g.positions, normals, g.landmarks, inputs),
        operators,
    )


def moved(seen: PaperMesh, device: torch.device) -> PaperMesh:
    """The same on another device."""
    operators = {name: value.to(device) for name, value in vars(seen.operators).items()}
    mesh = replace(seen.mesh, geometry=seen.mesh.geometry.to(device))
    return PaperMesh(mesh, seen.inputs.to(device), SurfaceOperators(**operators))


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


def motion_loss(error: Tensor, lips: Tensor, recipe: Recipe) -> Tensor:
    """Position, velocity and acceleration of an error [T, V, 3] dm, weighted as eq. 15.

    `plain` means squares in cm²; ours are lengths in cm, and the lips [V] count a second time.
    """
    measure = squared if recipe.plain else distance
    loss = measure(error) if recipe.plain else measure(error) + measure(error[:, lips])
    loss = loss + recipe.velocity * measure(error.diff(dim=0))
    return loss + recipe.acceleration * measure(error.diff(n=2, dim=0))


def squared(difference: Tensor) -> Tensor:
    """Mean of squared lengths, cm²."""
    return 100.0 * difference.square().sum(-1).mean()


@dataclass
class Length:
    """How long to train: steps, else seconds of processor time, which cannot be resumed."""

    steps: int | None = None
    seconds: float = 180.0


def train_paper(
    config: PaperConfig,
    speech: np.ndarray | None,
    length: Length,
    seed: int,
    prepared: dict[str, list[PaperMesh]],
    out: Path,
    recipe: Recipe = STM["ours"],
    machine: Machine | None = None,
    decoder: type[PaperDecoder] = PaperDecoder,
) -> PaperDecoder:
    """Trains on the faces of `prepared`; resumes from `out`.

    `speech` are weights of the meshes' modes, none for meshes with sequences of their own. Another `decoder`
    is one that lacks a part, for comparison.
    """
    machine = machine or Machine("cpu")
    torch.manual_seed(seed)
    model = decoder(config)
    if not recipe.plain or config.base:
        prepare_weights(model)
    machine.place(model, seed)
    draw = Draw(np.random.default_rng(machine.seed(seed)), prepared, speech, machine.device, recipe.plain)
    optimiser = torch.optim.AdamW(model.parameters(), lr=recipe.rate, weight_decay=recipe.weight_decay)
    parts = {"model": model, "optimiser": optimiser}
    run = None
    if length.steps is not None:
        run = Run(out, parts, length.steps, SAVE_EVERY, {"draws": draw.random}, machine)
    clock = Clock(length, 0 if run is None else run.first)
    while (share := clock.share()) < 1.0:
        for group in optimiser.param_groups:
            group["lr"] = recipe.rate * (warm(clock.step, share) if recipe.annealed else 1.0)
        seen, landmarks, motion = draw.next(clock.step)
        with machine.autocast():
            predicted = predict(model, seen, landmarks)
        loss = motion_loss(predicted.float() - motion, seen.mesh.lips, recipe)
        machine.step(loss, model, optimiser, 1.0)
        if run is not None:
            run.after(clock.step, loss.item())
        elif clock.step % 50 == 0:
            print(f"paper {[*prepared]} {clock.step}: {loss.item():.4f}", flush=True)
        clock.step += 1
    return model.cpu().eval()


def warm(step: int, share: float) -> float:
    """The share of the learning rate: up in 100 steps, down to zero at the end."""
    return min(1.0, (step + 1) / 100) * max(0.0, 1.0 - share)


class Clock:
    """Counts steps, and what share of the training is over."""

    def __init__(self, length: Length, first: int):
        self.length, self.step, self.started = length, first, time.process_time()

    def share(self) -> float:
        """0 at the start, 1 at the end."""
        if self.length.steps is not None:
            return self.step / self.length.steps
        return (time.process_time() - self.started) / self.length.seconds


class Draw:
    """Draws a mesh, seen in the mirror half of the time unless `plain`, and frames in a row on it."""

    def __init__(self, random: np.random.Generator, prepared: dict[str, list[PaperMesh]],
                 speech: np.ndarray | None, device: torch.device, plain: bool):  # fmt: skip
        self.random, self.speech, self.device, self.plain = random, speech, device, plain
        self.faces = [[moved(seen, device) for seen in meshes] for meshes in prepared.values()]
        self.images: dict[int, PaperMesh] = {}

    def next(self, step: int) -> tuple[PaperMesh, Tensor, Tensor]:
        """The mesh, landmark displacements [T, N, 3] and those of all vertices [T, V, 3], dm."""
        meshes = self.faces[step % len(self.faces)]
        seen = meshes[self.random.integers(len(meshes))]
        motion = motion_of(self.random, seen.mesh, self.speech)
        landmarks = motion[:, seen.mesh.landmarks]
        if not self.plain and self.random.random() < 0.5:
            seen, motion = self.image(seen), motion * FLIP
            landmarks = landmarks[:, MIRROR] * FLIP
        return seen, landmarks.to(self.device), motion.to(self.device)

    def image(self, seen: PaperMesh) -> PaperMesh:
        """The mesh in the mirror, made once."""
        if id(seen) not in self.images:
            self.images[id(seen)] = mirrored(seen, seen.inputs.shape[1])
        return self.images[id(seen)]
