"""Prints how far teeth, tongue, lashes and the rest of ICT's parts are from their true motion.

    python -m training.deform.evaluate_parts --data ../shared/data --anyface target/debug/anyface

ICT FaceKit gives every part its own motion for each of its expression modes. The command
`anyface deform` moves the whole head (26,719 vertices) by the true motion of its 68 landmarks; what
it does to each part is compared with the truth. Motion: the held-out take of facegood_zh plus upper
face at random, as in `training.systems.freetalk.stm.evaluate`. Mean distance in millimetres.
"""

import argparse
import json
import subprocess
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from safetensors import safe_open

from training.corpus.expressions import evaluation_frames, load_speech
from training.corpus.faces import CHANNELS, channel_of_ict

GAZE = [i for i, c in enumerate(CHANNELS) if c.startswith("eyeLook")]
"""Channels that turn the eyes: landmarks say nothing of an eyeball's turning."""
MOVES_CM = 0.5
"""A vertex of gums and tongue that jawOpen moves further than this belongs to the lower jaw."""
TONGUE_WITHIN_CM = 0.2
"""A vertex of the lower jaw's soft part further from every lower tooth than this, and between them,
counts as tongue."""


@dataclass(frozen=True)
class Head:
    """The whole ICT head, centimetres.

    neutral: [V, 3]. triangles: [F, 3]. landmarks: [68]. modes: [51, V, 3]. identity: [100, V, 3].
    parts: vertex numbers of each named part.
    """

    neutral: np.ndarray
    triangles: np.ndarray
    landmarks: np.ndarray
    modes: np.ndarray
    identity: np.ndarray
    parts: dict[str, np.ndarray]


def load_head(data: Path) -> Head:
    """The head with its parts by name."""
    with safe_open(data / "faces/ict_facekit.safetensors", "np") as f:
        metadata = f.metadata()
        names = json.loads(metadata["expression_names"])
        regions = {n: np.arange(a, b + 1) for n, a, b in json.loads(metadata["regions"])}
        neutral = f.get_tensor("neutral").astype(np.float64)
        expression = f.get_tensor("expression").astype(np.float64)
        modes = np.stack([channel_of_ict(expression, names, c) for c in CHANNELS])
        triangles = f.get_tensor("triangles")
        landmarks = f.get_tensor("landmarks68").astype(np.int64)
        identity = f.get_tensor("identity").astype(np.float64)
    parts = named_parts(neutral, modes, regions)
    return Head(neutral, triangles, landmarks, modes, identity, parts)


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


def write_obj(path: Path, positions: np.ndarray, triangles: np.ndarray) -> None:
    """A mesh without anything but vertices [V, 3] and triangles [F, 3]."""
    lines = [f"v {x:.6f} {y:.6f} {z:.6f}" for x, y, z in positions]
    lines += [f"f {a} {b} {c}" for a, b, c in triangles + 1]
    path.write_text("\n".join(lines) + "\n")


def deformed(anyface: Path, head: Head, positions: np.ndarray, motion: np.ndarray) -> np.ndarray:
    """What `anyface deform` makes of landmark motion [T, 68, 3]: [T, V, 3], centimetres."""
    with tempfile.TemporaryDirectory() as folder:
        mesh, landmarks, out = (Path(folder) / n for n in ("head.obj", "motion.npz", "out.npz"))
        write_obj(mesh, positions, head.triangles)
        np.savez(
            landmarks,
            landmarks_neutral=positions[head.landmarks].astype(np.float32),
            landmark_displacements=motion.astype(np.float32),
        )
        command = [anyface, "deform", "--mesh", mesh, "--motion", landmarks, "--out", out]
        subprocess.run([str(word) for word in command], check=True, stdout=subprocess.DEVNULL)
        with np.load(out) as arrays:
            return arrays["displacements"].astype(np.float64)


def errors(anyface: Path, head: Head, weights: np.ndarray, people: int) -> dict[str, list[float]]:
    """Of each part: how far it truly moves and how far it is from there, mm, over `people` faces.

    weights: [T, 51].
    """
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


SLITS = {
    "lips": ([60, 61, 62, 63, 64], [60, 67, 66, 65, 64]),
    "left lids": ([42, 43, 44, 45], [42, 47, 46, 45]),
    "right lids": ([36, 37, 38, 39], [36, 41, 40, 39]),
}
"""Landmarks of the upper and the lower rim from corner to corner."""
PIECES = 24
RIM_CM = 0.3


