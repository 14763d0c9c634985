"""Measures whether the ear for emotion gains from a neutral recording of the same person.

    python -m training.speech.neutral_voice --data ../shared/data --windows runs/ear/windows.pt

Each recording of emodb_de is judged with 0, 2, 10 or 20 seconds of other neutral recordings of its actor. A
layer fitted without the actor judges it. The shipped layer judges the two held-out actors and recordings of
other speakers, some of them also played slower to lower their voices. An emotion counts as shown if its
intensity exceeds 0.1 at any moment.

`--write` measures nothing. It puts the mean neutral voice of `windows` into the shipped model as `readers`
and leaves all other arrays as they are.
"""

from collections import defaultdict
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Annotated

import numpy as np
import torch
from safetensors.torch import load, save
from scipy.signal import resample_poly

from training import shipped
from training.corpus.clip import read_sound
from training.corpus.emodb import HELD_OUT, read_acted
from training.flags import run_command
from training.nn.checkpoint import PACKED, pack, read_bytes
from training.speech.emotion_ear import (
    EmotionEar,
    EmotionEarNet,
    EmotionLayer,
    neutral_offset,
    neutral_voice,
    read_ear,
    row_of,
)
from training.speech.emotion_windows import SAMPLES
from training.speech.log_mel import SAMPLE_RATE_HZ
from training.speech.train_emotion_ear import Rows, fitted, heard_row
from training.systems.emoface.emotion_encoder import HEARD_EMOTIONS, WINDOW, voice_of

SECONDS = (0.0, 2.0, 10.0, 20.0)
"""Lengths of neutral voice to compare, in seconds. 0 means none."""
DRAWS = 4
"""Number of random draws of neutral recordings for each judged recording."""
BEFORE, BEFORE_NEUTRAL = 0.3, 3.0
AROUND, WHOLE_SHARE = 3, 0.5
FLOOR, FULL = 0.7, 0.95
SHOWN = 0.1
"""An emotion counts as shown above this intensity.

`BEFORE` to `WHOLE_SHARE` are the constants of `rust-core/src/speech/emotion_ear/layer.rs`; `FLOOR` and `FULL`
are those of `rust-core/src/speech/shown_emotion.rs`.
"""
RECORDINGS = (
    ("motion/grid_s1/audio", 25, 40), ("speech/kathleen_en", 40, 30), ("speech/kerstin_de", 20, 30),
    ("speech/picovoice_en", 10, 60), ("speech/nathalie_nl", 30, 40), ("clips/librivox", 1, 5),
    ("clips", 1, 5),
)  # fmt: skip
"""Folders of recordings, n (every n-th recording is measured), and the largest number of recordings.

`clips` holds four acted clips and a public speech. The others are neutral readings.
"""
RECORDING_S = 6
"""The first seconds of each recording that are measured."""
READERS = {"grid_s1": ("motion/grid_s1/audio", 22), "nathalie_nl": ("speech/nathalie_nl", 28)}
"""Folder of each reader, and n: every n-th recording in it is used."""
SLOWER = {"as they are": (1, 1), "a major third lower": (5, 4), "a fourth lower": (4, 3)}
LONGEST_S = 5
JOY, ANGER = HEARD_EMOTIONS.index("happy"), HEARD_EMOTIONS.index("angry")


@dataclass
class Heard:
    """A recording: its `rows` [I, told + 118] over time with their `weight` [I], the row `first` [told + 118]
    of its first two seconds, the index of its emotion, and its length."""

    first: np.ndarray
    rows: np.ndarray
    weight: np.ndarray
    emotion: int
    seconds: float


def heard_of(net: EmotionEarNet, samples: np.ndarray, emotion: int = 0) -> Heard:
    """Computes what the ear hears of a recording over time."""
    samples = samples.astype(np.float32)
    rows, weight = neutral_voice(net, voice_of(samples))
    start = voice_of(samples[:SAMPLES])
    first = row_of(net, start, max(len(start.mel) - WINDOW, 0), len(start.mel))
    return Heard(first, rows, weight, emotion, len(samples) / SAMPLE_RATE_HZ)


