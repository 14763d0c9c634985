"""Measures the emotion that EmoFace shows for borrowed emotional voices and for calm readers.

    python -m training.systems.emoface.evaluate_voices --data ../shared/data --anyface target/release/anyface

Two people who are neutral in all training data (a man of grid_s1, a woman of nathalie_nl) say a line. The
emotion comes from recordings of actors whom no training of the ear heard (`--emotion-of`): five of crema_d,
two of emodb_de, and the acted clips. The motion is compared with the same line under a neutral recording of
the same actor, in mm on a human head: how far the brows and the corners of the mouth rise. Beside it stands
the same line under the heard emotion by name, at the heard intensity. A face counts as the emotion whose face
under `--emotion` has the most similar direction in the mean over frames. A neutral reading shows an emotion
in frames where a brow or a lid is more than 1.5 mm from the same reading without an emotion.
"""

import csv
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path
from types import ModuleType

import numpy as np
import soundfile

from training.corpus import crema_d, emodb
from training.corpus.clip import read_sound
from training.corpus.tracks import SOUND_HZ
from training.engine import Engine
from training.flags import run_command

STILL = (
    "--system",
    "emoface",
    "--blinks",
    0,
    "--brow-accents",
    0,
    "--gaze",
    0,
    "--head-motion",
    0,
    "--variety",
    0,
)
"""Options with which only speech and emotion move the face."""
SHOWN = ("angry", "sad", "happy", "afraid", "disgusted")
BROWS, CORNERS, UPPER = [19, 20, 21, 22, 23, 24], [48, 54], [*range(17, 27), *range(36, 48)]
SEEN_MM, FAR_MM = 1.5, 1.0
EVERY, EACH = 3, 4
"""Of an actor's recordings with one emotion every third is used, at most four."""
CLIPS = (("Mark_anger", "angry"), ("Mark_sadness", "sad"), ("Claire_joy_mandarin", "happy"))
GRID_STEP, GRID_COUNT = 20, 40
"""Every twentieth clip of grid_s1 is used, at most 40. All of these are held out."""


def motion(engine: Engine, sound: Path, *more) -> np.ndarray:
    """Landmark displacements for a sound, [T, 68, 3] mm."""
    return in_mm(engine.run("motion", "--audio", sound, *STILL, *more))


def in_mm(arrays: dict[str, np.ndarray]) -> np.ndarray:
    """Landmark displacements of a result, [T, 68, 3] mm."""
    return arrays["landmark_displacements"].astype(float) * 1e3


def gap(moved: np.ndarray) -> np.ndarray:
    """Lip gap, [T]."""
    return moved[:, 62, 1] - moved[:, 66, 1]


@dataclass
class Acted:
    """A recording of an actor, and a neutral one of the same actor if there is one."""

    corpus: str
    emotion: str
    sound: Path
    neutral: Path | None


def acted_clips(data: Path, corpus: ModuleType) -> Iterator[tuple[str, str, Path]]:
    """Actor, emotion and sound of every clip of the actors of `crema_d` or `emodb` whom no training heard."""
    folder = data / "speech" / corpus.SOURCE
    with open(folder / "clips.tsv", newline="") as file:
        rows = list(csv.DictReader(file, delimiter="\t"))
    column, names = ("acted", crema_d.ACTED) if corpus is crema_d else ("feeling", emodb.NAMES)
    for actor in crema_d.held_out(rows) if corpus is crema_d else emodb.HELD_OUT:
        for row in rows:
            if row["actor"] == actor:
                yield actor, names[row[column]], folder / f"{row['clip']}.ogg"


def acted(data: Path) -> Iterator[Acted]:
    """Recordings of actors whom no training heard, with an emotion or neutral."""
    for corpus in (crema_d, emodb):
        for _, clips in groupby(acted_clips(data, corpus), key=lambda clip: clip[0]):
            own = [clip[1:] for clip in clips]
            neutral = next(sound for emotion, sound in own if emotion == "neutral")
            for shown in (*SHOWN, "neutral"):
                sounds = [sound for emotion, sound in own if emotion == shown]
                for sound in sounds[::EVERY][:EACH]:
                    yield Acted(corpus.SOURCE, shown, sound, neutral)
    for name, emotion in CLIPS:
        yield Acted("clips", emotion, data / f"clips/{name}.wav", None)


@dataclass
class Heard:
    """What the ear heard in a recording: the likeliest emotion and the mean intensity that the face shows."""

    emotion: str
    intensity: float


def swap(engine: Engine, line: Path, sound: Path) -> tuple[np.ndarray, Heard]:
    """Landmark displacements of a line with the emotion of a recording, and what was heard in it."""
    arrays, report = engine.run_with_report("motion", "--audio", line, *STILL, "--emotion-of", sound)
    heard = report["heard_emotion"]
    return in_mm(arrays), Heard(likeliest(heard["probability"]), float(np.mean(heard["intensity"])))


def likeliest(probability: dict[str, list[float]]) -> str:
    """The emotion with the largest mean probability over time, neutral apart."""
    return max((name for name in probability if name != "neutral"), key=lambda name: sum(probability[name]))


def rise(face: np.ndarray) -> tuple[float, float]:
    """How far brows and corners of the mouth rise in a face [68, 3]."""
    return float(face[BROWS, 1].mean()), float(face[CORNERS, 1].mean())


@dataclass
class Borrowed:
    """One line under one recording: rises of brows and corners in mm, and the similarity of the lips."""

    acted: Acted
    heard: Heard
    shown: tuple[float, float]
    by_name: tuple[float, float]
    lips: float
    is_nearest: bool