def rims(head: Head, upper: list[int], lower: list[int]) -> tuple[np.ndarray, np.ndarray]:
    """Vertices of two facing rims: in each piece from corner to corner the one nearest to the other rim.

    Lips are told apart by jawOpen, lids by the line between their corners.
    """
    face, marks = head.parts["face"], head.neutral[head.landmarks]
    points = head.neutral[face]
    start, end = marks[upper[0]], marks[upper[-1]]
    place = (points[:, 0] - start[0]) / (end[0] - start[0])
    if upper[0] == 60:
        below = head.modes[CHANNELS.index("jawOpen"), face, 1] < -1.2
    else:
        below = points[:, 1] < start[1] + place * (end[1] - start[1])
    found = []
    for line, side, sign in ((upper, ~below, 1.0), (lower, below, -1.0)):
        steps = np.linspace(0.0, 1.0, 20)[:, None]
        path = np.concatenate(
            [marks[a] * (1.0 - steps) + marks[b] * steps for a, b in zip(line, line[1:], strict=False)]
        )
        near = np.linalg.norm(points[:, None] - path[None], axis=-1).min(1) < RIM_CM
        rim = []
        for k in range(2, PIECES - 2):
            inside = np.flatnonzero(near & side & (np.floor(place * PIECES) == k))
            if len(inside):
                rim.append(face[inside[np.argmin(sign * points[inside, 1])]])
        found.append(np.array(rim))
    return found[0], found[1]


def crossing(positions: np.ndarray, upper: np.ndarray, lower: np.ndarray) -> str:
    """Share of the upper rim's vertices below the lower rim in all frames [T, V, 3], the deepest, and the
    mean gap of the others. The same as `rust-core/tests/suite/rim_crossing.rs`."""
    gaps = []
    for frame in positions:
        order = lower[np.argsort(frame[lower, 0])]
        inside = (frame[upper, 0] >= frame[order[0], 0]) & (frame[upper, 0] <= frame[order[-1], 0])
        u = upper[inside]
        gaps.append(frame[u, 1] - np.interp(frame[u, 0], frame[order, 0], frame[order, 1]))
    gap = 10.0 * np.concatenate(gaps)
    apart = np.maximum(gap, 0.0).sum() / max(1, (gap >= 0).sum())
    return f"{100.0 * (gap < 0).mean():6.1f} %{max(0.0, -gap.min()):7.2f}{apart:7.2f}"


def print_crossings(anyface: Path, head: Head, sets: dict[str, np.ndarray]) -> None:
    """Rims that pass through one another, in the truth and in what the command makes of it."""
    print("\nrims: share of vertices crossed, deepest, mean gap (mm); true motion, then the command's")
    found = {name: rims(head, *slit) for name, slit in SLITS.items()}
    rest = head.neutral[None]
    for name, (upper, lower) in found.items():
        print(f"{name:12}{'at rest':12}{crossing(rest, upper, lower)}")
    for what, weights in sets.items():
        truth = np.einsum("tm,mvx->tvx", weights, head.modes)
        moved = deformed(anyface, head, head.neutral, truth[:, head.landmarks])
        for name, (upper, lower) in found.items():
            cells = [crossing(rest + motion, upper, lower) for motion in (truth, moved)]
            print(f"{name:12}{what:12}{cells[0]} |{cells[1]}", flush=True)


def blinks(frames: int) -> np.ndarray:
    """Both lids from open to closed and nothing else. [T, 51]."""
    weights = np.zeros((frames, len(CHANNELS)))
    for side in ("Left", "Right"):
        weights[:, CHANNELS.index(f"eyeBlink{side}")] = np.linspace(0.0, 1.0, frames)
    return weights


def pressed(frames: int) -> np.ndarray:
    """Lips that close over a jaw half open, a little pressed, shrugged, rolled and pursed. [T, 51]."""
    rng = np.random.default_rng(4)
    weights = np.zeros((frames, len(CHANNELS)))
    jaw = 0.4 * rng.random(frames)
    weights[:, CHANNELS.index("jawOpen")] = jaw
    weights[:, CHANNELS.index("mouthClose")] = jaw * rng.uniform(0.9, 1.1, frames)
    for name in ("mouthPressLeft", "mouthPressRight", "mouthShrugLower", "mouthRollLower", "mouthPucker"):
        weights[:, CHANNELS.index(name)] = 0.1 * rng.random(frames)
    return weights


def main() -> None:
    """Entry of the command."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--data", type=Path, default=Path("../shared/data"))
    parser.add_argument("--anyface", type=Path, default=Path("target/debug/anyface"))
    parser.add_argument("--people", type=int, default=3, help="ICT's mean face and random identities")
    parser.add_argument("--frames", type=int, default=100)
    args = parser.parse_args()
    head = load_head(args.data)
    speech = evaluation_frames(np.random.default_rng(9), load_speech(args.data).test, args.frames)
    speech[:, GAZE] = 0.0
    wide = np.zeros((20, len(CHANNELS)))
    wide[:, CHANNELS.index("jawOpen")] = np.linspace(0.05, 1.0, 20)
    sets = {"speech": speech, "blink": blinks(11), "jaw 0–1": wide}
    results = {n: errors(args.anyface, head, w, args.people) for n, w in sets.items()}
    print(f"{'mm: moves / error':18}" + "".join(f"{n:>18}" for n in sets))
    for part in head.parts:
        cells = (results[n][part] for n in sets)
        print(f"{part:18}" + "".join(f"{m:9.2f} /{e:7.3f}" for m, e in cells), flush=True)
    print_crossings(args.anyface, head, {"speech": speech, "blink": sets["blink"], "pressed": pressed(60)})


if __name__ == "__main__":
    main()
