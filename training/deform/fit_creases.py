"""Measures the creases of reference faces and writes the model that `deform/creases.rs` reads.

    python -m training.deform.fit_creases --data ../shared/data
    python -m training.deform.fit_creases --data ../shared/data --score

The references are ICT FaceKit's mean face and MakeHuman's, one for each kind that the static weights know.
The part of the 51 shapes that these weights do not explain is a linear function of the landmarks. It is
regressed on them over speech, the upper face and whole expressions. The landmarks get noise of `NOISE_DM`, so
that other motion is not amplified. Lips, chin and jaw are left out, because every face moves in its own way
there. Points are drawn on the surface with their mirror images, and the residual is the mean of both sides.
With `--score` it writes nothing. It prints the errors of the stored creases on identities and warps on which
they were not measured.
"""

from dataclasses import dataclass, fields
from pathlib import Path
from typing import Annotated

import numpy as np
import torch
from scipy.spatial import cKDTree

from training import DATA, shipped
from training.corpus.emotions import BASIC, PROTOTYPES, shape_weights
from training.corpus.expressions import evaluation_frames, load_speech, training_frames
from training.corpus.faces import Face, align, load_ict, load_makehuman
from training.corpus.prepared import PreparedMesh, prepare
from training.corpus.remesh import remesh
from training.corpus.warp import stylise
from training.deform.creases import Creases
from training.deform.static_weights import MIRROR, StaticConfig, StaticWeights, deform
from training.deform.surface import vertex_normals
from training.flags import run_command
from training.nn.checkpoint import load_model, read_model, write_model

NOISE_DM = 0.005
RANK = 18
POINTS = {"ict": 3500, "makehuman": 2000}
"""Number of points on one side of each reference. The other side has the same number.

The references are in the order of the static weights' kinds.
"""
FRAMES = 1500
LEAST_DM = 5e-4
"""No points are drawn on a triangle whose residual never exceeds this: it has nothing to teach."""
FACE = range(17, 68)
"""Landmarks whose motion may fold creases: all but the contour's."""
SIDE = np.array([-1.0, 1.0, 1.0])


def read_static(models: Path | None) -> StaticWeights:
    """Loads the static weights of the folder `models`, or the shipped ones."""
    return load_model(
        models / "static_weights" if models else shipped("static_weights"),
        lambda config: StaticWeights(StaticConfig(**config)),
    )


@torch.no_grad()
def residual(model: StaticWeights, mesh: PreparedMesh) -> np.ndarray:
    """The part of every shape that the static weights do not explain, [M, V, 3] dm."""
    moved = deform(model, mesh.geometry, mesh.modes[:, mesh.landmarks], 1.0)
    return (mesh.modes - moved).numpy()


def frames(rng: np.random.Generator, data: Path) -> np.ndarray:
    """Channel weights to measure on, [T, M]: speech and upper face, two fifths with an emotion."""
    spoken = training_frames(rng, load_speech(data).train, FRAMES)
    emotions = shape_weights()[rng.integers(len(PROTOTYPES), size=FRAMES)]
    return spoken + (rng.random((FRAMES, 1)) < 0.4) * rng.uniform(0.3, 1.3, (FRAMES, 1)) * emotions


def share(positions: np.ndarray, landmarks: np.ndarray) -> np.ndarray:
    """1 where creases count, 0 at the lips and from the mouth down. [P, 3], [N, 3] dm → [P]."""
    outline = np.linalg.norm(positions[:, None] - landmarks[48:60], axis=2).min(1)
    off_lips = ((outline - 0.06) / 0.12).clip(0.0, 1.0)
    above = ((positions[:, 1] - landmarks[48:60, 1].mean() + 0.05) / 0.15).clip(0.0, 1.0)
    inside = np.linalg.norm(positions - landmarks[48:].mean(0), axis=1) < 0.12
    return off_lips * above * ~inside


@dataclass
class Surface:
    """Points of a triangulated face: corners [P, 3] and their shares [P, 3]; normals [P, 3]."""

    corners: np.ndarray
    shares: np.ndarray
    normals: np.ndarray

    def of(self, field: np.ndarray) -> np.ndarray:
        """A field over vertices [..., V, 3] at the points, [..., P, 3]."""
        return np.einsum("pc,...pcx->...px", self.shares, field[..., self.corners, :])


