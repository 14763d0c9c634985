"""Compares the command's own shapes with the truth on whole ICT heads of unseen identities, all parts."""

import json
import tempfile
from pathlib import Path

import numpy as np

from training.corpus.faces import CHANNELS
from training.corpus.topology import write_obj
from training.deform.evaluate_parts import Head, load_head
from training.engine import Engine

PARTS = {
    "face": ["face"],
    "neck and mouth's lining": ["head_and_neck", "mouth_socket"],
    "lower teeth": ["teeth_lower"],
    "gums and tongue": ["gums_and_tongue"],
    "lashes": ["eyelashes_left", "eyelashes_right"],
}
MOVING_CM = 0.05


def made_by(anyface: Path, head: Head, vertices: np.ndarray) -> np.ndarray:
    """Shapes that the command makes for one head [V, 3] from its true landmarks. [S, V, 3] cm."""
    with tempfile.TemporaryDirectory() as folder:
        mesh, marks = Path(folder) / "head.obj", Path(folder) / "marks.json"
        write_obj(mesh, vertices, head.triangles)
        marks.write_text(json.dumps(head.landmarks.tolist()))
        rig = Engine(anyface).run("rig", "--mesh", mesh, "--landmarks", marks, "--no-cache")
    names = rig["names"].tolist()
    return rig["deltas"][[names.index(c) for c in CHANNELS]].astype(np.float64)


def print_errors(anyface: Path, data: Path, count: int = 3, seed: int = 77) -> None:
    """Prints each part's error and true motion in mm, the error as a mean over identities.

    Both are means over the shapes and vertices that truly move more than 0.5 mm.
    """
    head, rng = load_head(data), np.random.default_rng(seed)
    people = [head.neutral + np.tensordot(rng.standard_normal(100), head.identity, 1) for _ in range(count)]
    predictions = [made_by(anyface, head, person) for person in people]
    for part, regions in PARTS.items():
        rows = np.concatenate([head.regions[name] for name in regions])
        truth = head.modes[:, rows]
        length = np.linalg.norm(truth, axis=-1)
        moving = length > MOVING_CM
        error = np.mean([np.linalg.norm(m[:, rows] - truth, axis=-1) for m in predictions], axis=0)
        by_shape = [10.0 * e[m].mean() for e, m in zip(error, moving, strict=True) if m.any()]
        motion = [10.0 * e[m].mean() for e, m in zip(length, moving, strict=True) if m.any()]
        print(
            f"whole ICT heads, {part}: {np.mean(by_shape):.3f} mm of {np.mean(motion):.2f} mm "
            f"over the {len(by_shape)} shapes that move it"
        )