def borrowed(engine: Engine, line: Path, recordings: list[Acted]) -> Iterator[Borrowed]:
    """Scores a line with the emotion of recordings."""
    plain = motion(engine, line, "--emotion-from", "off")
    faces = {name: (motion(engine, line, "--emotion", f"{name}:1") - plain).mean(axis=0) for name in SHOWN}
    neutral = {None: plain}
    for recording in recordings:
        if recording.neutral not in neutral:
            neutral[recording.neutral] = swap(engine, line, recording.neutral)[0]
        moved, heard = swap(engine, line, recording.sound)
        named = motion(engine, line, "--emotion", f"{heard.emotion}:{heard.intensity:.3f}")
        face = (moved - plain).mean(axis=0)
        nearest = min(faces, key=lambda name: angle(face, faces[name]))
        shown = rise((moved - neutral[recording.neutral]).mean(axis=0))
        lips = float(np.corrcoef(gap(moved), gap(plain))[0, 1])
        yield Borrowed(recording, heard, shown, rise((named - plain).mean(axis=0)), lips,
                       nearest == recording.emotion)  # fmt: skip


def neutral_borrowed(engine: Engine, line: Path, recordings: list[Acted]) -> list[float]:
    """How far a line's brows or corners move under neutral recordings, mm each."""
    plain = motion(engine, line, "--emotion-from", "off")
    faces = [(swap(engine, line, one.sound)[0] - plain).mean(axis=0) for one in recordings]
    return [max(map(abs, rise(face))) for face in faces]


def table(rows: list[Borrowed]) -> Iterator[str]:
    """Medians of each emotion, over all recordings and over those that were heard as acted."""
    for name in SHOWN:
        for title, of in (("all", rows), ("heard as acted", [r for r in rows if r.heard.emotion == name])):
            own = [row for row in of if row.acted.emotion == name]
            if not own:
                continue
            brows, corners = np.median([row.shown for row in own], axis=0)
            by_name = np.median([row.by_name for row in own], axis=0)
            intensity = np.median([row.heard.intensity for row in own])
            yield (f"  {name:10s} {title:15s} {len(own):3d}: brows {brows:.1f} (by name {by_name[0]:.1f}), "
                   f"corners {corners:.1f} (by name {by_name[1]:.1f}), intensity {intensity:.2f}, "
                   f"lips r {np.median([row.lips for row in own]):.3f}")  # fmt: skip
    right = np.mean([row.is_nearest for row in rows])
    yield f"  the face is that of the recording's emotion in {100 * right:.0f} % of {len(rows)} (chance 20 %)"


def angle(a: np.ndarray, b: np.ndarray) -> float:
    """Negative cosine between two faces: smaller for more similar directions, whatever their strength."""
    return -float((a * b).sum() / (np.linalg.norm(a) * np.linalg.norm(b) + 1e-9))


def neutral(engine: Engine, name: str, sounds: list[Path]) -> str:
    """How often calm readings show an emotion, and how far from rest the face is a second after them."""
    emotional, shown, ends = [], 0, []
    for sound in sounds:
        moved = motion(engine, sound)
        with tempfile.TemporaryDirectory() as folder:
            longer = Path(folder) / "longer.wav"
            samples = read_sound(sound)
            soundfile.write(longer, np.concatenate([samples, np.zeros(SOUND_HZ, samples.dtype)]), SOUND_HZ)
            ends.append(np.linalg.norm(motion(engine, longer)[-1], axis=1).max())
        apart = np.linalg.norm(moved - motion(engine, sound, "--emotion-from", "off"), axis=2)[:, UPPER].max(
            axis=1
        )
        emotional += list(apart > SEEN_MM)
        shown += bool((apart > SEEN_MM).any())
    return (f"  {name:12s} {len(sounds)} readings: an emotion in {100 * np.mean(emotional):.1f} % of frames, "
            f"in {shown} readings; a second after it {np.median(ends):.1f} mm from rest in the median, "
            f"{max(ends):.1f} at most")  # fmt: skip


def main(data: Path, anyface: Path) -> None:
    """Command line."""
    engine = Engine(anyface)
    grid = sorted((data / "motion/grid_s1/audio").glob("*.ogg"))
    readers = {
        name: sorted((data / "speech" / name).glob("*.ogg"))
        for name in ("nathalie_nl", "kathleen_en", "kerstin_de")
    }
    recordings, rows, moved = list(acted(data)), [], []
    calm = [one for one in recordings if one.emotion == "neutral"]
    for line in (grid[0], readers["nathalie_nl"][0]):
        moved += neutral_borrowed(engine, line, calm)
        rows += borrowed(engine, line, [one for one in recordings if one.emotion != "neutral"])
    far = sum(mm > FAR_MM for mm in moved)
    print(f"neutral recordings move brows or corners by {np.median(moved):.2f} mm in the median, "
          f"{far} of {len(moved)} by more than {FAR_MM:.0f} mm")  # fmt: skip
    for corpus in dict.fromkeys(row.acted.corpus for row in rows):
        print(corpus)
        print("\n".join(table([row for row in rows if row.acted.corpus == corpus])), flush=True)
    print("all")
    print("\n".join(table(rows)), flush=True)
    print(neutral(engine, "grid_s1", grid[::GRID_STEP][:GRID_COUNT]), flush=True)
    for name, sounds in readers.items():
        print(neutral(engine, name, sounds[:: max(1, len(sounds) // 25)][:25]), flush=True)


if __name__ == "__main__":
    run_command(main)