def offset_of(others: list[Heard], seconds: float, readers: np.ndarray, random) -> np.ndarray | float:
    """Offset [told + 118] to add to rows, from this many seconds of neutral recordings. Whole recordings are
    drawn until their total length suffices."""
    recordings, got = [], 0.0
    for k in random.permutation(len(others)):
        if got >= seconds:
            break
        recordings.append(others[k])
        got += others[k].seconds
    weight = np.concatenate([other.weight for other in recordings] or [np.zeros(0)])
    if weight.sum() == 0.0:
        return 0.0
    return neutral_offset(np.concatenate([other.rows for other in recordings]), weight, readers)


def probabilities(ear: EmotionLayer, rows: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """Probabilities of the emotions over time, [I, 7], from the time near each moment and the whole sound."""
    logits = ear.logits(rows)
    before = BEFORE_NEUTRAL * (np.arange(logits.shape[1]) == 0)

    def evidence(part: slice) -> np.ndarray:
        return (BEFORE * before + weight[part] @ logits[part]) / (BEFORE + weight[part].sum())

    whole = evidence(slice(None))
    near = [evidence(slice(max(k - AROUND, 0), k + AROUND + 1)) for k in range(len(logits))]
    mixed = WHOLE_SHARE * whole + (1.0 - WHOLE_SHARE) * np.array(near).reshape(-1, logits.shape[1])
    return torch.from_numpy(mixed).softmax(dim=1).numpy()


def shown(shares: np.ndarray) -> tuple[float, int]:
    """The largest intensity at any moment of `shares` [I, 7], and the emotion that shows most."""
    above = ((1.0 - shares[:, 0] - FLOOR) / (FULL - FLOOR)).clip(0.0, 1.0)
    intensity = above * above * (3.0 - 2.0 * above)
    power = shares[:, 1:] ** 2
    power = power / power.sum(axis=1, keepdims=True)
    return float(intensity.max(initial=0.0)), 1 + int((power * intensity[:, None]).sum(axis=0).argmax())


def shown_of(ear: EmotionEar, samples: np.ndarray) -> tuple[float, int]:
    """`shown` of samples [S] at 16 kHz."""
    heard = heard_of(ear.net, samples)
    return shown(probabilities(ear, heard.rows, heard.weight)) if len(heard.rows) else (0.0, 0)


class Count:
    """Counts how often a condition holds."""

    def __init__(self):
        self.right, self.all = 0, 0

    def add(self, is_so: bool) -> None:
        """Counts one case."""
        self.right, self.all = self.right + bool(is_so), self.all + 1

    def __str__(self):
        return f"{100 * self.right / max(self.all, 1):.1f} %"


def judge(
    actors: dict[str, list[Heard]], ear_of: Callable[[str], EmotionLayer], seconds: float
) -> dict[str, Count]:
    """Scores of actors' recordings: seven classes and joy against anger in the first two seconds, and the
    emotions shown over time."""
    counts: dict[str, Count] = defaultdict(Count)
    for draw in range(DRAWS if seconds else 1):
        random = np.random.default_rng(draw)
        for actor, clips in actors.items():
            ear, neutral = ear_of(actor), [clip for clip in clips if clip.emotion == 0]
            for clip in (clip for clip in clips if len(clip.rows)):
                others = [other for other in neutral if other is not clip]
                offset = offset_of(others, seconds, ear.readers, random)
                first = ear.logits(clip.first + offset)
                counts["seven classes"].add(first.argmax() == clip.emotion)
                if clip.emotion in (JOY, ANGER):
                    counts["joy from anger"].add((first[JOY] > first[ANGER]) == (clip.emotion == JOY))
                intensity, most = shown(probabilities(ear, clip.rows + offset, clip.weight))
                if clip.emotion == 0:
                    counts["neutral clips that show an emotion"].add(intensity > SHOWN)
                else:
                    counts["acted emotions shown"].add(intensity > SHOWN)
                    counts["shown correctly"].add(intensity > SHOWN and most == clip.emotion)
    return counts


def recordings(data: Path, measure: Callable[[np.ndarray], tuple[float, int]]) -> Iterable[str]:
    """Tells how many of `RECORDINGS` show an emotion, and which. `measure` computes `shown` of samples."""
    for folder, step, limit in RECORDINGS:
        sounds = sorted(p for p in (data / folder).iterdir() if p.suffix in (".ogg", ".wav"))
        paths = sounds[::step][:limit]
        cut = (read_sound(path)[: RECORDING_S * SAMPLE_RATE_HZ].astype(np.float32) for path in paths)
        emotions = [measure(samples) for samples in cut]
        names = [
            f"{path.stem} as {HEARD_EMOTIONS[most]} {intensity:.2f}"
            for path, (intensity, most) in zip(paths, emotions, strict=True)
            if intensity > SHOWN
        ]
        yield " ".join([f"{folder}: {len(names)} of {len(paths)} are shown", *names])


def strangers(net: EmotionEarNet, ear: EmotionEar, data: Path) -> Iterable[str]:
    """Tells how many readings show an emotion, for each number of seconds of the reader's own voice."""
    for source, (folder, step) in READERS.items():
        sounds = [read_sound(path) for path in sorted((data / folder).glob("*.ogg"))[::step]]
        for how, (up, down) in SLOWER.items():
            cut = [resample_poly(sound[: SAMPLE_RATE_HZ * LONGEST_S], up, down) for sound in sounds]
            clips = [heard_of(net, sound) for sound in cut]
            counts = []
            for seconds in SECONDS:
                random, count = np.random.default_rng(0), Count()
                for clip in (clip for clip in clips if len(clip.rows)):
                    others = [other for other in clips if other is not clip]
                    rows = clip.rows + offset_of(others, seconds, ear.readers, random)
                    count.add(shown(probabilities(ear, rows, clip.weight))[0] > SHOWN)
                counts.append(f"{seconds:.0f} s {count.right}")
            yield f"  {source}, {how}: of {count.all} are shown with " + ", ".join(counts)


def write_readers(folder: Path, readers: np.ndarray) -> None:
    """Adds or replaces `readers` in a shipped model. All other arrays stay as they are."""
    state = load(read_bytes(folder)) | {"readers": torch.from_numpy(readers).float()}
    (folder / PACKED).write_bytes(pack(save(state)))


def main(
    data: Path,
    windows: Annotated[Path, "windows.pt of training.speech.emotion_windows"],
    write: Annotated[bool, "put `readers` into the shipped model instead of measuring"] = False,
) -> None:
    """Command line."""
    folder = shipped("emotion_ear")
    ear = read_ear(folder)
    net = ear.net
    rows = Rows(windows, partial(heard_row, net))
    if write:
        write_readers(folder, rows.neutral_voices().mean(axis=0))
        return
    actors: dict[str, list[Heard]] = defaultdict(list)
    for clip in read_acted(data):
        actors[clip.actor].append(heard_of(net, clip.samples, HEARD_EMOTIONS.index(clip.emotion)))
    speaker = rows.speaker[rows.actor_rows]
    ears = {actor: fitted(rows, rows.actor_rows[speaker != actor]) for actor in actors}
    held_out = {actor: actors[actor] for actor in HELD_OUT}
    for name, judged, ear_of in (
        ("an actor left out", actors, ears.__getitem__),
        ("actors held out", held_out, lambda _: ear),
    ):
        clips = [clip for group in judged.values() for clip in group]
        print(f"{name}: {len(clips)} clips, {sum(clip.emotion == 0 for clip in clips)} of them neutral")
        for seconds in SECONDS:
            results = judge(judged, ear_of, seconds).items()
            print(f"{name}, {seconds:.0f} s:", ", ".join(f"{what} {count}" for what, count in results))
    for text in recordings(data, partial(shown_of, ear)):
        print(text, flush=True)
    for text in strangers(net, ear, data):
        print(text, flush=True)


if __name__ == "__main__":
    run_command(main)