def draw(rng: np.random.Generator, face: PreparedMesh, field: np.ndarray, count: int) -> Surface:
    """Draws `count` points on the left half where `field` [M, V, 3] moves, farthest first among random ones.

    They are up to three times as dense where the field changes fastest over the surface.
    """
    positions, triangles = face.geometry.positions.numpy().astype(np.float64), face.triangles
    edges = positions[triangles[:, 1:]] - positions[triangles[:, :1]]
    cross = np.cross(edges[:, 0], edges[:, 1])
    speaks = np.abs(field[:, triangles]).max((0, 2, 3)) > LEAST_DM
    speaks &= positions[triangles].mean(1)[:, 0] > 0.0
    change = np.linalg.norm(field[:, triangles[:, 1:]] - field[:, triangles[:, :1]], axis=(0, 3))
    steepness = (change / np.linalg.norm(edges, axis=2)).max(1)
    detail = (steepness / np.quantile(steepness[speaks], 0.98)).clip(0.0, 1.0) ** 0.5
    chance = np.linalg.norm(cross, axis=1) * speaks * (0.1 + detail)
    chosen = rng.choice(len(triangles), 10 * count, p=chance / chance.sum())
    shares = rng.dirichlet(np.ones(3), len(chosen))
    places = np.einsum("pc,pcx->px", shares, positions[triangles[chosen]])
    keep = farthest_first(places, detail[chosen].clip(1 / 3), count)
    unit = cross / np.linalg.norm(cross, axis=1, keepdims=True)
    return Surface(triangles[chosen[keep]], shares[keep], unit[chosen[keep]])


def farthest_first(points: np.ndarray, stretch: np.ndarray, count: int) -> np.ndarray:
    """Indices of `count` points, each the farthest from all before. `stretch` multiplies the distances."""
    chosen, distance = [0], np.full(len(points), np.inf)
    while len(chosen) < count:
        distance = np.minimum(distance, np.linalg.norm(points - points[chosen[-1]], axis=1))
        chosen.append(int((stretch * distance).argmax()))
    return np.array(chosen)


def reflected(landmarks: np.ndarray) -> np.ndarray:
    """Landmark motion seen in a mirror, [..., N, 3]."""
    return landmarks[..., MIRROR.numpy(), :] * SIDE


def beside(mesh: PreparedMesh, field: np.ndarray, places: np.ndarray) -> np.ndarray:
    """Interpolates a field over vertices [M, V, 3] at places near the surface, [M, P, 3]."""
    distance, index = cKDTree(mesh.geometry.positions.numpy()).query(places, k=4)
    weight = 1.0 / (distance + 1e-4) ** 2
    return np.einsum("pk,mpkx->mpx", weight / weight.sum(1, keepdims=True), field[:, index])


def regress(motion: np.ndarray, left_over: np.ndarray) -> np.ndarray:
    """Ridge regression, [T, N, 3] and [T, P, 3] → [3N, P * 3]. Landmarks outside `FACE` are ignored."""
    heard = np.array([3 * n + axis for n in FACE for axis in range(3)])
    x, y = motion.reshape(len(motion), -1)[:, heard], left_over.reshape(len(motion), -1)
    gram = x.T @ x / len(x) + NOISE_DM**2 * np.eye(len(heard))
    out = np.zeros((motion[0].size, y.shape[1]))
    out[heard] = np.linalg.solve(gram, x.T @ y / len(x))
    return out


def mirrored_map(left: np.ndarray) -> np.ndarray:
    """The map [3N, P * 3] of the points' mirror images."""
    turned = reflected(left.T.reshape(left.shape[1], -1, 3)).reshape(left.shape[1], -1).T
    return (turned.reshape(len(left), -1, 3) * SIDE).reshape(left.shape)


