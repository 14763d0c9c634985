"""Writes the motion of baselines on the held-out clips, as files that `anyface deform` reads.

    python -m training.systems.freetalk.evaluate --data ../shared/data --out runs/baselines

writes `<out>/teacher/grid_s1/<clip>.npz`: the co-articulation teacher on the true phone times of
every held-out clip of grid_s1. It does not use the sound, so it bounds how much phones alone can predict.
With `--run ats.pt --name NAME --takes TAKE ...` it writes `<out>/NAME/facegood_zh_whole/…` instead: the
motion, in its default style, of a model that was not trained on these takes. `--grid` adds
`<out>/NAME/grid_s1/…`: the held-out clips of a speaker that the model was not trained on.
"""

from argparse import Namespace
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import numpy as np
import torch

from training import DATA
from training.corpus import ear
from training.corpus.aligned import read_grid_speech
from training.corpus.clip import FPS
from training.corpus.ear import EarClip
from training.corpus.teacher import Teacher
from training.flags import run_command
from training.speech.ear import EarBody
from training.systems.freetalk.stored import load_models, load_run
from training.systems.freetalk.train_stream import FullModel

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


def write_unheard(data: Path, cache: Path, run: Path, out: Path, takes: list[str], grid: bool) -> None:
    """Writes a run's motion for whole takes of facegood_zh and, with `grid`, grid_s1's held-out clips."""
    body, model = full_model(run)
    entries = list(ear.recorded(Namespace(data=data, cache=cache, corpus=[]), body.config.taps))
    chosen = {f"grid_s1/{e.name}": e for e in entries if grid and e.source == "grid_s1" and e.held_out}
    for take in takes:
        parts = [e for e in entries if e.source == "facegood_zh" and e.name.split("/")[0] == take]
        if not parts:
            raise ValueError(f"--takes: expected takes of facegood_zh, got {take}")
        chosen[f"facegood_zh_whole/{take}"] = joined(parts)
    for path, entry in chosen.items():
        with torch.no_grad():
            heard = body(entry.heard[:1])[0]
        write(out / f"{path}.npz", model(heard).unflatten(1, (68, 3)).numpy())


def joined(parts: list[EarClip]) -> EarClip:
    """Joins the pieces of one take, the training part first, into one clip in its own voice."""
    parts = sorted(parts, key=lambda e: e.held_out)
    heard = torch.cat([e.heard[:1] for e in parts], dim=2)
    together = {k: torch.cat([getattr(e, k) for e in parts]) for k in ("motion", "weight", "phones")}
    return replace(parts[0], heard=heard, **together)


def full_model(run: Path) -> tuple[EarBody, FullModel]:
    """The ear, and a finished run with the sampling of the shipped model."""
    (body, shipped), denoiser = load_models(), load_run(run)
    denoiser.config.sampling = shipped.config.sampling
    return body, FullModel(denoiser)


def main(
    data: Path = DATA,
    out: Path = Path("runs/baselines"),
    cache: Path = Path("runs/cache"),
    run: Annotated[Path | None, "ats.pt of a model that was trained without these takes"] = None,
    name: Annotated[str, "name of that model in the report"] = "without",
    takes: Annotated[list[str], "takes of facegood_zh that it never heard"] = (),
    grid: Annotated[bool, "measure grid_s1 too, which it never heard"] = False,
) -> None:
    """Command line."""
    if run is not None:
        write_unheard(data, cache, run, out / name, takes, grid)
    else:
        print(f"{out / 'teacher'}: {write_teacher(data, out)} clips")


if __name__ == "__main__":
    run_command(main)
