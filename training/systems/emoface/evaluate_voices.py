"""Measures the emotion that EmoFace shows for borrowed emotional voices and for calm readers.

    python -m training.systems.emoface.evaluate_voices --data ../shared/data --anyface target/release/anyface

Two people who are neutral in all training data (a man of grid_s1, a woman of nathalie_nl) say a line. The
emotion comes from recordings of emodb_de's two held-out actors (`--emotion-of`). The motion is compared with
the same line without an emotion, in mm on a human head: how far the brows and the corners of the mouth rise,
and r of the lip gap. A face counts as the emotion whose face under `--emotion` has the most similar direction
in the mean over frames. A neutral reading shows an emotion in frames where a brow or a lid is more than 1.5
mm from the same reading without an emotion.
"""

import tempfile
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import soundfile

from training.corpus.clip import read_sound
from training.corpus.emodb import SOURCE, read_acted
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
SEEN_MM = 1.5
GRID_STEP, GRID_COUNT = 20, 40
"""Every twentieth clip of grid_s1 is used, at most 40. All of these are held out."""


def motion(engine: Engine, sound: Path, *more) -> np.ndarray:
    """Landmark displacements for a sound, [T, 68, 3] mm."""
    arrays = engine.run("motion", "--audio", sound, *STILL, *more)
    return arrays["landmark_displacements"].astype(float) * 1e3


def gap(moved: np.ndarray) -> np.ndarray:
    """Lip gap, [T]."""
    return moved[:, 62, 1] - moved[:, 66, 1]


def borrowed(engine: Engine, data: Path, line: Path, limit: int) -> Iterator[str]:
    """Scores a line with the emotion of other recordings, at most `limit` for each emotion."""
    plain = motion(engine, line, "--emotion-from", "off")
    faces = {name: (motion(engine, line, "--emotion", f"{name}:1") - plain).mean(axis=0) for name in SHOWN}
    rows, right = defaultdict(list), []
    for clip in read_acted(data):
        if not clip.held_out or clip.emotion not in SHOWN or len(rows[clip.emotion]) == limit:
            continue
        moved = motion(engine, line, "--emotion-of", data / "speech" / SOURCE / f"{clip.name}.ogg")
        face = (moved - plain).mean(axis=0)
        r = np.corrcoef(gap(moved), gap(plain))[0, 1]
        rows[clip.emotion].append((face[BROWS, 1].mean(), face[CORNERS, 1].mean(), r))
        nearest = min(faces, key=lambda name: angle(face, faces[name]))
        right.append(nearest == clip.emotion)
    for name in SHOWN:
        brows, corners, r = np.mean(rows[name], axis=0)
        by_hand = faces[name][BROWS, 1].mean(), faces[name][CORNERS, 1].mean()
        yield (f"  {name:10s} {len(rows[name])} recordings: brows {brows:.1f} (by name {by_hand[0]:.1f}), "
               f"corners {corners:.1f} (by name {by_hand[1]:.1f}), lips r {r:.3f}")  # fmt: skip
    yield f"  the face is that of the recording's emotion in {100 * np.mean(right):.0f} % of {len(right)} "
    yield "  (chance 20 %)"


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


def main(data: Path, anyface: Path, limit: int = 8) -> None:
    """Command line."""
    engine = Engine(anyface)
    grid = sorted((data / "motion/grid_s1/audio").glob("*.ogg"))
    readers = {
        name: sorted((data / "speech" / name).glob("*.ogg"))
        for name in ("nathalie_nl", "kathleen_en", "kerstin_de")
    }
    for line in (grid[0], readers["nathalie_nl"][0]):
        print(line.stem)
        for text in borrowed(engine, data, line, limit):
            print(text, flush=True)
    print(neutral(engine, "grid_s1", grid[::GRID_STEP][:GRID_COUNT]), flush=True)
    for name, sounds in readers.items():
        print(neutral(engine, name, sounds[:: max(1, len(sounds) // 25)][:25]), flush=True)


if __name__ == "__main__":
    run_command(main)
