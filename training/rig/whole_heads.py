"""The command's own shapes on whole ICT heads of unseen identities, all parts, against the truth."""

import json
import subprocess
import tempfile
from pathlib import Path

import numpy as np
from safetensors import safe_open

from training.corpus.faces import CHANNELS, channel_of_ict

PARTS = {
    "face": ["face"],
    "neck and mouth's lining": ["head_and_neck", "mouth_socket"],
    "lower teeth": ["teeth_lower"],
    "gums and tongue": ["gums_and_tongue"],
    "lashes": ["eyelashes_left", "eyelashes_right"],
}
MOVING_CM = 0.05


def heads(data: Path, count: int, seed: int) -> tuple[list[np.ndarray], dict]:
    """Vertices [V, 3] cm of `count` identities, and what all share: triangles, landmarks, modes
    [S, V, 3] cm, and the rows of each part."""
    rng = np.random.default_rng(seed)
    with safe_open(data / "faces/ict_facekit.safetensors", "np") as file:
        metadata = file.metadata()
        names = json.loads(metadata["expression_names"])
        expression = file.get_tensor("expression").astype(np.float64)
        identity, neutral = file.get_tensor("identity"), file.get_tensor("neutral")
        regions = {name: np.arange(a, b + 1) for name, a, b in json.loads(metadata["regions"])}
        shared = {
            "triangles": file.get_tensor("triangles"),
            "landmarks": file.get_tensor("landmarks68"),
            "modes": np.stack([channel_of_ict(expression, names, c) for c in CHANNELS]),
            "parts": {part: np.concatenate([regions[r] for r in rs]) for part, rs in PARTS.items()},
        }
        people = [
            neutral + np.tensordot(rng.standard_normal(100), identity.astype(np.float64), 1)
            for _ in range(count)
        ]
    return people, shared


def made_by(anyface: Path, vertices: np.ndarray, shared: dict) -> np.ndarray:
    """Shapes of the command for one head, the true landmarks given. [S, V, 3] cm."""
    with tempfile.TemporaryDirectory() as folder:
        mesh, marks, rig = (Path(folder) / name for name in ("head.obj", "marks.json", "rig.npz"))
        lines = [f"v {x:.5f} {y:.5f} {z:.5f}" for x, y, z in vertices]
        lines += [f"f {a} {b} {c}" for a, b, c in shared["triangles"] + 1]
        mesh.write_text("\n".join(lines) + "\n")
        marks.write_text(json.dumps(shared["landmarks"].tolist()))
        command = [anyface, "rig", "--mesh", mesh, "--out", rig, "--landmarks", marks, "--no-cache"]
        subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
        with np.load(rig) as made:
            names = made["names"].tolist()
            return made["deltas"][[names.index(c) for c in CHANNELS]].astype(np.float64)


def print_errors(anyface: Path, data: Path, count: int = 3, seed: int = 77) -> None:
    """Mean over identities of each part's error in mm: over shapes and vertices that truly move
    more than 0.5 mm, and the motion there."""
    people, shared = heads(data, count, seed)
    made = [made_by(anyface, person, shared) for person in people]
    for part, rows in shared["parts"].items():
        truth = shared["modes"][:, rows]
        length = np.linalg.norm(truth, axis=-1)
        moving = length > MOVING_CM
        error = np.mean([np.linalg.norm(m[:, rows] - truth, axis=-1) for m in made], axis=0)
        by_shape = [10.0 * e[m].mean() for e, m in zip(error, moving, strict=True) if m.any()]
        motion = [10.0 * e[m].mean() for e, m in zip(length, moving, strict=True) if m.any()]
        print(
            f"whole ICT heads, {part}: {np.mean(by_shape):.3f} mm of {np.mean(motion):.2f} mm "
            f"over the {len(by_shape)} shapes that move it"
        )
