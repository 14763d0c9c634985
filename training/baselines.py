"""Motion of baselines on the held-out clips, as files that `anyface deform` reads.

    python -m training.baselines --data ../shared/data --out runs/baselines

writes `<out>/teacher/grid_s1/<clip>.npz`: the co-articulation teacher on the true phone times of
every held-out clip of grid_s1. It hears nothing, so it bounds what phones alone can tell.
"""

import argparse
from pathlib import Path

import numpy as np

from training.corpus.aligned import read_grid_speech
from training.corpus.clip import FPS
from training.corpus.teacher import Teacher

SAMPLES_PER_FRAME = 640


def write(path: Path, motion: np.ndarray) -> None:
    """Displacements [T, 68, 3] in canonical metres as `anyface motion` names them."""
    path.parent.mkdir(parents=True, exist_ok=True)
    np.savez(path, landmark_displacements=motion.astype(np.float32), fps=np.float64(FPS))


def write_teacher(data: Path, out: Path) -> int:
    """Every held-out clip whose words could be aligned; returns their number."""
    teacher = Teacher.load(data)
    held_out = [u for u in read_grid_speech(data) if u.held_out]
    for utterance in held_out:
        frames = -(-len(utterance.samples) // SAMPLES_PER_FRAME)
        motion = teacher.motion(utterance.phones, frames)
        write(out / "teacher" / utterance.source / f"{utterance.name}.npz", motion)
    return len(held_out)


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--data", type=Path, default=Path("../shared/data"))
    parser.add_argument("--out", type=Path, default=Path("runs/baselines"))
    arguments = parser.parse_args()
    print(f"{arguments.out / 'teacher'}: {write_teacher(arguments.data, arguments.out)} clips")


if __name__ == "__main__":
    main()
