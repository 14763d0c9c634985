"""Measures the finder as shipped: errors of `anyface landmarks` on heads it was never trained on.

    cargo build --release && python -m training.landmarks.evaluate --data ../shared/data \
        --anyface target/release/anyface

ICT heads are held-out identities (from their own random stream) in random triangulations, either plain
or with held-out warps, tears and dress. MakeHuman has warps of its own. Each head is turned at random,
scaled and moved. The command also prints how many things without a face are refused. Errors are
millimetres on a head of human size.
"""

import json
import subprocess
import tempfile
from pathlib import Path
from typing import Annotated, Literal

import numpy as np

from training import DATA
from training.corpus.topology import write_obj
from training.flags import run_command
from training.landmarks import faceless, pool, pose_pool, samples
from training.landmarks.stylise import limb


def find(anyface: list, folder: Path, points: np.ndarray, triangles: np.ndarray) -> np.ndarray | None:
    """Landmarks `[68, 3]` found by the command `anyface` (with its first arguments). None if it refuses."""
    write_obj(folder / "m.obj", points, triangles)
    run = subprocess.run(
        [*anyface, "landmarks", "--mesh", folder / "m.obj", "--out", folder / "l.json"],
        capture_output=True,
        text=True,
        check=False,
    )
    if run.returncode == 6:
        return None
    if run.returncode:
        raise RuntimeError(run.stderr)
    landmarks = json.loads((folder / "l.json").read_text())["landmarks"]
    return np.array([e["position"] for e in landmarks])


def placed(rng: np.random.Generator, head: samples.Head) -> tuple[samples.Head, float]:
    """Turns a head at random, scales it and moves it. Returns it and its scale."""
    turn = pose_pool.any_rotation(rng)
    scale, offset = float(np.exp(rng.uniform(-3, 5))), rng.normal(0, 1, 3)

    def move(points: np.ndarray) -> np.ndarray:
        return (points @ turn.T + offset) * scale

    return samples.Head(move(head.points), head.triangles, move(head.landmarks)), scale


def head_of(
    kind: str, rng: np.random.Generator, faces: samples.Faces, held_out: np.ndarray, number: int, plain: bool
) -> samples.Head:
    """A head in a random triangulation. Unless `plain`, also warped, torn and dressed as in training."""
    if kind == "ict":
        head = faces.ict_head(rng, held_out[number])
    else:
        head = faces.makehuman_head(rng)
    if not plain:
        head = samples.tear(rng, samples.warp(rng, head, 1.0))
    most = len(head.triangles)
    head = samples.remesh(rng, head, target=np.exp(rng.uniform(np.log(1500), np.log(0.9 * most))))
    return head if plain else samples.dress(rng, head)


def report(name: str, errors: list[np.ndarray], missed: int) -> None:
    """Prints one line: errors of all landmarks, of the inner face, of the lips and of the jaw."""
    if not errors:
        print(f"{name}: none found, {missed} missed")
        return
    e = np.array(errors)
    parts = [("all", e), ("inside", e[:, 17:]), ("lips", e[:, 48:]), ("jaw", e[:, :17])]
    text = ", ".join(f"{n} {np.median(p):.2f}/{np.percentile(p, 95):.2f}" for n, p in parts)
    print(f"{name}: {len(e)} found, {missed} missed; median/95th mm: {text}", flush=True)


def nothing(rng: np.random.Generator, faces: samples.Faces, held_out: np.ndarray, number: int):
    """A mesh without a face: warped blobs, a hand-like star of limbs, or a head without its front."""
    if number % 3 == 0:
        head = faceless.blobs(rng)
        return head.points, head.triangles
    if number % 3 == 1:
        palm = samples.ellipsoid([0, 0, 0], [0.045, 0.05, 0.015], 14)
        spread = np.radians(rng.uniform(8, 16))
        tips = [(0.1 * np.sin(a), 0.1 * np.cos(a), 0) for a in spread * np.arange(-1.5, 2)] + [
            (-0.08, 0.02, 0.02)
        ]
        parts = [palm] + [limb(rng, [0.3 * t for t in tip], tip, 0.009) for tip in tips]
        parts.append(limb(rng, [0, -0.03, 0], [0, -0.2, 0], 0.028))
        star = faceless.joined(parts)
        return star.points, star.triangles
    head = faces.ict_head(rng, held_out[number])
    middle = head.points[head.triangles].mean(1)
    return head.points, head.triangles[middle[:, 2] < head.landmarks[36:48, 2].mean() - 0.03]


def main(
    data: Path = DATA,
    anyface: Path = Path("target/release/anyface"),
    weights: Annotated[Path | None, "a folder of models instead of the built-in ones"] = None,
    count: int = 40,
    only: Literal["ict", "makehuman", "nothing", None] = None,
) -> None:
    """Entry of the command."""
    faces, held_out = samples.Faces(data), pool.identities(held_out=True)
    command = command_of(anyface, weights)
    with tempfile.TemporaryDirectory() as name:
        for kind in ("ict", "makehuman"):
            if only in (None, kind):
                measure(kind, command, Path(name), faces, held_out, count)
        if only in (None, "nothing"):
            refuse(command, Path(name), faces, held_out, count // 2)


def command_of(anyface: Path, weights: Path | None) -> list:
    """The command with the chosen models."""
    return [anyface, "--weights", weights] if weights else [anyface]


def measure(kind: str, anyface: list, folder: Path, faces, held_out: np.ndarray, count: int) -> None:
    """Prints the errors of one face model, plain and warped."""
    for plain in (True, False):
        errors, missed = [], 0
        for number in range(count if kind == "ict" else count // 2):
            rng = np.random.default_rng([77, number, plain])
            head, scale = placed(rng, head_of(kind, rng, faces, held_out, number, plain))
            landmarks = find(anyface, folder, head.points, head.triangles)
            if landmarks is None:
                missed += 1
            else:
                errors.append(np.linalg.norm(landmarks - head.landmarks, axis=1) / scale * 1e3)
        report(f"{kind}, {'remeshed' if plain else 'warped, torn, remeshed, dressed'}", errors, missed)


def refuse(anyface: list, folder: Path, faces, held_out: np.ndarray, count: int) -> None:
    """Prints how many randomly turned meshes without a face are refused."""
    refused = 0
    for number in range(count):
        rng = np.random.default_rng([78, number])
        points, triangles = nothing(rng, faces, held_out, number)
        landmarks = find(anyface, folder, points @ pose_pool.any_rotation(rng).T, triangles)
        refused += landmarks is None
        if landmarks is not None:
            print(f"number {number} is no face and was taken for one", flush=True)
    print(f"without a face: {refused} of {count} refused")


if __name__ == "__main__":
    run_command(main)
