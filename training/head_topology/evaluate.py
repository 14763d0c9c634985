"""Measures how far the head of quads lies from ICT heads of the same coefficients that no fit has seen.

python -m training.head_topology.evaluate --data ../shared/data
"""

import json
from pathlib import Path

import numpy as np
from safetensors.numpy import load_file
from scipy.spatial import cKDTree

from training import DATA, shipped
from training.flags import run_command
from training.head_topology.fit import Samples, Target, ears
from training.head_topology.shape import shape
from training.landmarks.canonical import from_ict, to_ict
from training.nn.checkpoint import read_arrays

HEADS = 20


def main(data: Path = DATA, heads: int = HEADS, seed: int = 1) -> None:
    """Entry of the command."""
    ict = load_file(data / "faces/ict_facekit.safetensors")
    target = Target(ict["neutral"].astype(float), ict["triangles"], ict["polygons"], ict["landmarks68"])
    samples, folder = Samples(target), shipped("head_topology")
    config = json.loads((folder / "config.json").read_text())
    state = {name: value.double().numpy() for name, value in read_arrays(folder).items()}
    landmarks, visible = state["landmarks"].astype(int), seen_skin(state, config)
    random, surface, marks = np.random.default_rng(seed), [], []
    for _ in range(heads):
        coefficients = random.normal(size=100)
        predicted = 1e3 * shape(state, config, coefficients, np.zeros(len(config["traits"])))
        whole = target.points + np.tensordot(coefficients, ict["identity"].astype(float), 1)
        true = 1e3 * from_ict(whole)
        surface.append(cKDTree(samples.weights @ true).query(predicted[visible])[0])
        marks.append(np.linalg.norm(predicted[landmarks] - true[target.landmarks], axis=1))
    far, marks = np.concatenate(surface), np.concatenate(marks)
    print(f"{heads} heads, mm: mean, nine of ten")
    for name, values in (("skin of the face", far), ("landmarks", marks)):
        print(f"{name}: {values.mean():.2f}, {np.quantile(values, 0.9):.2f}")


def seen_skin(state: dict[str, np.ndarray], config: dict) -> np.ndarray:
    """Vertices of the face in front of the ears and above the collar, without the linings."""
    kinds = [config["materials"].index(name) for name in ("skin", "lips")]
    faces = state["faces"][: config["skin_faces"]][np.isin(state["materials"][: config["skin_faces"]], kinds)]
    used = np.unique(faces.astype(int))
    places = state["positions"][used]
    on_face = (places[:, 2] > 0.0) & (places[:, 1] > -0.11)
    return used[on_face & ~ears(to_ict(places))]


if __name__ == "__main__":
    run_command(main)
