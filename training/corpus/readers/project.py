"""The project's own sources as corpus folders; SOURCE is the data folder that holds `motion/`."""

from pathlib import Path

import numpy as np

from training.corpus import facegood, grid
from training.corpus.aligned import read_grid_speech
from training.corpus.checked import CorpusError
from training.corpus.clip import FPS, read_sound
from training.corpus.split import facegood_first_held_out
from training.corpus.tracks import SOUND_HZ
from training.corpus.writer import CorpusWriter


def grid_s1(source: Path, folder: Path, _: Path | None) -> Path:
    """grid_s1: landmarks at 25 fps, head still, eyes not observed, phones aligned to the words.

    Needs pocketsphinx. The alignment is written to `phones/`, so it runs once.
    """
    needed(source / "motion" / grid.SOURCE / grid.TRACK)
    writer = CorpusWriter(folder, grid.SOURCE, "m")
    spoken = {u.name: u for u in read_grid_speech(source)}
    for clip in grid.read_grid(source):
        writer.clip(clip.name, "s1", "test" if clip.held_out else "train")
        writer.sound_file(clip.name, source / "motion" / grid.SOURCE / "audio" / f"{clip.name}.ogg")
        visible, tracked_frames = clip.weight.any(axis=0), clip.weight.any(axis=1)
        places = clip.motion + clip.neutral
        writer.landmarks(clip.name, places, FPS, neutral=clip.neutral, seen=visible, found=tracked_frames)
        if clip.name in spoken:
            writer.phones(clip.name, spoken[clip.name].phones)
    return writer.close()


def facegood_zh(source: Path, folder: Path, _: Path | None) -> Path:
    """facegood_zh: blend weights at 30 fps; the end of every take is held out."""
    writer = CorpusWriter(folder, facegood.SOURCE, "m")
    inside = source / "motion" / facegood.SOURCE
    needed(inside)
    for name, columns in facegood.arkit_takes(source):
        samples = read_sound(inside / f"{name}.ogg")
        values = np.stack(list(columns.values()), axis=1)
        frames_at_25 = int((len(values) - 1) / facegood.CAPTURE_FPS * FPS) + 1
        cut_s = facegood_first_held_out(frames_at_25) / FPS
        spans = {"start": (0.0, cut_s), "end": (cut_s, len(values) / facegood.CAPTURE_FPS)}
        for part, (first_s, last_s) in spans.items():
            writer.clip(f"{name}_{part}", "speaker", "train" if part == "start" else "test")
            writer.sound(f"{name}_{part}", samples[_at(first_s, SOUND_HZ) : _at(last_s, SOUND_HZ)], SOUND_HZ)
            frames = np.arange(_at(first_s, facegood.CAPTURE_FPS), _at(last_s, facegood.CAPTURE_FPS))
            seconds = frames / facegood.CAPTURE_FPS - first_s
            writer.weights(f"{name}_{part}", list(columns), values[frames], seconds)
    return writer.close()


def needed(path: Path) -> None:
    """Raises `CorpusError` if a file of the source is missing."""
    if not path.exists():
        raise CorpusError(path, None, "a file or folder of the data that training.md names", "none")


def _at(seconds: float, rate_hz: float) -> int:
    """The last sample or frame that is not after `seconds`."""
    return int(seconds * rate_hz + 1e-6)
