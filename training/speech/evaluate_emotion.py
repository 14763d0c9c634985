"""Measures which emotion the library hears in whole recordings that no training heard.

    python -m training.speech.evaluate_emotion --data ../shared/data --anyface target/release/anyface

Acted clips are those of the held-out actors of both corpora. A recording shows something if the probability
of all emotions together exceeds a threshold at any moment. It counts as the emotion whose mean probability
is largest. Readings are those of held-out readers.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from training.corpus import crema_d, emodb
from training.engine import Engine
from training.flags import run_command
from training.systems.emoface.evaluate_voices import likeliest

THRESHOLDS = (0.6, 0.7)
"""From the first one a face shows something, at the second one a fifth of the strength."""
READINGS = {
    "clips/librivox": (0, 1), "speech/nathalie_nl": (0, 25), "speech/picovoice_en": (1, 16),
    "motion/grid_s1/audio": (9, 30),
}  # fmt: skip
"""Folders of held-out readings: the first one in use, and how many files further the next one is."""


@dataclass
class Heard:
    """The largest probability of any emotion at any moment, and the emotion that is likeliest on average."""

    largest: float
    emotion: str


def heard(engine: Engine, sound: Path) -> Heard:
    """What the library hears in a recording."""
    _, report = engine.run_with_report("motion", "--audio", sound, "--emotion", "auto", "--fps", 5)
    probability = report["heard_emotion"]["probability"]
    return Heard(1.0 - min(probability["neutral"], default=1.0), likeliest(probability))


def line(name: str, clips: list[tuple[str, Heard]]) -> str:
    """How many acted clips of a corpus show something, and how many of these as acted."""
    parts, emotions = [], [emotion for emotion, _ in clips]
    for threshold in THRESHOLDS:
        shown = [(emotion, one) for emotion, one in clips if one.largest > threshold]
        felt = [one.emotion == emotion for emotion, one in shown if emotion != "neutral"]
        calm, acted = emotions.count("neutral"), len(emotions) - emotions.count("neutral")
        neutral = (len(shown) - len(felt)) / max(calm, 1)
        parts.append(
            f"above {threshold}: acted {len(felt) / max(acted, 1):.2f}, of them as acted "
            f"{np.mean(felt) if felt else 0.0:.2f}, acted as neutral {neutral:.2f}"
        )
    return f"{name}, {len(emotions)} clips; " + "; ".join(parts)


def main(data: Path, anyface: Path) -> None:
    """Command line."""
    engine = Engine(anyface)
    for corpus in (crema_d, emodb):
        clips = [(emotion, heard(engine, sound)) for _, emotion, sound in corpus.held_out_clips(data)]
        print(line(corpus.SOURCE, clips), flush=True)
    every = []
    for folder, (first, step) in READINGS.items():
        sounds = sorted(path for path in (data / folder).iterdir() if path.suffix in (".ogg", ".wav"))
        of = np.array([heard(engine, sound).largest for sound in sounds[first::step]])
        every += list(of)
        print(f"{folder}, {len(of)} readings; " + shares(of), flush=True)
    print(f"all readings, {len(every)}; " + shares(np.array(every)))


def shares(largest: np.ndarray) -> str:
    """How many readings exceed each threshold."""
    return ", ".join(f"above {threshold}: {(largest > threshold).mean():.3f}" for threshold in THRESHOLDS)


if __name__ == "__main__":
    run_command(main)
