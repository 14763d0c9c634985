"""Prints how far teeth, tongue, lashes and the rest of ICT's parts are from their true motion.

    python -m training.deform.evaluate_parts --data ../shared/data --anyface target/debug/anyface

ICT FaceKit gives every part its own motion for each of its expression modes. The command
`anyface deform` moves the whole head (26,719 vertices) by the true motion of its 68 landmarks, and the
result for each part is compared with the truth. Motion: the held-out take of facegood_zh plus random motion
of the upper face, as in `training.systems.freetalk.stm.evaluate`. Mean distance in millimetres.
"""

import json
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
from safetensors import safe_open

from training import DATA
from training.corpus.expressions import evaluation_frames, load_speech
from training.corpus.faces import CHANNELS, channel_of_ict
from training.corpus.topology import write_obj
from training.engine import Engine
from training.flags import run_command

GAZE = [i for i, c in enumerate(CHANNELS) if c.startswith("eyeLook")]
"""Channels that turn the eyes. They are set to 0: landmarks do not show how an eyeball turns."""
MOVES_CM = 0.5
"""A vertex of gums and tongue belongs to the lower jaw if jawOpen moves it further than this."""
TONGUE_WITHIN_CM = 0.2
"""A soft vertex of the lower jaw counts as tongue if it is further than this from every lower tooth.

It must also lie between the teeth, less than 2 cm from the middle plane.
"""


@dataclass(frozen=True)
class Head:
    """The whole ICT head, centimetres.

    neutral: [V, 3]. triangles: [F, 3]. landmarks: [68]. modes: [51, V, 3]. identity: [100, V, 3].
    regions: vertex numbers by ICT's own names; parts: by the names in the table.
    """

    neutral: np.ndarray
    triangles: np.ndarray
    landmarks: np.ndarray
    modes: np.ndarray
    identity: np.ndarray
    regions: dict[str, np.ndarray]
    parts: dict[str, np.ndarray]


def load_head(data: Path) -> Head:
    """Loads the head with its parts by name."""
    with safe_open(data / "faces/ict_facekit.safetensors", "np") as f:
        metadata = f.metadata()
        names = json.loads(metadata["expression_names"])
        regions = {n: np.arange(a, b + 1) for n, a, b in json.loads(metadata["regions"])}
        neutral = f.get_tensor("neutral").astype(np.float64)
        expression = f.get_tensor("expression").astype(np.float64)
        by_name = dict(zip(names, expression, strict=True))
        modes = np.stack([channel_of_ict(by_name, c) for c in CHANNELS])
        triangles = f.get_tensor("triangles")
        landmarks = f.get_tensor("landmarks68").astype(np.int64)
        identity = f.get_tensor("identity").astype(np.float64)
    parts = named_parts(neutral, modes, regions)
    return Head(neutral, triangles, landmarks, modes, identity, regions, parts)


def named_parts(
    neutral: np.ndarray, modes: np.ndarray, regions: dict[str, np.ndarray]
) -> dict[str, np.ndarray]:
    """Vertex numbers of the parts that the table names. Left and right are taken together."""

    def both(name: str) -> np.ndarray:
        return np.concatenate([regions[f"{name}_left"], regions[f"{name}_right"]])

    soft = regions["gums_and_tongue"]
    opening = np.linalg.norm(modes[CHANNELS.index("jawOpen"), soft], axis=-1)
    lower, upper = soft[opening > MOVES_CM], soft[opening <= MOVES_CM]
    tongue = np.isin(lower, tongue_of(neutral, lower, regions["teeth_lower"]))
    return {
        "face": regions["face"],
        "teeth, lower": regions["teeth_lower"],
        "teeth, upper": regions["teeth_upper"],
        "gums, lower": lower[~tongue],
        "tongue": lower[tongue],
        "gums, upper": upper,
        "lashes": both("eyelashes"),
        "eyeballs": both("eyeball"),
        "tear line": both("lacrimal_fluid"),
        "lid shadow": both("eye_occlusion"),
        "mouth's inside": regions["mouth_socket"],
        "eye sockets": both("eye_socket"),
        "head and neck": regions["head_and_neck"],
    }


def tongue_of(neutral: np.ndarray, lower: np.ndarray, teeth: np.ndarray) -> np.ndarray:
    """The vertices of the lower jaw's soft part that lie within the arch of the teeth."""
    distance = np.linalg.norm(neutral[lower, None] - neutral[None, teeth], axis=-1).min(1)
    inside = np.abs(neutral[lower, 0]) < 2.0
    return lower[(distance > TONGUE_WITHIN_CM) & inside]


def deformed(anyface: Path, head: Head, positions: np.ndarray, motion: np.ndarray) -> np.ndarray:
    """Displacements [T, V, 3] centimetres from `anyface deform` for landmark motion [T, 68, 3]."""
    with tempfile.TemporaryDirectory() as folder:
        mesh = Path(folder) / "head.obj"
        write_obj(mesh, positions, head.triangles)
        return Engine(anyface).spread(motion, positions[head.landmarks], mesh, None).astype(np.float64)


def errors(anyface: Path, head: Head, weights: np.ndarray, people: int) -> dict[str, list[float]]:
    """The mean true motion and mean error of each part, mm, over `people` faces. weights: [T, 51]."""
    rng = np.random.default_rng(11)
    truth = np.einsum("tm,mvx->tvx", weights, head.modes)
    wrong: dict[str, list[float]] = {name: [] for name in head.parts}
    for person in range(people):
        coefficients = rng.standard_normal(100) * float(person > 0)
        positions = head.neutral + np.tensordot(coefficients, head.identity, 1)
        moved = deformed(anyface, head, positions, truth[:, head.landmarks])
        distance = np.linalg.norm(moved - truth, axis=-1)
        for name, vertices in head.parts.items():
            wrong[name].append(10.0 * distance[:, vertices].mean())
    motion = 10.0 * np.linalg.norm(truth, axis=-1)
    return {n: [motion[:, v].mean(), float(np.mean(wrong[n]))] for n, v in head.parts.items()}


def blinks(frames: int) -> np.ndarray:
    """Weights that close both lids and move nothing else. [T, 51]."""
    weights = np.zeros((frames, len(CHANNELS)))
    for side in ("Left", "Right"):
        weights[:, CHANNELS.index(f"eyeBlink{side}")] = np.linspace(0.0, 1.0, frames)
    return weights


def main(
    data: Path = DATA,
    anyface: Path = Path("target/debug/anyface"),
    people: Annotated[int, "ICT's mean face and random identities"] = 3,
    frames: int = 100,
) -> None:
    """Entry of the command."""
    head = load_head(data)
    speech = evaluation_frames(np.random.default_rng(9), load_speech(data).test, frames)
    speech[:, GAZE] = 0.0
    wide = np.zeros((20, len(CHANNELS)))
    wide[:, CHANNELS.index("jawOpen")] = np.linspace(0.05, 1.0, 20)
    sets = {"speech": speech, "blink": blinks(11), "jaw 0–1": wide}
    results = {n: errors(anyface, head, w, people) for n, w in sets.items()}
    print(f"{'mm: moves / error':18}" + "".join(f"{n:>18}" for n in sets))
    for part in head.parts:
        cells = (results[n][part] for n in sets)
        print(f"{part:18}" + "".join(f"{m:9.2f} /{e:7.3f}" for m, e in cells), flush=True)


if __name__ == "__main__":
    run_command(main)
