"""Training of the `paper` decoder.

Losses are as in the paper (section 3.3): squares of position, velocity and acceleration. In our recipe each
vertex first attends to nearby landmarks, a loss keeps it so (`local_start`), the attention learns at a tenth
of the rate, half of the samples are mirrored, and the rate rises and then falls.
"""

import math
from collections.abc import Callable
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
from training.systems.freetalk.stm.local_start import attend_nearby, locality
from training.systems.freetalk.stm.paper import LANDMARKS, PaperConfig, PaperDecoder

FRAMES = 4
SAVE_EVERY = 200
LOG_EVERY = 2000
LANDMARK_GAIN = 20.0
ATTENTION_RATE = 0.1
"""Share of the learning rate for the parameters that decide which landmarks a vertex attends to."""
LOCALITY = 0.02
"""Weight of `locality` beside squares in cm². Its gradient does not reach the mesh encoder."""
START_MESHES = 8
"""Number of meshes of each face to which the attention is fitted before training."""


@dataclass
class PaperMesh:
    """A mesh of `corpus.prepared` with the decoder's inputs [V, 6] and operators."""

    mesh: PreparedMesh
    inputs: Tensor
    operators: SurfaceOperators


def paper_mesh(mesh: PreparedMesh, config: PaperConfig) -> PaperMesh:
    """Computes inputs and operators; takes about a second."""
    positions = mesh.geometry.positions.double().numpy()
    operators = surface_operators(positions, mesh.triangles, config.eigenpairs)
    normals = torch.from_numpy(vertex_normals(positions, mesh.triangles)).float()
    return PaperMesh(mesh, torch.cat([mesh.geometry.positions, normals], dim=1), operators)


def mirrored(face: PaperMesh) -> PaperMesh:
    """Mirrors a mesh. The second tangent changes sign, so that tangent frames stay right-handed."""
    flip = FLIP.to(face.inputs.device)
    operators = replace(face.operators, grad_y=-1.0 * face.operators.grad_y)
    mesh = replace(face.mesh, geometry=face.mesh.geometry.mirrored())
    return PaperMesh(mesh, face.inputs * flip.repeat(2), operators)


def moved(face: PaperMesh, device: torch.device) -> PaperMesh:
    """The mesh on another device."""
    operators = {name: value.to(device) for name, value in vars(face.operators).items()}
    mesh = replace(face.mesh, geometry=face.mesh.geometry.to(device))
    return PaperMesh(mesh, face.inputs.to(device), SurfaceOperators(**operators))


def sequence(rng: np.random.Generator, speech: np.ndarray) -> np.ndarray:
    """Channel weights of a short sequence. [FRAMES, M]."""
    phase = np.linspace(0.0, rng.uniform(0.2, 1.0), FRAMES)[:, None]
    if rng.random() < 0.25:
        ends = random_combinations(rng, 2)
        return ends[:1] + phase * (ends[1:] - ends[:1])
    start = rng.integers(len(speech) - 4 * FRAMES)
    spoken = speech[start : start + 4 * FRAMES : 4] * rng.uniform(0.7, 1.4)
    ends = upper_face(rng, 2)
    return spoken + ends[:1] + phase * (ends[1:] - ends[:1])


def motion_of(rng: np.random.Generator, mesh: PreparedMesh, speech: np.ndarray | None) -> Tensor:
    """Displacements of all vertices in a short sequence, [FRAMES, V, 3] dm."""
    if isinstance(mesh, SequenceMesh):
        return mesh.in_a_row(rng, FRAMES)
    weights = torch.from_numpy(sequence(rng, speech)).float()
    return torch.einsum("tm,mvx->tvx", weights, mesh.modes)


def predict(model: PaperDecoder, face: PaperMesh, landmarks: Tensor) -> Tensor:
    """Displacements of all vertices, dm. landmarks: [T, N, 3] dm. Returns [T, V, 3]."""
    return model(face.inputs, landmarks, face.operators)


@torch.no_grad()
def prepare_weights(model: PaperDecoder, faces: list[PaperMesh]) -> None:
    """Starts with no output, input gains for landmark motion of about 0.05 dm, and local attention."""
    torch.nn.init.zeros_(model.decoder.last_lin.weight)
    torch.nn.init.zeros_(model.decoder.last_lin.bias)
    latent = model.config.latent
    model.landmark_encoder.layer_0.weight.mul_(LANDMARK_GAIN)
    model.decoder.first_lin.weight[:, latent : latent + 3 * LANDMARKS].mul_(LANDMARK_GAIN)
    attend_nearby(model, *places_of(faces))


def places_of(faces: list[PaperMesh]) -> tuple[list[tuple[Tensor, SurfaceOperators]], Tensor]:
    """Inputs and operators of faces, and their mean landmarks at rest [N, 3] dm."""
    mean = torch.stack([face.mesh.geometry.landmarks for face in faces]).mean(0)
    return [(face.inputs, face.operators) for face in faces], mean


