"""Fits and measures the layer that reads emotions from the ear's network and the 118 numbers.

    python -m training.speech.train_emotion_ear --windows runs/ear/windows.pt --net runs/ear/net.pt
    python -m training.speech.train_emotion_ear --windows runs/ear/windows.pt --measure

Every actor's emotion is transferred to other speakers: its difference from his neutral voice is added to a
reader's neutral voice. So the layer cannot recognise an emotion by the recordings in which it occurs.
`--measure` writes no model. It reads the shipped one and judges each actor by a layer that was fitted to its
network without him; the shipped layer judges the held-out actors and readers. Only the choice of reader for
each acted clip is random, and it is seeded.
"""

from collections import Counter
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Annotated

import numpy as np
import torch
import torch.nn.functional as F

from training import shipped
from training.corpus.emodb import HELD_OUT, SOURCE
from training.flags import run_command
from training.nn.checkpoint import restored, write_model
from training.speech.emotion_ear import (
    ARRAYS,
    LARGEST,
    EmotionEarConfig,
    EmotionEarNet,
    EmotionLayer,
    read_ear,
    row_of,
)
from training.systems.emoface.emotion_encoder import HEARD_EMOTIONS, WINDOW, voice_of
from training.systems.emoface.train_emotion_encoder import scores

STRENGTH = 0.1
"""Factor on the loss of the data, beside the penalty 0.5 |W|² on the layer's weights."""
WEARERS, OWN_SHARE = 4, 0.5
"""Number of copies of each acted clip, each moved to another speaker's neutral voice, and the share of the
clip's weight that the original keeps. The copies divide the rest.
"""
ONE_VOICE = ("kathleen_en", "kerstin_de", "grid_s1", "kokoro")
"""Sources whose speakers are known. In the others every window counts as another speaker."""
TOWARDS_MEAN = 0.7
READER_SHARE = 0.3
LEAST_DEVIATION = 1e-4


class Rows:
    """Rows `x` [N, R] of all windows with their `label` [N], an index into `HEARD_EMOTIONS`.

    `row_of_samples` turns samples [S] at 16 kHz into a row [R].
    """

    def __init__(self, windows: Path, row_of_samples: Callable[[np.ndarray], np.ndarray]):
        saved = torch.load(windows)
        about = saved["about"]
        self.source = np.array([a["source"] for a in about])
        self.speaker = np.array([a["speaker"] for a in about])
        self.held_out = np.array([a["held_out"] for a in about])
        self.label = np.array([HEARD_EMOTIONS.index(a["emotion"]) for a in about])
        sounds = (s[: a["samples"]].numpy() for s, a in zip(saved["sounds"], about, strict=True))
        self.x = np.stack([row_of_samples(s.astype(np.float32) / 32768.0) for s in sounds])
        self.actor_rows = np.flatnonzero(self.source == SOURCE)
        self.readers = np.flatnonzero((self.source != SOURCE) & ~self.held_out)

    def neutral_voices(self) -> np.ndarray:
        """Neutral voices of speakers who are not actors, [speakers, R]."""
        voices = []
        for source in sorted(set(self.source[self.readers])):
            of_source = self.readers[self.source[self.readers] == source]
            if source in ONE_VOICE:
                means = [
                    self.x[of_source[self.speaker[of_source] == s]].mean(0)
                    for s in sorted(set(self.speaker[of_source]))
                ]
                voices += means if len(means) > 1 else 3 * means
            elif source != "espeak":
                middle = self.x[of_source].mean(0)
                voices += list(middle + TOWARDS_MEAN * (self.x[of_source] - middle))
        return np.array(voices)


def heard_row(net: EmotionEarNet, samples: np.ndarray) -> np.ndarray:
    """The row [told + 118] of two seconds of sound [S]."""
    voice = voice_of(samples)
    end = len(voice.mel)
    return row_of(net, voice, max(end - WINDOW, 0), end)


