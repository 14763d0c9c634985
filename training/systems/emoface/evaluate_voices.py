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

import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path

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


def acted(data: Path) -> Iterator[Acted]:
    """Recordings of actors whom no training heard, with an emotion or neutral."""
    for corpus in (crema_d, emodb):
        for _, clips in groupby(corpus.held_out_clips(data), key=lambda clip: clip[0]):
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


class Borrowing:
    """One line under the emotions of recordings, [T, 68, 3] mm each. Each recording is heard once."""

    def __init__(self, engine: Engine, line: Path):
        self.engine, self.line = engine, line
        self.plain = motion(engine, line, "--emotion-from", "off")
        self._under: dict[Path | None, tuple[np.ndarray, Heard | None]] = {None: (self.plain, None)}

    def under(self, sound: Path | None) -> tuple[np.ndarray, Heard | None]:
        """`swap` with a recording; the plain line without one."""
        if sound not in self._under:
            self._under[sound] = swap(self.engine, self.line, sound)
        return self._under[sound]

    def named(self, emotion: str, intensity: float) -> np.ndarray:
        """Mean change of the face [68, 3] by an emotion by name."""
        return self.change(motion(self.engine, self.line, "--emotion", f"{emotion}:{intensity:.3f}"))

    def change(self, moved: np.ndarray) -> np.ndarray:
        """Mean change of the face [68, 3] against the plain line."""
        return (moved - self.plain).mean(axis=0)


def borrowed(line: Borrowing, recordings: list[Acted]) -> Iterator[Borrowed]:
    """Scores a line with the emotion of recordings."""
    faces = {name: line.named(name, 1.0) for name in SHOWN}
    for recording in recordings:
        (moved, heard), (neutral, _) = line.under(recording.sound), line.under(recording.neutral)
        nearest = min(faces, key=lambda name: angle(line.change(moved), faces[name]))
        shown = rise((moved - neutral).mean(axis=0))
        by_name = rise(line.named(heard.emotion, heard.intensity))
        lips = float(np.corrcoef(gap(moved), gap(line.plain))[0, 1])
        yield Borrowed(recording, heard, shown, by_name, lips, nearest == recording.emotion)


def neutral_borrowed(line: Borrowing, recordings: list[Acted]) -> list[float]:
    """How far a line's brows or corners move under neutral recordings, mm each."""
    return [max(map(abs, rise(line.change(line.under(one.sound)[0])))) for one in recordings]


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
    for sound in (grid[0], readers["nathalie_nl"][0]):
        line = Borrowing(engine, sound)
        moved += neutral_borrowed(line, calm)
        rows += borrowed(line, [one for one in recordings if one.emotion != "neutral"])
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
