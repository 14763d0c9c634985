"""Writes the motion of baselines on the held-out clips, as files that `anyface deform` reads.

    python -m training.systems.freetalk.evaluate --data ../shared/data --out runs/baselines

writes `<out>/teacher/grid_s1/<clip>.npz`: the co-articulation teacher on the true phone times of
every held-out clip of grid_s1. It does not use the sound, so it bounds how much phones alone can predict.
"""

from pathlib import Path

import numpy as np

from training import DATA
from training.corpus.aligned import read_grid_speech
from training.corpus.clip import FPS
from training.corpus.teacher import Teacher
from training.flags import run_command

SAMPLES_PER_FRAME = 640


def write(path: Path, motion: np.ndarray) -> None:
    """Writes displacements [T, 68, 3] in canonical metres under the names that `anyface motion` uses."""
    path.parent.mkdir(parents=True, exist_ok=True)
    np.savez(path, landmark_displacements=motion.astype(np.float32), fps=np.float64(FPS))


def write_teacher(data: Path, out: Path) -> int:
    """Writes every held-out clip whose words could be aligned; returns the number of clips."""
    teacher = Teacher.load(clear=False)
    held_out = [u for u in read_grid_speech(data) if u.held_out]
    for utterance in held_out:
        frames = -(-len(utterance.samples) // SAMPLES_PER_FRAME)
        motion = teacher.motion(utterance.phones, frames)
        write(out / "teacher" / utterance.source / f"{utterance.name}.npz", motion)
    return len(held_out)


def main(data: Path = DATA, out: Path = Path("runs/baselines")) -> None:
    """Command line."""
    print(f"{out / 'teacher'}: {write_teacher(data, out)} clips")


if __name__ == "__main__":
    run_command(main)
