"""Trains the learned part of Sparse-To-Mesh.

    python -m training.systems.freetalk.stm.train static --data ../shared/data --runs runs/stm
    python -m training.systems.freetalk.stm.train paper  --data ../shared/data --runs runs/stm --faces both
    python -m training.systems.freetalk.stm.train paper  --corpus DIR [DIR ...] --config paper --steps 20000

With `--corpus` a decoder trains on vertex sequences of corpus folders and is measured on their held-out
clips. It is written to `RUNS/{static,paper}_corpus.pt`, and training resumes from `RUNS/MODEL_corpus/last.pt`
bit for bit. `--config` sets its size: `paper` is that of the paper (width 128, position and normal).

With `--data` each command trains three times: on both faces (shipped), on ICT alone and on MakeHuman
alone (for the leave-one-face-out errors). It is seeded and uses one thread by default. It writes
`RUNS/{static,paper}_{both,ict,makehuman}.pt`. `training.systems.freetalk.stm.evaluate` prints their
errors and `training.export stm` writes the shipped one.
"""

import argparse
import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import torch

from training.corpus.expressions import load_speech, training_frames
from training.corpus.prepared import COUNTS, Counts, PreparedMesh, landmark_shapes, load_or_build
from training.corpus.sequence_meshes import SequenceMesh, held_out_errors, neutral_shapes, sequence_meshes
from training.deform.static_weights import (
    CONFIGS,
    FLIP,
    MIRROR,
    StaticConfig,
    StaticWeights,
    VertexGeometry,
    deform,
)
from training.machine import Machine, add_arguments
from training.nn.checkpoint import load_model, save
from training.run import Run
from training.systems.freetalk import recipes
from training.systems.freetalk.stm.paper import CONFIGS as PAPER
from training.systems.freetalk.stm.paper import PaperConfig, PaperDecoder
from training.systems.freetalk.stm.train_paper import (
    FRAMES,
    LOG_EVERY,
    moved,
    paper_mesh,
    predict,
    train_paper,
)

STEPS = 5000
"""Number of training steps of the static decoder."""
PAPER_STEPS = 36_000
"""Number of training steps of the paper's decoder. Each takes 0.17 s on one core."""
SAVE_EVERY = 500
JUDGED_FRAMES = 10
"""Every row of the log measures errors on this many frames of each held-out clip."""
COARSE = Counts(60, 40, (1600, 3600))
"""Numbers and sizes of meshes for the paper's decoder. They are coarse because the cost of a step grows in
proportion to the vertices.
"""
MAX_VERTICES = 2200
SHAPES = 1500
"""Number of neutral faces of each kind that show the model which faces are familiar."""

FACES = {"both": ("ict", "makehuman"), "ict": ("ict",), "makehuman": ("makehuman",)}


def sample(rng: np.random.Generator, mesh: PreparedMesh, speech: np.ndarray, frames: int):
    """Draws vertices of a mesh, more at the lips, and frames. Mirrors them half of the time.

    Returns the vertices' geometry, landmark displacements [T, N, 3] and true displacements
    [T, P, 3], decimetres.
    """
    vertices, lips = len(mesh.lips), mesh.lips.nonzero()[:, 0]
    pick = torch.cat(
        [torch.randint(vertices, (500,)), lips[torch.randint(len(lips), (150,))], mesh.landmarks]
    )
    g = mesh.geometry
    if isinstance(mesh, SequenceMesh):
        motion = mesh.anywhere(rng, frames, pick)
    else:
        weights = torch.from_numpy(training_frames(rng, speech, frames)).float()
        motion = torch.einsum("tm,mvx->tvx", weights, mesh.modes[:, pick])
    motion = restyle(motion, g.positions[pick], strength=0.15)
    geometry = VertexGeometry(g.positions[pick], g.landmarks, g.base[pick], g.remoteness[pick])
    landmarks = motion[:, -len(mesh.landmarks) :]
    if rng.random() < 0.5:
        return geometry.mirrored(), landmarks[:, MIRROR] * FLIP, motion * FLIP
    return geometry, landmarks, motion


def restyle(motion: torch.Tensor, positions: torch.Tensor, strength: float) -> torch.Tensor:
    """Multiplies motion by a smooth random field of matrices near one, a new field in each frame.

    Real faces differ in how they move; those of the corpus do not. The field keeps the network from learning
    one face's habits as a rule. motion: [T, P, 3]; positions: [P, 3] dm.
    """
    bumps = 6
    centres = positions[torch.randint(len(positions), (bumps,))] + 0.1 * torch.randn(bumps, 3)
    width = torch.empty(bumps).uniform_(0.2, 0.6)
    amount = torch.exp(-0.5 * (torch.cdist(positions, centres) / width) ** 2)
    field = torch.einsum("pk,tkij->tpij", amount, strength * torch.randn(len(motion), bumps, 3, 3))
    return motion + torch.einsum("tpij,tpj->tpi", field, motion)


