"""Prints the errors of Sparse-To-Mesh on faces it did not see.

    python -m training.systems.freetalk.stm.evaluate --data ../shared/data --runs runs/stm
    python -m training.systems.freetalk.stm.evaluate --corpus DIR [DIR ...] --runs runs/stm

It measures baselines, the shipped decoders, and those that `training.systems.freetalk.stm.train` left in
`--runs`. With `--corpus`, it measures on the held-out clips of corpus folders with vertex sequences and
reads `RUNS/{static,paper}_corpus.pt`. Otherwise it measures on a held-out take of facegood_zh plus upper-face
motion, on test identities, warps and triangulations of ICT and on the MakeHuman head, both original and
remeshed, and reads `RUNS/{static,paper}_{both,ict,makehuman}.pt`. Errors are mean distances in millimetres
over all vertices / over the lips (within 1 cm of a lip landmark). All frames and meshes have equal weight.
"""

import argparse
from collections.abc import Callable
from pathlib import Path

import numpy as np
import torch
from scipy.interpolate import RBFInterpolator

from training import shipped
from training.corpus.expressions import UPPER, evaluation_frames, load_speech
from training.corpus.faces import CHANNELS
from training.corpus.prepared import COUNTS, Corpus, PreparedMesh, load_or_build
from training.corpus.sequence_meshes import held_out_errors, sequence_meshes
from training.deform.static_weights import StaticConfig, StaticWeights, deform
from training.nn.checkpoint import load_model, restored
from training.systems.freetalk.stm.local_start import GROUPS, effective_landmarks, group_shares
from training.systems.freetalk.stm.paper import PaperConfig, PaperDecoder
from training.systems.freetalk.stm.train_paper import PaperMesh, paper_mesh, predict

LIDS_WITHIN_DM = 0.1
"""A vertex counts as lid if it is nearer than this (dm) to an eye landmark."""

Method = Callable[[PreparedMesh, torch.Tensor], torch.Tensor]


def errors(
    method: Method, meshes: list[PreparedMesh], speech: np.ndarray, upper: bool
) -> tuple[float, float]:
    """Mean and lip error in mm of a method that takes a mesh and landmark motion [T, N, 3] dm.

    upper: whether brows, lids and nose move besides the mouth.
    """
    rng = np.random.default_rng(9)
    mean, lips = [], []
    for mesh in meshes:
        frames = evaluation_frames(rng, speech, 50)
        frames[:, UPPER] *= float(upper)
        weights = torch.from_numpy(frames).float()
        truth = torch.einsum("tm,mvx->tvx", weights, mesh.modes)
        error = 100.0 * (method(mesh, truth[:, mesh.landmarks]) - truth).norm(dim=-1)
        mean.append(error.mean().item())
        lips.append(error[:, mesh.lips].mean().item())
    return float(np.mean(mean)), float(np.mean(lips))


def lid_error(method: Method, meshes: list[PreparedMesh]) -> float:
    """Mean error in mm within `LIDS_WITHIN_DM` of an eye landmark, both eyes fully closed."""
    closed = [CHANNELS.index("eyeBlinkLeft"), CHANNELS.index("eyeBlinkRight")]
    mesh_errors = []
    for mesh in meshes:
        truth = mesh.modes[closed].sum(0)[None]
        error = 100.0 * (method(mesh, truth[:, mesh.landmarks]) - truth).norm(dim=-1)[0]
        distance = torch.cdist(mesh.geometry.positions, mesh.geometry.landmarks[36:48])
        mesh_errors.append(error[distance.min(1).values < LIDS_WITHIN_DM].mean().item())
    return float(np.mean(mesh_errors))


def no_motion(mesh: PreparedMesh, landmarks: torch.Tensor) -> torch.Tensor:
    """Baseline: nothing moves."""
    return torch.zeros(len(landmarks), len(mesh.lips), 3)


def static_model(path: Path) -> StaticWeights:
    """The static decoder of a file that training wrote."""
    saved = torch.load(path)
    return restored(StaticWeights(StaticConfig(**saved["config"])), saved["state"])


