"""What a performer is learned from in Blender, and the sentence that says what it does."""

import os
import re
import wave
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from .errors import AnyfaceError
from .job import Progress
from .source import Decode, MixedSource, SoundSource
from .space import FaceSpace
from .take import Sound

SUFFIX = ".performer"
# Jaw and mouth, from which performers are learned (iBUG 300-W).
_SPEAKING = [*range(17), *range(48, 68)]
# Bridge of the nose and corners of the eyes, which hardly move but with the head.
_STEADY = [*range(27, 31), 36, 39, 42, 45]
# The steady landmarks move farther than this only if the head turns, mm on a head of human size.
_HEAD_MM = 2.0
# Between the outer corners of the eyes of a grown-up.
_BETWEEN_EYES_MM = 90.0
# A correction moves a landmark by more than this, mm: fewer keys and a basis miss by less.
_CORRECTION_MM = 0.5
# If more frames than this share differ, the take was made with other settings, or anew.
_MOST_CORRECTED = 0.5
# Corrected frames count as much as all others together, but each at most this many times.
_MOST_COUNT = 16.0
# A smaller change of how far something moves is not worth a word.
_LEAST_CHANGE = 0.05
# What a performer does more, and what it does less, by aspect.
_WORDS = {
    "gap": ("opens the mouth {} wider", "opens the mouth {} less"),
    "width": ("moves the corners {} more", "moves the corners {} less"),
    "chin": ("drops the jaw {} deeper", "drops the jaw {} less"),
    "protrusion": ("pushes the lips out {} more", "pushes the lips out {} less"),
}


@dataclass
class FaceMotion:
    """How a face moved: the landmarks at `rest` `[68, 3]` and their `displacements` `[T, 68, 3]` in
    object space, the vertices `[68]` at which they lie, `fps` and the `space` of the object."""

    rest: np.ndarray
    displacements: np.ndarray
    vertices: np.ndarray
    fps: float
    space: FaceSpace


@dataclass
class Lesson:
    """Learns a performer in the worker thread and writes it to `path`.

    `name` stands in the card and in messages. The motion is `motion`, or lies in `motion_file`. If
    the face has a take of this add-on, `snapshot` makes it once more, as it was before the artist
    corrected it.
    """

    path: Path
    name: str
    source: SoundSource | MixedSource
    decode: Decode
    engine: Any
    motion: FaceMotion | None = None
    motion_file: str = ""
    snapshot: Any = None

    def work(self, progress: Progress) -> str:
        """Learns; returns the sentence of `describe`. Raises `AnyfaceError`, or `Cancelled`."""
        progress.check("sound")
        voice = self.source.load(self.decode)
        arrays, is_correction = self._arrays(progress)
        with TemporaryDirectory(prefix="anyface-") as folder:
            sound_file = Path(folder, "sound.wav")
            write_sound(sound_file, voice)
            motion_file = self.motion_file or Path(folder, f"{self.name}.npz")
            if arrays:
                np.savez(motion_file, **arrays)
            check_free(self.path)
            takes = [(sound_file, motion_file)]
            try:
                card = self.engine.learn_performer(takes, str(self.path), progress)
            except AnyfaceError as error:
                text = str(error).replace(folder + os.sep, "")
                raise AnyfaceError(error.kind, text, error.mends) from error
        return describe(card, is_correction)

    def _arrays(self, progress: Progress) -> tuple[dict, bool]:
        """The arrays of the motion's file, and whether they are corrections of a take."""
        motion = self.motion
        if motion is None:
            return {}, False
        shown, generated, counts = motion.displacements, None, None
        if self.snapshot is not None:
            generated = generate_again(self.snapshot, motion.vertices, progress)
            frames = min(len(shown), len(generated))
            shown, generated = shown[:frames], generated[:frames]
            corrected = find_corrections(shown, generated, mm_per_unit(motion.rest))
            if not corrected.any():
                raise AnyfaceError(
                    "input",
                    f"{self.name}: the take is as it was generated: correct the mouth by hand in "
                    "some words first",
                )
            if corrected.mean() > _MOST_CORRECTED:
                generated = None
            else:
                generated[~corrected] = shown[~corrected]
                counts = counts_of(corrected)
        arrays = {
            "landmarks_neutral": motion.space.points(motion.rest),
            "landmark_displacements": motion.space.moved(shown),
            "fps": motion.fps,
        }
        if generated is None:
            return arrays, False
        more = {"generated_displacements": motion.space.moved(generated), "frame_weights": counts}
        return arrays | more, True


def generate_again(snapshot, vertices: np.ndarray, progress: Progress) -> np.ndarray:
    """The displacements of the landmarks of a take as it was generated, `[T, 68, 3]` in object
    space."""
    take = snapshot.work(progress)
    moves = snapshot.plan.moves(take)
    if moves is None:
        moved = take.motion.displacements[:, vertices]
    else:
        moved = np.einsum("tk,kvc->tvc", take.motion.weights, moves[:, vertices])
    return np.array(moved, dtype=np.float32)