def fitted(rows: Rows, actor_rows: np.ndarray, seed: int = 0) -> EmotionLayer:
    """Fits the layer to the actors' clips and to all readers who are not held out.

    `actor_rows` are indices of rows.
    """
    random = np.random.default_rng(seed)
    neutral = {
        actor: rows.x[actor_rows[(rows.speaker[actor_rows] == actor) & (rows.label[actor_rows] == 0)]].mean(0)
        for actor in set(rows.speaker[actor_rows])
    }
    offset = rows.x[actor_rows] - np.array([neutral[actor] for actor in rows.speaker[actor_rows]])
    voices = rows.neutral_voices()
    worn = [offset + voices[random.integers(len(voices), size=len(actor_rows))] for _ in range(WEARERS)]
    x = np.concatenate([rows.x[actor_rows], *worn, rows.x[rows.readers]])
    labels = np.concatenate([np.tile(rows.label[actor_rows], 1 + WEARERS), rows.label[rows.readers]])
    weight = np.concatenate([
        np.full(len(actor_rows), OWN_SHARE), np.full(len(actor_rows) * WEARERS, (1.0 - OWN_SHARE) / WEARERS),
        np.full(len(rows.readers), READER_SHARE),
    ])  # fmt: skip
    for k in range(len(HEARD_EMOTIONS)):
        weight[labels == k] *= len(actor_rows) / len(HEARD_EMOTIONS) / weight[labels == k].sum()
    mean, scale = x.mean(0), x.std(0) + LEAST_DEVIATION
    matrix, bias = logistic(((x - mean) / scale).clip(-LARGEST, LARGEST), labels, weight)
    return EmotionLayer(mean, scale, matrix, bias, voices.mean(0))


def logistic(x: np.ndarray, labels: np.ndarray, weight: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Multinomial logistic regression: matrix [C, 7] and bias [7]."""
    data, targets, weights = torch.from_numpy(x), torch.from_numpy(labels), torch.from_numpy(weight)
    matrix = torch.zeros(x.shape[1], len(HEARD_EMOTIONS), dtype=torch.float64, requires_grad=True)
    bias = torch.zeros(len(HEARD_EMOTIONS), dtype=torch.float64, requires_grad=True)
    optimiser = torch.optim.LBFGS([matrix, bias], max_iter=80, line_search_fn="strong_wolfe")

    def loss() -> torch.Tensor:
        optimiser.zero_grad()
        errors = F.cross_entropy(data @ matrix + bias, targets, reduction="none")
        total = STRENGTH * (weights * errors).sum() + 0.5 * matrix.square().sum()
        total.backward()
        return total

    optimiser.step(loss)
    return matrix.detach().numpy(), bias.detach().numpy()


def leave_one_out(rows: Rows) -> dict[str, float]:
    """Scores of every actor under a layer that was fitted without him."""
    logits = np.zeros((len(rows.actor_rows), len(HEARD_EMOTIONS)))
    for actor in sorted(set(rows.speaker[rows.actor_rows])):
        is_own = rows.speaker[rows.actor_rows] == actor
        layer = fitted(rows, rows.actor_rows[~is_own])
        logits[is_own] = layer.logits(rows.x[rows.actor_rows[is_own]])
    return scores(logits, rows.label[rows.actor_rows])


def main(
    windows: Annotated[Path, "windows.pt of training.speech.emotion_windows"],
    net: Annotated[Path | None, "net.pt of training.speech.distil_emotion; none: the model's own"] = None,
    models: Annotated[Path | None, "folder of models; none: the embedded ones"] = None,
    measure: Annotated[bool, "measure instead of writing the model"] = False,
) -> None:
    """Command line."""
    folder = models / "emotion_ear" if models else shipped("emotion_ear")
    network = read_ear(folder).net if net is None else read_net(net)
    rows = Rows(windows, partial(heard_row, network))
    if measure:
        print("an actor left out", leave_one_out(rows))
        report_held_out(rows, read_ear(folder))
        return
    left = np.isin(rows.speaker[rows.actor_rows], HELD_OUT)
    layer = fitted(rows, rows.actor_rows[~left])
    state = {name: torch.from_numpy(x).float() for name, x in layer.arrays().items()} | network.state_dict()
    print(write_model(folder, state, network.config.to_json(), exact=ARRAYS))
    report_held_out(rows, layer)


def read_net(path: Path) -> EmotionEarNet:
    """The network of a `net.pt`."""
    saved = torch.load(path)
    return restored(EmotionEarNet(EmotionEarConfig.from_json(saved["config"])), saved["state"])


def report_held_out(rows: Rows, layer: EmotionLayer) -> None:
    """Prints the scores of held-out actors and readers."""
    left = np.isin(rows.speaker[rows.actor_rows], HELD_OUT)
    print(
        "actors held out",
        scores(layer.logits(rows.x[rows.actor_rows[left]]), rows.label[rows.actor_rows[left]]),
    )
    strangers = rows.held_out & (rows.source != SOURCE)
    for source, count in Counter(rows.source[strangers]).items():
        logits = layer.logits(rows.x[strangers & (rows.source == source)])
        neutral = torch.from_numpy(logits).softmax(dim=1)[:, 0].numpy()
        doubted = np.mean(neutral < 0.4)
        print(f"{source}: {count} windows, neutral {neutral.mean():.2f}, under 0.4 {doubted:.3f}")


if __name__ == "__main__":
    run_command(main)
