"""Motion of baselines on the held-out clips, as files that `anyface deform` reads.

    python -m training.baselines --data ../shared/data --out runs/baselines

writes `<out>/teacher/grid_s1/<clip>.npz`: the co-articulation teacher on the true phone times of
every held-out clip of grid_s1. It hears nothing, so it bounds what phones alone can tell. With
`--speech speech.pt` also `<out>/read-out/…`: the linear read-out that the speech encoder was
trained with, a deterministic network without diffusion, in each source's own style.
"""

import argparse
from pathlib import Path

import numpy as np
import torch

from training.corpus import bank
from training.corpus.aligned import read_grid_speech
from training.corpus.clip import FPS
from training.corpus.teacher import Teacher
from training.losses import SCALE_M
from training.speech.compact import CompactConfig, normalise
from training.train_speech import SpeechToMotion

SAMPLES_PER_FRAME = 640


def write(path: Path, motion: np.ndarray) -> None:
    """Displacements [T, 68, 3] in canonical metres as `anyface motion` names them."""
    path.parent.mkdir(parents=True, exist_ok=True)
    np.savez(path, landmark_displacements=motion.astype(np.float32), fps=np.float64(FPS))


def write_teacher(data: Path, out: Path) -> int:
    """Every held-out clip whose words could be aligned; returns their number."""
    teacher = Teacher.load(clear=False)
    held_out = [u for u in read_grid_speech(data) if u.held_out]
    for utterance in held_out:
        frames = -(-len(utterance.samples) // SAMPLES_PER_FRAME)
        motion = teacher.motion(utterance.phones, frames)
        write(out / "teacher" / utterance.source / f"{utterance.name}.npz", motion)
    return len(held_out)


@torch.no_grad()
def write_read_out(data: Path, cache: Path, run: Path, out: Path) -> int:
    """Every held-out clip of recorded motion; returns their number."""
    saved = torch.load(run)
    model = SpeechToMotion(CompactConfig(**saved["config"]), saved["sources"], saved["targets"]).eval()
    model.load_state_dict(saved["state"])
    held_out = [e for e in bank.load(data, cache, 7) if e.held_out]
    for entry in held_out:
        source = saved["sources"].index(entry.source)
        motion = model(normalise(entry.mels[0].float())[None], torch.tensor([source]))[0]
        motion = motion * SCALE_M[entry.source]
        path = out / "read-out" / entry.source / f"{entry.name.split('/')[0]}.npz"
        write(path, motion.unflatten(1, (68, 3)).numpy())
    return len(held_out)


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--data", type=Path, default=Path("../shared/data"))
    parser.add_argument("--out", type=Path, default=Path("runs/baselines"))
    parser.add_argument("--cache", type=Path, default=Path("runs/cache"))
    parser.add_argument("--speech", type=Path, help="speech.pt of training.train_speech")
    arguments = parser.parse_args()
    print(f"{arguments.out / 'teacher'}: {write_teacher(arguments.data, arguments.out)} clips")
    if arguments.speech is not None:
        count = write_read_out(arguments.data, arguments.cache, arguments.speech, arguments.out)
        print(f"{arguments.out / 'read-out'}: {count} clips")


if __name__ == "__main__":
    main()
