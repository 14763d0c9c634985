"""Writes corpus folders with vertex sequences of ICT FaceKit's faces speaking.

    python -m training.corpus.ict_sequences --data ../shared/data --out runs/ict_sequences

Each triangulation of the face gets a folder, in which random identities act stretches of facegood_zh with a
random upper face. Every fourth stretch is a chain of random expressions instead. Identities of the split
`test` appear in no folder as `train`, and act the take that is never trained on. The head is still, the unit
is metres, the rate 15 fps. Each stretch has the sound of its take.
"""

import json
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated

import numpy as np

from training import DATA
from training.corpus.clip import read_sound
from training.corpus.expressions import HELD_OUT_TAKE, random_combinations, upper_face
from training.corpus.facegood import CAPTURE_FPS, SOURCE, arkit_takes, channel_rows
from training.corpus.faces import Face, align, load_ict
from training.corpus.remesh import remesh
from training.corpus.tracks import SOUND_HZ
from training.corpus.writer import CorpusWriter
from training.flags import run_command

FPS = 15.0
STRETCH_S = 10.0
HOLD_S = 0.6
"""Seconds from one random expression to the next."""
CHAIN_EVERY = 4
"""One stretch in this many is a chain of random expressions instead of speech."""


@dataclass(frozen=True)
class Take:
    """Channel weights [T, 51] at 15 fps and the sound at 16 kHz."""

    name: str
    weights: np.ndarray
    samples: np.ndarray


@dataclass(frozen=True)
class Triangulation:
    """One triangulation of ICT's mean face, and the identity modes [100, V, 3] m on it."""

    face: Face
    identity: np.ndarray

    def person(self, rng: np.random.Generator) -> Face:
        """A random identity in canonical axes."""
        coefficients = rng.standard_normal(len(self.identity))
        vertices = self.face.vertices + np.tensordot(coefficients, self.identity, 1)
        return align(replace(self.face, vertices=vertices))


def read_takes(data: Path) -> list[Take]:
    """All takes of facegood_zh."""
    step = int(CAPTURE_FPS / FPS)
    return [
        Take(name, channel_rows(columns)[::step], read_sound(data / "motion" / SOURCE / f"{name}.ogg"))
        for name, columns in arkit_takes(data)
    ]


def triangulate(rng: np.random.Generator, data: Path, triangles: int) -> Triangulation:
    """The mean face and its modes on about this many triangles, or on ICT's own triangles if 0."""
    model = load_ict(data, "face")
    count = len(model.mean.modes)
    if triangles == 0:
        return Triangulation(model.mean, model.identity)
    both = np.concatenate([model.mean.modes, model.identity])
    meshed = remesh(rng, replace(model.mean, modes=both), triangles)
    return Triangulation(replace(meshed, modes=meshed.modes[:count]), meshed.modes[count:])


def acting(rng: np.random.Generator, frames: int, draw) -> np.ndarray:
    """Blends from one random expression of `draw(rng, count)` to the next. [frames, 51]."""
    times = np.arange(frames) / (HOLD_S * FPS)
    keys = draw(rng, int(times[-1]) + 2)
    at, share = times.astype(int), (times % 1.0)[:, None]
    return (1.0 - share) * keys[at] + share * keys[at + 1]


def perform(rng: np.random.Generator, take: Take, number: int) -> tuple[np.ndarray, np.ndarray]:
    """A stretch of a take: channel weights [T, 51] and samples."""
    frames = int(STRETCH_S * FPS)
    first = int(rng.integers(len(take.weights) - frames))
    begin = int(first / FPS * SOUND_HZ)
    samples = take.samples[begin : begin + int(STRETCH_S * SOUND_HZ)]
    if number % CHAIN_EVERY == CHAIN_EVERY - 1:
        return acting(rng, frames, random_combinations), samples
    return take.weights[first : first + frames] + acting(rng, frames, upper_face), samples


def write_folder(data: Path, out: Path, seed: int, triangles: int, people: dict[str, int],
                 stretches: int) -> Path:  # fmt: skip
    """Writes one triangulation. `people` gives the speakers per split; each acts this many `stretches`."""
    rng = np.random.default_rng(seed)
    mesh, takes = triangulate(rng, data, triangles), read_takes(data)
    training_takes = [take for take in takes if take.name != HELD_OUT_TAKE]
    test_takes = [take for take in takes if take.name == HELD_OUT_TAKE]
    writer = CorpusWriter(out, f"ict_{seed}", "m", topology=f"ict_{seed}", fps={"vertices": FPS})
    writer.mesh("neutral", mesh.face.vertices, mesh.face.triangles)
    table = {"vertices": mesh.face.landmarks.tolist()}
    writer.place(f"topologies/ict_{seed}", "landmarks.json").write_text(json.dumps(table) + "\n")
    for split, count in people.items():
        for number in range(count):
            speaker, face = f"{split}{number:02d}", mesh.person(rng)
            writer.mesh(speaker, face.vertices, face.triangles)
            for stretch in range(stretches):
                choice = test_takes if split == "test" else training_takes
                acted = perform(rng, choice[int(rng.integers(len(choice)))], stretch)
                _write_clip(writer, f"{speaker}_{stretch:02d}", speaker, split, face, acted)
    return writer.close()


def _write_clip(writer: CorpusWriter, clip: str, speaker: str, split: str, face: Face, acted) -> None:
    weights, samples = acted
    writer.clip(clip, speaker, split)
    writer.sound(clip, samples, SOUND_HZ)
    writer.vertices(clip, face.vertices + np.einsum("tm,mvx->tvx", weights, face.modes))


def main(
    data: Path = DATA,
    out: Path = Path("runs/ict_sequences"),
    triangles: Annotated[list[int], "0: ICT's own"] = (1500, 1800, 2200),
    people: Annotated[int, "training speakers in each folder"] = 8,
    held_out: Annotated[int, "test speakers in each folder"] = 1,
    stretches: Annotated[int, "stretches of ten seconds for each speaker"] = 6,
    seed: int = 0,
) -> None:
    """Writes a folder for each number of triangles."""
    split = {"train": people, "test": held_out}
    for number, count in enumerate(triangles, seed):
        print(write_folder(data, out / f"ict_{number}", number, count, split, stretches), flush=True)


if __name__ == "__main__":
    run_command(main)
