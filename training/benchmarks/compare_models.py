"""Measures how far vertices move differently with another folder of models, for each system.

    python -m training.benchmarks.compare_models --models DIR --anyface target/release/anyface

`DIR` holds models as `anyface animate --weights` reads them, such as models of another precision, or an
earlier version of the repository's folder `weights`. Three clips of speech are put on three heads, once with
these models and once with the built-in ones. Lengths are millimetres on a head of human size.
"""

import json
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np

from training import DATA, REPOSITORY
from training.corpus.ict import IctLandmarks
from training.engine import Engine
from training.flags import run_command

MM = 1000.0
EYE_CORNERS = (36, 45)
"""Outer corners of the eyes. Their distance is the size of a head."""

HEADS = (
    REPOSITORY / "weights/shared/default_head/head.obj",
    "meshes/lee_perry_smith.obj",
    "meshes/makehuman_body.obj",
)
CLIPS = ("clips/jfk.wav", "clips/Claire_neutral.wav", "clips/Mark_anger.wav")
SYSTEMS = {
    "FreeTalk": ("--system", "freetalk"),
    "FreeTalk, the paper's decoder": ("--system", "freetalk", "--decoder", "paper"),
    "Cafe-Talk": ("--system", "cafe-talk"),
    "EmoFace": ("--system", "emoface"),
    "FaceTalk": ("--system", "facetalk"),
}


@dataclass
class Difference:
    """Distances between two motions of the same vertices, and the sizes of the first motion, in mm."""

    largest: float
    mean: float
    largest_motion: float
    mean_motion: float

    @classmethod
    def between(cls, one: np.ndarray, other: np.ndarray, scale: float) -> "Difference":
        """Of displacements [T, V, 3]; `scale` turns the mesh's units into mm.

        Means are over vertices that move by more than a tenth of the largest motion, in all frames.
        """
        motion = scale * np.linalg.norm(one, axis=2)
        apart = scale * np.linalg.norm(other - one, axis=2)
        moving = motion.max(axis=0) > motion.max() / 10
        return cls(apart.max(), apart[:, moving].mean(), motion.max(), motion[:, moving].mean())


def cell(length: float, motion: float) -> str:
    """A length in mm and its share of a motion."""
    return f"{length:.3f} mm ({100 * length / motion:.1f} %)"


def head_scale(landmarks: np.ndarray, neutral: np.ndarray) -> float:
    """Millimetres in one unit of a mesh, from its landmarks [68, 3] and those of a human head in metres."""

    def size(points):
        return np.linalg.norm(points[EYE_CORNERS[0]] - points[EYE_CORNERS[1]])

    return MM * size(neutral) / size(landmarks)


def compare(binary: Path, models: list[str], mesh: Path, clips: list[Path], neutral: np.ndarray) -> dict:
    """The difference of each system on one head, over all clips."""
    with tempfile.TemporaryDirectory() as folder:
        marks = Path(folder) / "landmarks.json"
        Engine(binary).call("landmarks", "--mesh", mesh, "--out", marks)
        points = [landmark["position"] for landmark in json.loads(marks.read_text())["landmarks"]]
        scale = head_scale(np.array(points), neutral)
        differences = {}
        for name, options in SYSTEMS.items():
            job = ("animate", "--mesh", mesh, "--landmarks", marks, *options)
            motions = [
                np.concatenate(
                    [Engine(binary, more).run(*job, "--audio", clip)["displacements"] for clip in clips]
                )
                for more in ([], models)
            ]
            differences[name] = Difference.between(*motions, scale)
        return differences


def main(
    models: Annotated[list[Path], "folders that hold the folders of models"],
    anyface: Annotated[Path, "the command"] = Path("target/release/anyface"),
    data: Path = DATA,
) -> None:
    """Prints a table. Each number is that of the head with the largest one."""
    neutral = IctLandmarks(data).neutral
    clips = [data / clip for clip in CLIPS]
    with tempfile.TemporaryDirectory() as folder:
        for config in (path.resolve() for parent in models for path in parent.glob("*/config.json")):
            (Path(folder) / config.parent.name).symlink_to(config.parent)
        options = ["--weights", folder]
        heads = [compare(anyface.resolve(), options, data / head, clips, neutral) for head in HEADS]
    print("| | largest | mean |\n| --- | --- | --- |")
    for name in SYSTEMS:
        far = max((head[name] for head in heads), key=lambda difference: difference.largest)
        mean = max((head[name] for head in heads), key=lambda difference: difference.mean)
        print(f"| {name} | {cell(far.largest, far.largest_motion)} | {cell(mean.mean, mean.mean_motion)} |")


if __name__ == "__main__":
    run_command(main)