def train_static(
    config: StaticConfig,
    meshes: dict[str, list[PreparedMesh]],
    speech: np.ndarray | None,
    steps: int,
    seed: int,
    out: Path,
    machine: Machine | None = None,
) -> StaticWeights:
    """Minimises the mean distance to the true positions, with the correction at full strength.

    `meshes` has a list for each face. `speech` holds weights of their modes; it is None for meshes with their
    own sequences.
    """
    machine = machine or Machine("cpu")
    torch.manual_seed(seed)
    rng = np.random.default_rng(machine.seed(seed))
    model, faces = StaticWeights(config), tuple(meshes)
    rows = torch.cat([m.geometry.features()[::7] for f in faces for m in meshes[f]])
    model.feature_mean.copy_(rows.mean(0))
    model.feature_scale.copy_(rows.std(0) + 1e-3)
    machine.place(model, seed)
    optimiser = torch.optim.AdamW(model.parameters(), lr=2e-3, weight_decay=1e-2)
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimiser, 2e-3, steps, pct_start=0.1)
    parts = {"model": model, "optimiser": optimiser, "schedule": schedule}
    run = Run(out, parts, steps, SAVE_EVERY, {"draws": rng}, machine)
    for step in range(run.first, steps):
        loss = torch.zeros((), device=machine.device)
        for face in faces * (2 // len(faces)):
            mesh = meshes[face][rng.integers(len(meshes[face]))]
            geometry, *motion = sample(rng, mesh, speech, frames=12)
            geometry, (landmarks, truth) = geometry.to(machine.device), (m.to(machine.device) for m in motion)
            base = torch.einsum("vn,tnx->tvx", geometry.base, landmarks)
            with machine.autocast():
                correction = model.one_sided_correction(geometry, landmarks).float()
            error = base + correction - truth
            loss = loss + (100.0 * error.square().sum(-1) + 1e-4).sqrt().mean()
        machine.step(loss, model, optimiser, math.inf)
        schedule.step()
        run.after(step, loss.item())
    return model.cpu()


def learn_shapes(model: StaticWeights, faces: tuple[str, ...], data: Path, seed: int) -> None:
    """Shows the model the landmarks of many neutral faces. A single face fills all kinds of the model."""
    rng = np.random.default_rng(seed)
    for kind in range(model.config.kinds):
        shapes = landmark_shapes(rng, data, faces[kind % len(faces)], SHAPES)
        model.learn_shapes(kind, torch.from_numpy(shapes).float())


def train_on_data(args) -> None:
    """Trains on both faces of the project and on each alone."""
    counts, cache = (COUNTS, "corpus.pkl") if args.model == "static" else (COARSE, "coarse.pkl")
    corpus = load_or_build(args.data, args.runs / cache, counts)
    speech = load_speech(args.data).train
    for name in args.faces:
        faces, out = FACES[name], args.runs / f"{args.model}_{name}"
        if args.model == "static":
            meshes = {f: corpus.train[f] for f in faces}
            config = CONFIGS[args.config or "static"]
            steps = args.steps or STEPS
            model = train_static(config, meshes, speech, steps, args.seed, out, machine_of(args))
            learn_shapes(model, faces, args.data, args.seed)
        else:
            config = PAPER[args.config or "compact"]
            coarse = {f: [m for m in corpus.train[f] if len(m.lips) <= MAX_VERTICES] for f in faces}
            prepared = {f: [paper_mesh(m, config) for m in coarse[f]] for f in coarse}
            steps, log = args.steps or PAPER_STEPS, {"log_every": args.log_every}
            log["start"] = start_of(args)
            model = train_paper(config, speech, steps, args.seed, prepared, out, *how(args), **log)
        save(args.runs / f"{args.model}_{name}.pt", model)


def machine_of(args) -> Machine:
    """The machine to train on."""
    return Machine(args.device, args.precision)


def how(args) -> tuple[recipes.Recipe, Machine]:
    """Recipe and machine for the paper's decoder."""
    return recipes.chosen(recipes.STM, args), machine_of(args)


def start_of(args) -> PaperDecoder | None:
    """The paper's decoder of `--start`, if there is one."""
    make = lambda config: PaperDecoder(PaperConfig(**config))  # noqa: E731
    return None if args.start is None else load_model(args.start, make)


def judge_on(args, config: PaperConfig) -> Callable[[PaperDecoder], dict[str, float]]:
    """Returns a function that measures a decoder on held-out clips, in mm, on the training device."""
    device = machine_of(args).device
    meshes = sequence_meshes(args.corpus, held_out=True)
    prepared = {mesh.name: moved(paper_mesh(mesh, config), device) for mesh in meshes}

    def judge(model: PaperDecoder) -> dict[str, float]:
        def method(mesh: SequenceMesh, landmarks: torch.Tensor) -> torch.Tensor:
            return predict(model, prepared[mesh.name], landmarks.to(device)).cpu()

        return dict(zip(("mean mm", "lips mm"), held_out_errors(method, meshes, JUDGED_FRAMES), strict=True))

    return judge if meshes else lambda _: {}


def paper_steps(args, meshes: list[SequenceMesh]) -> int:
    """Number of steps on corpora: `--steps`, else the recipe's epochs, else `PAPER_STEPS`."""
    recipe = recipes.STM[args.recipe]
    if args.steps is not None or recipe.epochs is None:
        return args.steps or PAPER_STEPS
    return recipe.steps(sum(len(sequence) for mesh in meshes for sequence in mesh.sequences) // FRAMES)


def train_on_corpora(args) -> Path:
    """Trains on vertex sequences of corpus folders; prints the errors on held-out clips."""
    meshes = sequence_meshes(args.corpus, held_out=False)
    out, path = args.runs / f"{args.model}_corpus", args.runs / f"{args.model}_corpus.pt"
    if args.model == "static":
        config = CONFIGS[args.config or "static"]
        steps = args.steps or STEPS
        model = train_static(config, {"corpus": meshes}, None, steps, args.seed, out, machine_of(args))
        rng = np.random.default_rng(args.seed)
        for kind in range(config.kinds):
            shapes = neutral_shapes(rng, meshes, args.shapes)
            model.learn_shapes(kind, torch.from_numpy(shapes).float())
        method = lambda mesh, landmarks: deform(model, mesh.geometry, landmarks, 1.0)  # noqa: E731
    else:
        config = PAPER[args.config or "compact"]
        prepared = {"corpus": [paper_mesh(mesh, config) for mesh in meshes]}
        steps = paper_steps(args, meshes)
        log = {"log_every": args.log_every, "judge": judge_on(args, config), "start": start_of(args)}
        model = train_paper(config, None, steps, args.seed, prepared, out, *how(args), **log)
        method = lambda mesh, landmarks: predict(model, paper_mesh(mesh, config), landmarks)  # noqa: E731
    save(path, model)
    held_out = sequence_meshes(args.corpus, held_out=True)
    free = lambda mesh, landmarks: torch.einsum("vn,tnx->tvx", mesh.geometry.base, landmarks)  # noqa: E731
    for name, of in ((args.model, method), ("training-free", free)) if held_out else ():
        mean, lips = held_out_errors(of, held_out)
        print(f"held out, {name}: {mean:.3f} mm in the mean, {lips:.3f} mm at the lips", flush=True)
    return path


def parser() -> argparse.ArgumentParser:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("model", choices=["static", "paper"])
    parser.add_argument("--corpus", type=Path, nargs="*", default=[], help="corpus folders")
    parser.add_argument("--data", type=Path, default=Path("../shared/data"))
    parser.add_argument("--runs", type=Path, default=Path("runs/stm"))
    parser.add_argument("--faces", nargs="*", choices=list(FACES), default=list(FACES))
    parser.add_argument("--config", choices=sorted({*CONFIGS, *PAPER}), help="size: see the model's CONFIGS")
    parser.add_argument("--steps", type=int, help=f"{STEPS} for static, {PAPER_STEPS} for paper")
    parser.add_argument(
        "--shapes", type=int, default=SHAPES, help="neutral faces of each kind that define a familiar face"
    )
    logs = f"steps between rows of log.csv, paper's decoder only: {LOG_EVERY}"
    parser.add_argument("--log-every", type=int, default=LOG_EVERY, help=logs)
    parser.add_argument("--start", type=Path, help="model folder of the paper's decoder to go on from")
    recipes.add_arguments(parser)
    add_arguments(parser, "float32")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--threads", type=int, default=1)
    return parser


def main(arguments: list[str] | None = None) -> None:
    """Entry of the command."""
    args = parser().parse_args(arguments)
    sizes = CONFIGS if args.model == "static" else PAPER
    if args.config is not None and args.config not in sizes:
        parser().error(f"--config: expected {', '.join(sizes)} for {args.model}, got {args.config}")
    torch.set_num_threads(args.threads)
    args.runs.mkdir(parents=True, exist_ok=True)
    if args.corpus:
        train_on_corpora(args)
    else:
        train_on_data(args)


if __name__ == "__main__":
    main()
