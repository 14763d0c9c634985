"""Motion of baselines on the held-out clips, as files that `anyface deform` reads.

    python -m training.systems.freetalk.evaluate --data ../shared/data --out runs/baselines

writes `<out>/teacher/grid_s1/<clip>.npz`: the co-articulation teacher on the true phone times of
every held-out clip of grid_s1. It hears nothing, so it bounds what phones alone can tell. With
`--speech speech.pt` also `<out>/read-out/…`: the linear read-out that the speech encoder was
trained with, a deterministic network without diffusion, in each source's own style. With `--run
ats.pt --name NAME --takes TAKE ...` instead `<out>/NAME/facegood_zh_whole/…`: what a model that
never heard these takes makes of them in its default style; with `--run ats.pt --name NAME --grid`
`<out>/NAME/grid_s1/…`, the held-out clips under a model that never heard that source.
"""

import argparse
from dataclasses import replace
from pathlib import Path

import numpy as np
import torch

from training.corpus import bank
from training.corpus.aligned import read_grid_speech
from training.corpus.clip import FPS
from training.corpus.lessons import FullModel
from training.corpus.teacher import Teacher
from training.losses import SCALE_M
from training.speech.compact import CompactConfig, normalise
from training.speech.train import SpeechToMotion
from training.systems.freetalk.ats import Sampling
from training.systems.freetalk.stored import load_run

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
    model = SpeechToMotion(CompactConfig(**saved["config"]), saved["sources"]).eval()
    model.load_state_dict(saved["state"])
    held_out = [e for e in bank.load(data, cache, 7) if e.held_out]
    for entry in held_out:
        source = saved["sources"].index(entry.source)
        motion = model(normalise(entry.mels[0].float())[None], torch.tensor([source]))[0]
        motion = motion * SCALE_M[entry.source]
        path = out / "read-out" / entry.source / f"{entry.name.split('/')[0]}.npz"
        write(path, motion.unflatten(1, (68, 3)).numpy())
    return len(held_out)


def write_unheard(data: Path, cache: Path, run: Path, out: Path, takes: list[str], grid: bool) -> int:
    """A finished run's motion of whole takes and of grid_s1's held-out clips; returns their number."""
    model, entries = full_model(run), bank.load(data, cache, 7)
    chosen = {}
    for take in takes:
        parts = [e for e in entries if e.source == "facegood_zh" and e.name.split("/")[0] == take]
        if not parts:
            raise ValueError(f"--takes: expected takes of facegood_zh, got {take}")
        chosen[f"facegood_zh_whole/{take}"] = joined(parts)
    if grid:
        held_out = [e for e in entries if e.source == "grid_s1" and e.held_out]
        chosen |= {f"grid_s1/{e.name}": e for e in held_out}
    for name, entry in chosen.items():
        write(out / f"{name}.npz", model.teach(entry).taught.float().unflatten(1, (68, 3)).numpy())
    return len(chosen)


def joined(parts: list[bank.Entry]) -> bank.Entry:
    """The pieces of one take, the training part first, as one clip in its own voice."""
    parts = sorted(parts, key=lambda e: e.held_out)
    mels = torch.cat([e.mels[0] for e in parts])[None]
    together = {k: torch.cat([getattr(e, k) for e in parts]) for k in ("motion", "weight", "phones")}
    return replace(parts[0], mels=mels, **together)


def full_model(run: Path) -> FullModel:
    """A finished run, sampled as the exported model is: one step, little noise."""
    encoder, denoiser = load_run(run)
    denoiser.config.sampling = Sampling(steps=1, temperature=0.1)
    return FullModel(encoder, denoiser)


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--data", type=Path, default=Path("../shared/data"))
    parser.add_argument("--out", type=Path, default=Path("runs/baselines"))
    parser.add_argument("--cache", type=Path, default=Path("runs/cache"))
    parser.add_argument("--speech", type=Path, help="speech.pt of training.speech.train")
    parser.add_argument("--run", type=Path, help="ats.pt of a model that was trained without something")
    parser.add_argument("--name", help="of that model, as the report shows it")
    parser.add_argument("--takes", nargs="*", default=[], help="of facegood_zh that it never heard")
    parser.add_argument("--grid", action="store_true", help="it never heard grid_s1")
    arguments = parser.parse_args()
    if arguments.run is not None:
        out = arguments.out / arguments.name
        what = (arguments.takes, arguments.grid)
        print(f"{out}: {write_unheard(arguments.data, arguments.cache, arguments.run, out, *what)} clips")
        return
    print(f"{arguments.out / 'teacher'}: {write_teacher(arguments.data, arguments.out)} clips")
    if arguments.speech is not None:
        count = write_read_out(arguments.data, arguments.cache, arguments.speech, arguments.out)
        print(f"{arguments.out / 'read-out'}: {count} clips")


if __name__ == "__main__":
    main()