def compress(whole: np.ndarray, motion: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The B [P, 3, K] and C [K, 3N] that best replace a map [3N, P * 3] for motion like `motion`."""
    x = motion.reshape(len(motion), -1)
    root = np.linalg.cholesky(x.T @ x / len(x) + NOISE_DM**2 * np.eye(x.shape[1]))
    u, size, values = np.linalg.svd(root.T @ whole, full_matrices=False)
    print("singular values", (size[: RANK + 4] / size[0]).round(3).tolist())
    combinations = np.linalg.solve(root.T, u[:, :RANK]).T
    scale = 1.0 / np.abs(combinations).max(1)
    cross = (size[:RANK, None] * values[:RANK]) / scale[:, None]
    return cross.reshape(RANK, -1, 3).transpose(1, 2, 0), combinations * scale[:, None]


def references(data: Path) -> dict[str, Face]:
    """The faces whose creases are measured, by their names in `POINTS`."""
    return {"ict": align(load_ict(data).mean), "makehuman": load_makehuman(data)}


def measure(
    rng: np.random.Generator, mesh: PreparedMesh, model: StaticWeights, weights: np.ndarray, count: int
) -> Creases:
    """The creases of a face, symmetric, at `count` points per side. weights: [T, M], of its shapes."""
    position, landmarks = mesh.geometry.positions.numpy(), mesh.geometry.landmarks.numpy()
    field = residual(model, mesh) * share(position, landmarks)[:, None]
    surface = draw(rng, mesh, field, count)
    points = surface.of(position)
    moved = np.tensordot(weights, mesh.modes[:, mesh.landmarks].numpy(), 1)
    here = np.tensordot(weights, surface.of(field), 1)
    other = np.tensordot(weights, beside(mesh, field, points * SIDE), 1) * SIDE
    both = np.concatenate([moved, reflected(moved)])
    left = regress(both, np.concatenate([here, other]))
    cross, motion = compress(np.concatenate([left, mirrored_map(left)], axis=1), both)
    return Creases(
        np.concatenate([points, points * SIDE]),
        np.concatenate([surface.normals, surface.normals * SIDE]),
        0.5 * (landmarks + reflected(landmarks)),
        cross,
        motion,
    )


def write_creases(folder: Path, faces: dict[str, Creases]) -> None:
    """Writes a model folder with a prefix for each face. All but the landmarks is f16."""
    state = {
        f"{name}.{key}": torch.from_numpy(value).float()
        for name, creases in faces.items()
        for key, value in vars(creases).items()
    }
    sizes = [
        {"name": name, "points": len(creases.points), "rank": len(creases.motion)}
        for name, creases in faces.items()
    ]
    write_model(folder, state, {"faces": sizes}, tuple(f"{name}.landmarks" for name in faces))


def read_creases(folder: Path) -> dict[str, Creases]:
    """Reads a model folder of `write_creases`."""
    config, state = read_model(folder)
    arrays = {key: value.numpy().astype(np.float64) for key, value in state.items()}
    names = [face["name"] for face in config["faces"]]
    return {n: Creases(*(arrays[f"{n}.{field.name}"] for field in fields(Creases))) for n in names}


def unseen(rng: np.random.Generator, data: Path) -> list[tuple[str, Face]]:
    """Faces on which no crease was measured, each with the name of its reference."""
    ict, makehuman = load_ict(data), load_makehuman(data)
    people = [("ict", ict.person(rng.standard_normal(100))) for _ in range(2)]
    warps = [remesh(rng, stylise(rng, makehuman, 0.5), 6000) for _ in range(2)]
    return [*people, *(("makehuman", warp) for warp in warps)]


def turned(face: PreparedMesh, moved: np.ndarray, truth: np.ndarray, where: np.ndarray) -> float:
    """Least-squares slope of the predicted over the true change of normals at `where` [V], in one frame."""
    rest = face.geometry.positions.numpy().astype(np.float64)
    predicted, true = (
        vertex_normals(rest + d, face.triangles) - vertex_normals(rest, face.triangles)
        for d in (moved, truth)
    )
    return float((predicted * true)[where].sum() / (true[where] ** 2).sum())


def print_scores(
    rng: np.random.Generator, faces: dict[str, Creases], data: Path, model: StaticWeights
) -> None:
    """Prints errors with and without creases on two identities of ICT and two warps of MakeHuman."""
    spoken = evaluation_frames(rng, load_speech(data).test, 60)
    emotions = shape_weights()
    shown = [list(PROTOTYPES).index(e) for e in BASIC]
    for kind, face in unseen(rng, data):
        mesh, creases = prepare(face), faces[kind]
        rest = mesh.geometry.positions.numpy().astype(np.float64)
        marks = mesh.geometry.landmarks.numpy().astype(np.float64)
        cross = creases.transferred(rest, mesh.triangles, marks)
        between = np.linalg.norm(rest - marks[[21, 22]].mean(0), axis=1) < 0.2
        centres = [marks[list(c)].mean(0) for c in ((36, 48, 31), (45, 54, 35))]
        cheeks = np.min([np.linalg.norm(rest - c, axis=1) for c in centres], axis=0) < 0.25
        for name, weights in (("speech and upper face", spoken), ("emotions", emotions)):
            truth = np.tensordot(weights, mesh.modes.numpy(), 1)
            motion = torch.from_numpy(truth[:, mesh.landmarks]).float()
            with torch.no_grad():
                plain = deform(model, mesh.geometry, motion, 1.0).numpy()
            added = np.einsum(
                "vxk,kc,tc->tvx", cross, creases.motion, motion.flatten(1).numpy(), optimize=True
            )
            for label, moved in (("without", plain), ("with", plain + added)):
                error = 100.0 * np.linalg.norm(moved - truth, axis=2)
                moving = error[np.linalg.norm(truth, axis=2) > 5e-3].mean()
                line = f"{mesh.name:10} {name:22} {label:8} mean {error.mean():.3f} moving {moving:.3f} mm"
                if name == "emotions":
                    slopes = [
                        np.mean([turned(mesh, moved[e], truth[e], where) for e in kinds])
                        for where, kinds in ((between, shown[1:]), (cheeks, shown))
                    ]
                    line += f" normals: brows {slopes[0]:.2f}, cheeks {slopes[1]:.2f} of the true turn"
                print(line, flush=True)


def main(
    data: Path = DATA,
    models: Annotated[Path | None, "folder of models; none: the embedded ones"] = None,
    score: Annotated[bool, "only measure, on faces that the creases do not come from"] = False,
) -> None:
    """Entry of the command."""
    torch.set_num_threads(1)
    model, folder = read_static(models), models / "creases" if models else shipped("creases")
    if score:
        print_scores(np.random.default_rng(2026), read_creases(folder), data, model)
        return
    weights = frames(np.random.default_rng(0), data)
    faces = {
        name: measure(np.random.default_rng(0), prepare(face), model, weights, POINTS[name])
        for name, face in references(data).items()
    }
    write_creases(folder, faces)


if __name__ == "__main__":
    run_command(main)