def shipped_static() -> StaticWeights:
    """The static decoder of the repository."""
    return load_model(shipped("static_weights"), lambda config: StaticWeights(StaticConfig(**config)))


def static(model: StaticWeights, familiarity: float | None = None) -> Method:
    """The static decoder. `familiarity`, if given, replaces that of each face."""

    def method(mesh: PreparedMesh, landmarks: torch.Tensor) -> torch.Tensor:
        usual = model.familiarity(mesh.geometry.landmarks)
        learned = 1.0 if familiarity is None else familiarity / usual
        return deform(model, mesh.geometry, landmarks, learned)

    return method


def training_free(mesh: PreparedMesh, landmarks: torch.Tensor) -> torch.Tensor:
    """The tension-screened biharmonic weights alone."""
    return torch.einsum("vn,tnx->tvx", mesh.geometry.base, landmarks)


def paper_model(path: Path) -> PaperDecoder:
    """The paper's decoder of a file that training wrote."""
    saved = torch.load(path)
    return restored(PaperDecoder(PaperConfig(**saved["config"])), saved["state"])


def shipped_paper() -> PaperDecoder:
    """The paper's decoder of the repository."""
    return load_model(shipped("stm_paper"), lambda config: PaperDecoder(PaperConfig(**config)))


def paper(model: PaperDecoder) -> Method:
    """The paper's decoder. Operators are computed once per mesh."""
    prepared: dict[int, PaperMesh] = {}

    def method(mesh: PreparedMesh, landmarks: torch.Tensor) -> torch.Tensor:
        if id(mesh) not in prepared:
            prepared[id(mesh)] = paper_mesh(mesh, model.config)
        parts = [predict(model, prepared[id(mesh)], part) for part in landmarks.split(5)]
        return torch.cat(parts)

    return method


def attention_line(model: PaperDecoder, meshes: list[PreparedMesh], landmarks: Callable) -> str:
    """Says how many landmarks the paper's decoder attends to, and to which parts the vertices of the lips do.

    `landmarks(mesh)`: motion [T, N, 3] dm.
    """
    landmark_counts, of_lips = [], []
    for mesh in meshes:
        prepared, motion = paper_mesh(mesh, model.config), landmarks(mesh)
        face = (prepared.inputs, prepared.operators)
        landmark_counts.append(effective_landmarks(model, *face, motion).flatten())
        of_lips.append({k: v[mesh.lips].mean() for k, v in group_shares(model, *face, motion[:1]).items()})
    counts = torch.cat(landmark_counts).quantile(torch.tensor([0.1, 0.5, 0.9]))
    means = {name: float(np.mean([shares[name] for shares in of_lips])) for name in GROUPS}
    return (
        "landmarks that a vertex attends to, of 68 (deciles 1, 5, 9): "
        + ", ".join(f"{c:.1f}" for c in counts)
        + "; attention of the lips' vertices: "
        + ", ".join(f"{100 * share:.0f} % {name}" for name, share in means.items())
    )


def rbf_linear(mesh: PreparedMesh, landmarks: torch.Tensor) -> torch.Tensor:
    """Radial basis functions |x| through the landmarks, with a constant (scipy's RBFInterpolator)."""
    at, places = mesh.geometry.landmarks.numpy(), mesh.geometry.positions.numpy()
    unit = RBFInterpolator(at, np.eye(len(at)), kernel="linear")(places)
    return torch.einsum("vn,tnx->tvx", torch.from_numpy(unit).float(), landmarks)


def corpus_rows(runs: Path) -> list[tuple[str, Method]]:
    """Baselines, the shipped decoders, and decoders trained on corpus folders."""
    table = [("no motion", no_motion), ("RBF, linear kernel", rbf_linear)]
    table += [("training-free (TSB)", training_free), ("static, shipped", static(shipped_static()))]
    table.append(("paper, shipped", paper(shipped_paper())))
    for name, read in (("static", lambda path: static(static_model(path))),
                       ("paper", lambda path: paper(paper_model(path)))):  # fmt: skip
        path = runs / f"{name}_corpus.pt"
        if path.exists():
            table.append((f"{name}, trained on sequences", read(path)))
    return table