def parameter_groups(model: PaperDecoder, recipe: Recipe) -> list[dict]:
    """Two parameter groups. In our recipe those that choose a vertex's landmarks learn more slowly."""
    deciding = [model.attention.query, model.attention.key, model.landmark_projection]
    slow = [parameter for layer in deciding for parameter in layer.parameters()]
    rest = [p for p in model.parameters() if all(p is not other for other in slow)]
    share = 1.0 if recipe.plain else ATTENTION_RATE
    return [{"params": slow, "share": share}, {"params": rest, "share": 1.0}]


def motion_loss(error: Tensor, recipe: Recipe) -> Tensor:
    """Eq. 15: squared position, velocity and acceleration of an error [T, V, 3] dm, in cm²."""
    loss = squared(error) + recipe.velocity * squared(error.diff(dim=0))
    return loss + recipe.acceleration * squared(error.diff(n=2, dim=0))


def squared(difference: Tensor) -> Tensor:
    """Mean of squared lengths, in cm²."""
    return 100.0 * difference.square().sum(-1).mean()


def train_paper(
    config: PaperConfig,
    speech: np.ndarray | None,
    steps: int,
    seed: int,
    prepared: dict[str, list[PaperMesh]],
    out: Path,
    recipe: Recipe = STM["ours"],
    machine: Machine | None = None,
    decoder: type[PaperDecoder] = PaperDecoder,
    start: PaperDecoder | None = None,
    log_every: int = LOG_EVERY,
    judge: Callable[[PaperDecoder], dict[str, float]] = lambda _: {},
) -> PaperDecoder:
    """Trains on the faces of `prepared`; resumes from `out`.

    `speech` holds weights of the meshes' modes; it is None for meshes with their own sequences. `decoder` may
    be a class that lacks a part, for comparison. The weights of `start` go on from there; its attention
    becomes local again. A row of the log has the mean loss since the last row and
    the scores that `judge` returns for the model.
    """
    machine = machine or Machine("cpu")
    torch.manual_seed(seed)
    model = decoder(config)
    faces = [face for meshes in prepared.values() for face in meshes[:START_MESHES]]
    if start is not None:
        model.load_state_dict(start.state_dict())
        attend_nearby(model, *places_of(faces))
    elif not recipe.plain:
        prepare_weights(model, faces)
    machine.place(model, seed)
    draw = Draw(np.random.default_rng(machine.seed(seed)), prepared, speech, machine.device, recipe.plain)
    groups = parameter_groups(model, recipe)
    optimiser = torch.optim.AdamW(groups, lr=recipe.rate, weight_decay=recipe.weight_decay)
    run = Run(
        out, {"model": model, "optimiser": optimiser}, steps, SAVE_EVERY, {"draws": draw.random}, machine
    )
    losses: list[float] = []
    for step in range(run.first, steps):
        for group in optimiser.param_groups:
            group["lr"] = group["share"] * recipe.rate * (warm(step, steps) if recipe.annealed else 1.0)
        face, landmarks, motion = draw.next(step)
        with machine.autocast():
            features = model.encode(face.inputs, face.operators)
            predicted = model.decode(features, landmarks, face.operators)
        loss = motion_loss(predicted.float() - motion, recipe)
        if not recipe.plain:
            geometry = face.mesh.geometry
            loss = loss + LOCALITY * locality(
                model, features.detach().float(), geometry.positions, landmarks[:1], geometry.landmarks
            )
        machine.step(loss, model, optimiser, 1.0)
        losses.append(loss.item())
        run.after(step, losses[-1])
        due = step % log_every == log_every - 1 or step == steps - 1
        if due and machine.rank == 0:
            scores = judge(model)
            run.log({"step": step + 1, "s": run.seconds(), "loss": float(np.mean(losses)), **scores})
            losses.clear()
    return model.cpu().eval()


def warm(step: int, steps: int) -> float:
    """Factor of the learning rate: rises over 200 steps, while a cosine takes it to zero at the end."""
    return min(1.0, (step + 1) / 200) * 0.5 * (1.0 + math.cos(math.pi * step / steps))


class Draw:
    """Draws a mesh and a short sequence of its motion; mirrors both half of the time unless `plain`."""

    def __init__(self, random: np.random.Generator, prepared: dict[str, list[PaperMesh]],
                 speech: np.ndarray | None, device: torch.device, plain: bool):  # fmt: skip
        self.random, self.speech, self.device, self.plain = random, speech, device, plain
        self.faces = [[moved(face, device) for face in meshes] for meshes in prepared.values()]
        self.images: dict[int, PaperMesh] = {}

    def next(self, step: int) -> tuple[PaperMesh, Tensor, Tensor]:
        """The mesh, landmark displacements [T, N, 3] and those of all vertices [T, V, 3], dm."""
        meshes = self.faces[step % len(self.faces)]
        face = meshes[self.random.integers(len(meshes))]
        motion = motion_of(self.random, face.mesh, self.speech)
        landmarks = motion[:, face.mesh.landmarks]
        if not self.plain and self.random.random() < 0.5:
            face, motion = self.image(face), motion * FLIP
            landmarks = landmarks[:, MIRROR] * FLIP
        return face, landmarks.to(self.device), motion.to(self.device)

    def image(self, face: PaperMesh) -> PaperMesh:
        """The mirrored mesh, made once."""
        if id(face) not in self.images:
            self.images[id(face)] = mirrored(face)
        return self.images[id(face)]