def mm_per_unit(rest: np.ndarray) -> float:
    """How many mm an object unit is if the landmarks `rest` `[68, 3]` are those of a human."""
    return _BETWEEN_EYES_MM / max(float(np.linalg.norm(rest[36] - rest[45])), 1e-9)


def find_corrections(shown: np.ndarray, generated: np.ndarray, unit_mm: float) -> np.ndarray:
    """Marks `[T]` the frames in which jaw or mouth is not where it was generated."""
    apart = np.linalg.norm((shown - generated)[:, _SPEAKING], axis=2).max(axis=1)
    return apart * unit_mm > _CORRECTION_MM


def counts_of(corrected: np.ndarray) -> np.ndarray:
    """How much each frame `[T]` counts: those `corrected` together as much as all others."""
    balance = (~corrected).sum() / max(corrected.sum(), 1)
    return np.where(corrected, np.clip(balance, 1.0, _MOST_COUNT), 1.0).astype(np.float32)


def without_head(moved: np.ndarray, rest: np.ndarray) -> np.ndarray:
    """Takes the motion of the head off displacements `[T, 68, 3]`, if there is any.

    The head moves as the steady landmarks do, best in the least squares (Kabsch 1976).
    """
    farthest = np.linalg.norm(moved[:, _STEADY], axis=2).max(initial=0.0)
    if farthest * mm_per_unit(rest) < _HEAD_MM:
        return moved
    places, centre = rest + moved, rest[_STEADY].mean(axis=0)
    still = np.empty_like(moved)
    for t, place in enumerate(places):
        middle = place[_STEADY].mean(axis=0)
        left, _, right = np.linalg.svd((place[_STEADY] - middle).T @ (rest[_STEADY] - centre))
        side = np.diag([1.0, 1.0, np.sign(np.linalg.det(left @ right))])
        still[t] = (place - middle) @ (left @ side @ right) + centre - rest
    return still


def describe(card: dict, is_correction: bool = False) -> str:
    """What a performer does otherwise than the model, in a sentence."""
    scores = {score["name"]: score for score in card["scores"] if score["name"] in _WORDS}
    changes = {name: _moves(score) - 1.0 for name, score in scores.items()}
    largest = sorted(changes, key=lambda name: -abs(changes[name]))[:2]
    said = [
        _WORDS[name][changes[name] < 0.0].format(f"{abs(changes[name]):.0%}".replace("%", " %"))
        for name in largest
        if abs(changes[name]) >= _LEAST_CHANGE
    ]
    text = " and ".join(said) or "moves the mouth as far as the model, at other times"
    best = max(scores.values(), key=lambda score: score["r"] - score["r_without"])
    alone = "the take as generated" if is_correction else "the model alone"
    who = "corrected take" if is_correction else "take"
    follows = f"follows the {who} {best['r']:.2f} where {alone} follows {best['r_without']:.2f}"
    text = f"{text}; {follows}"
    late = [take["lag_s"] for take in card["takes"] if take["lag_s"]]
    return text + (f"; it was {late[0]:.2f} s behind its sound, taken off" if late else "")


def _moves(score: dict) -> float:
    """How many times as far as the model a performer moves something; 1 if that is not known."""
    if min(score["r"], score["r_without"]) < _LEAST_CHANGE or score["slope_without"] <= 0.0:
        return 1.0
    with_it, without = score["slope"] / score["r"], score["slope_without"] / score["r_without"]
    return min(with_it / without, 9.99)


def write_sound(path: Path, sound: Sound) -> None:
    """Writes a mono WAV of 16 bits."""
    samples = np.clip(sound.samples, -1.0, 1.0) * 32767.0
    with wave.open(str(path), "wb") as file:
        file.setnchannels(1)
        file.setsampwidth(2)
        file.setframerate(round(sound.rate_hz))
        file.writeframes(samples.astype("<i2").tobytes())


def file_name(name: str) -> str:
    """A file name for a performer: "Kim, loud" becomes "Kim_loud.performer".

    Raises `AnyfaceError("input")` for a name without letters and digits.
    """
    stem = re.sub(r"\W+", "_", name).strip("_")
    if not stem:
        text = f"performer: expected a name with letters or digits, got {name!r}"
        raise AnyfaceError("input", text)
    return stem[:80] + SUFFIX


def check_free(path: Path) -> None:
    """Raises `AnyfaceError("file")` if there is a file already."""
    if path.exists():
        text = f"{path.name} exists already: choose another name, or delete it in the menu first"
        raise AnyfaceError("file", text)


def in_folder(folder: Path | None) -> list[Path]:
    """The performers of a folder, sorted by name."""
    files = folder.glob(f"*{SUFFIX}") if folder is not None and folder.is_dir() else ()
    return sorted(files, key=lambda path: path.name.lower())