def print_corpus_table(folders: list[Path], runs: Path, frames: int) -> None:
    """Prints one line per method: errors in mm, mean and lips, on held-out clips."""
    meshes = sequence_meshes(folders, held_out=True)
    print(f"{len(meshes)} held-out faces, {frames} frames of each clip; mm: mean / lips")
    with torch.no_grad():
        for name, method in corpus_rows(runs):
            mean, lips = held_out_errors(method, meshes, frames)
            print(f"{name:40}{mean:8.3f} /{lips:6.3f}", flush=True)
        motion = lambda mesh: mesh.displacements(0, [len(mesh.sequences[0]) // 2])[:, mesh.landmarks]  # noqa: E731
        print("paper, shipped:", attention_line(shipped_paper(), meshes, motion), flush=True)


def rows(runs: Path) -> list[tuple[str, Method]]:
    """Baselines, the shipped decoders, and every decoder in `runs`."""
    table = [("no motion", no_motion), ("training-free (TSB)", training_free)]
    table += [("static, shipped", static(shipped_static())), ("paper, shipped", paper(shipped_paper()))]
    for faces in ("both", "ict", "makehuman"):
        path = runs / f"static_{faces}.pt"
        if path.exists():
            model = static_model(path)
            table.append((f"static, trained on {faces}", static(model)))
            table.append((f"static, trained on {faces}, f = 1", static(model, 1.0)))
    for faces in ("both", "ict", "makehuman"):
        path = runs / f"paper_{faces}.pt"
        if path.exists():
            table.append((f"paper, trained on {faces}", paper(paper_model(path))))
    return table


def print_table(corpus: Corpus, speech: np.ndarray, runs: Path) -> None:
    """Prints one line per method.

    Columns, each for ICT, then MakeHuman: speech with upper face, speech alone, lids of a blink.
    """
    faces = ("ict", "makehuman")
    heads = "".join(f"{head:>16}" for head in ("ICT unseen", "MakeHuman", "ICT, mouth", "MH, mouth"))
    print(f"{'mm: mean / lips':40}{heads}{'lids: ICT':>10}{'MH':>8}")
    with torch.no_grad():
        for name, method in rows(runs):
            cells = [errors(method, corpus.test[f], speech, u) for u in (True, False) for f in faces]
            text = "".join(f"{mean:8.3f} /{lips:6.3f}" for mean, lips in cells)
            lids = "".join(f"{lid_error(method, corpus.test[f]):9.3f}" for f in faces)
            print(f"{name:40}{text}{lids}", flush=True)
        meshes = [mesh for face in faces for mesh in corpus.test[face]]
        weights = torch.from_numpy(speech[len(speech) // 2 :][:1]).float()
        motion = lambda mesh: torch.einsum("tm,mvx->tvx", weights, mesh.modes[:, mesh.landmarks])  # noqa: E731
        print("paper, shipped:", attention_line(shipped_paper(), meshes, motion), flush=True)


def main() -> None:
    """Entry of the command."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--data", type=Path, default=Path("../shared/data"))
    parser.add_argument("--runs", type=Path, default=Path("runs/stm"))
    parser.add_argument("--corpus", type=Path, nargs="*", default=[], help="corpus folders")
    parser.add_argument("--frames", type=int, default=50, help="frames of each clip of corpus folders")
    args = parser.parse_args()
    torch.set_num_threads(1)
    if args.corpus:
        print_corpus_table(args.corpus, args.runs, args.frames)
        return
    corpus = load_or_build(args.data, args.runs / "corpus.pkl", COUNTS)
    print_table(corpus, load_speech(args.data).test, args.runs)


if __name__ == "__main__":
    main()
