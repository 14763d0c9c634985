"""Fits the emotion encoder to emodb_de and to readers' neutral speech, and measures it.

    python -m training.systems.emoface.train_emotion_encoder --data ../shared/data
    python -m training.systems.emoface.train_emotion_encoder --data ../shared/data --leave-one-out

The second command leaves out each of the ten actors in turn and fits to the others. It prints how often the
left-out actor's emotion is recognised at the end of a clip, from up to two seconds. Then it measures the
shipped model on the held-out actors and readings. Nothing is random.
"""

import argparse
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch

from training import shipped
from training.corpus.clip import read_sound
from training.corpus.emodb import read_acted
from training.nn.checkpoint import write_model
from training.systems.emoface.clips import load_emotion
from training.systems.emoface.emotion_encoder import HEARD_EMOTIONS, EmotionEncoder, fitted, numbers, voice_of

READERS = ("kathleen_en", "kerstin_de", "nathalie_nl", "picovoice_en")
SHRINKAGE = 0.1
TRAINING_INSTANTS = 2
"""Number of instants of each clip that the encoder learns from. They are the clip's last ones, so that the
encoder also learns windows shorter than `WINDOW`.
"""


@dataclass
class Measured:
    """A clip: `rows` [I, 118] are its numbers, `label` indexes `HEARD_EMOTIONS`."""

    speaker: str
    label: int
    rows: np.ndarray
    held_out: bool = False


def acted_clips(data: Path, limit: int | None = None) -> list[Measured]:
    """The clips of emodb_de that are long enough to measure."""
    clips = []
    for clip in read_acted(data, limit):
        rows = numbers(voice_of(clip.samples))
        if len(rows):
            clips.append(Measured(clip.actor, HEARD_EMOTIONS.index(clip.emotion), rows, clip.held_out))
    return clips


def readers(data: Path, count: int = 60) -> list[Measured]:
    """Neutral readings: `count` of each source, evenly spaced. Every other one is held out."""
    recordings = []
    for source in READERS:
        paths = sorted((data / "speech" / source).glob("*.ogg"))
        for k, path in enumerate(paths[:: max(1, len(paths) // count)][:count]):
            rows = numbers(voice_of(read_sound(path)))
            if len(rows):
                recordings.append(
                    Measured(source, 0, rows[:: max(1, len(rows) // TRAINING_INSTANTS)], k % 2 == 1)
                )
    return recordings


def fit(clips: list[Measured]) -> EmotionEncoder:
    """Fits the encoder to these clips."""
    rows = [(c.rows[-TRAINING_INSTANTS:], c.label) for c in clips]
    x = np.concatenate([r for r, _ in rows])
    labels = np.concatenate([np.full(len(r), label) for r, label in rows])
    return fitted(x, labels, SHRINKAGE)


def logits_of(model: EmotionEncoder, clips: list[Measured]) -> np.ndarray:
    """Logits at the end of each clip, [N, 7]."""
    x = (np.stack([c.rows[-1] for c in clips]) - model.mean) / model.scale
    return x @ model.weight + model.bias


def scores(logits: np.ndarray, labels: np.ndarray) -> dict[str, float]:
    """Share of right answers, its mean over the classes, and the share for joy against anger alone."""
    answers = logits.argmax(axis=1)
    angry, happy = HEARD_EMOTIONS.index("angry"), HEARD_EMOTIONS.index("happy")
    two = np.isin(labels, (angry, happy))
    between = np.where(logits[:, happy] > logits[:, angry], happy, angry)
    each = [float((answers[labels == k] == k).mean()) for k in sorted(set(labels.tolist()))]
    return {
        "right": float((answers == labels).mean()),
        "mean of classes": float(np.mean(each)),
        "joy or anger": float((between[two] == labels[two]).mean()),
    }


def without_neutral(clips: list[Measured]) -> list[Measured]:
    """The clips, less the mean numbers of their speaker's neutral clips."""
    out = []
    for clip in clips:
        group = [c.rows[-1] for c in clips if c.speaker == clip.speaker and c.label == 0]
        out.append(Measured(clip.speaker, clip.label, clip.rows - np.mean(group, axis=0), clip.held_out))
    return out


def leave_one_out(clips: list[Measured], others: list[Measured]) -> dict[str, float]:
    """Scores over all actors. Each actor is judged by an encoder that never heard him."""
    logits, labels = [], []
    for actor in sorted({c.speaker for c in clips}):
        group = [c for c in clips if c.speaker == actor]
        model = fit([c for c in clips if c.speaker != actor] + others)
        logits.append(logits_of(model, group))
        labels.append(np.array([c.label for c in group]))
    return scores(np.concatenate(logits), np.concatenate(labels))


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--data", type=Path, default=Path("../shared/data"))
    parser.add_argument("--models", type=Path, help="folder of models; none: the embedded ones")
    parser.add_argument("--leave-one-out", action="store_true", help="measure instead of writing the model")
    parser.add_argument("--limit", type=int, help="recordings of each half of the actors, for a quick look")
    arguments = parser.parse_args()
    clips, neutral = acted_clips(arguments.data, arguments.limit), readers(arguments.data)
    taught, unheard = ([c for c in neutral if c.held_out == held_out] for held_out in (False, True))
    folder = arguments.models / "emotion_encoder" if arguments.models else shipped("emotion_encoder")
    if arguments.leave_one_out:
        print("readers taught", leave_one_out(clips, taught))
        print("emodb_de alone", leave_one_out(clips, []))
        print("neutral voice known", leave_one_out(without_neutral(clips), []))
        report_held_out(load_emotion(folder), clips, unheard)
        return
    model = fit([c for c in clips if not c.held_out] + taught)
    state = {name: torch.from_numpy(getattr(model, name)).float()
             for name in ("mean", "scale", "coordinates", "weight", "bias")}  # fmt: skip
    print(write_model(folder, state, model.config.to_json(), exact=("",)))
    report_held_out(model, clips, unheard)


def report_held_out(model: EmotionEncoder, clips: list[Measured], unheard: list[Measured]) -> None:
    """Prints the scores of held-out actors, and how many held-out readings are neutral to the model."""
    test_clips = [c for c in clips if c.held_out]
    if test_clips:
        print(
            "actors held out", scores(logits_of(model, test_clips), np.array([c.label for c in test_clips]))
        )
    for source in READERS:
        group = [c for c in unheard if c.speaker == source]
        if group:
            share = (logits_of(model, group).argmax(axis=1) == 0).mean()
            print(source, f"classified as neutral: {share:.2f} of {len(group)}")


if __name__ == "__main__":
    main()
