"""Measures the finder as shipped: errors of `anyface landmarks` on heads it never trained on.

    cargo build --release && python -m training.landmarks.evaluate --data ../shared/data \
        --anyface target/release/anyface

ICT heads are held-out identities (their own random stream) with held-out warps, MakeHuman has
warps of its own; each is turned by up to 15 degrees, scaled and moved. Also prints how many things
without a face are refused. Errors are millimetres on a head of human size.
"""

import argparse
import json
import subprocess
import tempfile
from pathlib import Path

import numpy as np

from training.landmarks import pool, render, samples


def write_obj(path: Path, points: np.ndarray, triangles: np.ndarray) -> None:
    """Plain OBJ."""
    lines = [f"v {x:.7g} {y:.7g} {z:.7g}" for x, y, z in points]
    lines += [f"f {a} {b} {c}" for a, b, c in (triangles + 1).tolist()]
    path.write_text("\n".join(lines) + "\n")


def find(anyface: Path, folder: Path, points: np.ndarray, triangles: np.ndarray) -> np.ndarray | None:
    """`[68, 3]` as the command finds them, or nothing."""
    write_obj(folder / "m.obj", points, triangles)
    run = subprocess.run(
        [anyface, "landmarks", "--mesh", folder / "m.obj", "--out", folder / "l.json"],
        capture_output=True,
        text=True,
        check=False,
    )
    if run.returncode == 6:
        return None
    if run.returncode:
        raise RuntimeError(run.stderr)
    found = json.loads((folder / "l.json").read_text())["landmarks"]
    return np.array([e["position"] for e in found])


def placed(rng: np.random.Generator, head: samples.Head) -> tuple[samples.Head, float]:
    """The head turned a little, in other units, somewhere else; and its scale."""
    turn = pool.rotation(rng, wide=False)
    scale, offset = float(np.exp(rng.uniform(-3, 5))), rng.normal(0, 1, 3)

    def move(points: np.ndarray) -> np.ndarray:
        return (points @ turn.T + offset) * scale

    return samples.Head(move(head.points), head.triangles, move(head.landmarks)), scale


def head_of(
    kind: str, rng: np.random.Generator, faces: samples.Faces, held_out: np.ndarray, number: int, plain: bool
) -> samples.Head:
    """A plain head, or one that is warped, torn, remeshed and dressed like the training's."""
    if kind == "ict":
        head = faces.ict_head(rng, held_out[number])
    else:
        head = faces.makehuman_head(rng)
    if plain:
        return head
    head = samples.warp(rng, head, 1.0)
    if rng.random() < 0.3:
        head = samples.remesh(rng, head)
    return samples.dress(rng, head)


def report(name: str, errors: list[np.ndarray], missed: int) -> None:
    """One line: all landmarks, those inside the face, those of the jaw."""
    if not errors:
        print(f"{name}: none found, {missed} missed")
        return
    e = np.array(errors)
    parts = [("all", e), ("inside", e[:, 17:]), ("lips", e[:, 48:]), ("jaw", e[:, :17])]
    text = ", ".join(f"{n} {np.median(p):.2f}/{np.percentile(p, 95):.2f}" for n, p in parts)
    print(f"{name}: {len(e)} found, {missed} missed; median/95th mm: {text}", flush=True)


def nothing(rng: np.random.Generator, faces: samples.Faces, held_out: np.ndarray, number: int):
    """A mesh without a face towards the stated front: blobs, or a head seen from behind."""
    if number % 2:
        shapes = [
            samples.ellipsoid(rng.normal(0, 0.05, 3), rng.uniform(0.02, 0.12, 3), 14)
            for _ in range(rng.integers(1, 5))
        ]
        triangles = [t + sum(len(p) for p, _ in shapes[:i]) for i, (_, t) in enumerate(shapes)]
        return np.concatenate([p for p, _ in shapes]), np.concatenate(triangles)
    head = faces.ict_head(rng, held_out[number])
    return head.points @ render.yaw(np.radians(180 + rng.normal(0, 15))).T, head.triangles


def main() -> None:
    """Entry of the command."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--data", type=Path, default=Path("../shared/data"))
    parser.add_argument("--anyface", type=Path, default=Path("target/release/anyface"))
    parser.add_argument("--count", type=int, default=40)
    args = parser.parse_args()
    faces, held_out = samples.Faces(args.data), pool.identities(held_out=True)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for kind in ("ict", "makehuman"):
            for plain in (True, False):
                errors, missed = [], 0
                for number in range(args.count if kind == "ict" else args.count // 2):
                    rng = np.random.default_rng([77, number, plain])
                    head, scale = placed(rng, head_of(kind, rng, faces, held_out, number, plain))
                    found = find(args.anyface, folder, head.points, head.triangles)
                    if found is None:
                        missed += 1
                    else:
                        errors.append(np.linalg.norm(found - head.landmarks, axis=1) / scale * 1e3)
                report(f"{kind}, {'plain' if plain else 'warped, remeshed, dressed'}", errors, missed)
        refused = 0
        for number in range(args.count // 2):
            points, triangles = nothing(np.random.default_rng([78, number]), faces, held_out, number)
            refused += find(args.anyface, folder, points, triangles) is None
        print(f"without a face: {refused} of {args.count // 2} refused")


if __name__ == "__main__":
    main()
