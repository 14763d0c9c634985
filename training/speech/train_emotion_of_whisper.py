"""Fits and measures the layer that reads emotions from Whisper base's features of a voice.

    python -m training.speech.train_emotion_of_whisper --windows runs/ear/windows.pt \
        --whisper runs/whisper-base

`training.speech.train_emotion_ear` fits such a layer to the small network that learned from Whisper. This
layer is fitted to Whisper itself, in the same way on the same windows. `--measure` writes no model. It judges
each actor by a layer fitted without him, and other speakers by the shipped layer.
"""

from collections import defaultdict
from functools import partial
from pathlib import Path
from typing import Annotated

import numpy as np
import torch

from training import shipped
from training.corpus.emodb import HELD_OUT, read_acted
from training.flags import run_command
from training.nn.checkpoint import write_model
from training.speech.distil_emotion import LAYERS, pooled
from training.speech.emotion_ear import ARRAYS, EVERY, EmotionLayer, read_layer, window_weights
from training.speech.neutral_voice import SHOWN, Count, probabilities, recordings, shown
from training.speech.train_emotion_ear import Rows, fitted, leave_one_out, report_held_out
from training.speech.whisper import WhisperEncoder, load, whisper_mel
from training.systems.emoface.emotion_encoder import (
    HEARD_EMOTIONS,
    PEAK,
    SILENT,
    WINDOW,
    cepstral_basis,
    instants,
    of_window,
    voice_of,
)

EXACT = ("mean", "scale", "bias", "readers", "first_bias")
"""Arrays that are stored in f32. Only `weight`, the layer's matrix, is stored in fewer bits."""
FRAMES = 2
"""Number of 10 ms frames that one feature of Whisper covers."""
LEAST_FEATURES = 2


def heard_layers(encoder: WhisperEncoder, samples: np.ndarray, layers: list[int]) -> list[torch.Tensor]:
    """Outputs [T, C] of Whisper's layers for a sound [S], which is first scaled to a fixed peak."""
    peak = np.abs(samples).max(initial=0.0)
    scaled = torch.from_numpy(samples * (PEAK / peak if peak > SILENT else 1.0)).float()
    return encoder.hear(whisper_mel(scaled), layers)


def rows_over_time(encoder: WhisperEncoder, samples: np.ndarray, layers: list[int] = LAYERS) -> np.ndarray:
    """Rows [I, R] of a sound [S] at instants 320 ms apart. Whisper hears the sound as a whole."""
    outputs = heard_layers(encoder, samples, layers)
    voice, total = voice_of(samples), len(outputs[0])
    cepstra = voice.mel @ cepstral_basis()
    rows = []
    for frame in instants(len(voice.mel))[::EVERY]:
        start = max(frame - WINDOW, 0)
        end = min(max(frame // FRAMES, min(LEAST_FEATURES, total)), total)
        first = min(start // FRAMES, max(end - LEAST_FEATURES, 0))
        statistics = pooled([output[None, first:end] for output in outputs])[0].numpy()
        rows.append(np.concatenate([statistics, of_window(voice, cepstra, start, frame)]))
    return np.array(rows)


def last_row(encoder: WhisperEncoder, samples: np.ndarray) -> np.ndarray:
    """The row [R] of a sound [S] of at most two seconds."""
    layers = heard_layers(encoder, samples, LAYERS)
    voice = voice_of(samples)
    end = len(voice.mel)
    numbers = of_window(voice, voice.mel @ cepstral_basis(), max(end - WINDOW, 0), end)
    return np.concatenate([pooled([layer[None] for layer in layers])[0].numpy(), numbers])


def measure_over_time(encoder: WhisperEncoder, rows: Rows, layer: EmotionLayer, data: Path) -> None:
    """Prints how often emotions show: of actors, each left out of a fit in turn, and of others by `layer`."""
    actor_rows, speaker = rows.actor_rows, rows.speaker[rows.actor_rows]
    layers = {actor: fitted(rows, actor_rows[speaker != actor]) for actor in sorted(set(speaker))}
    counts = defaultdict(Count)
    for clip in read_acted(data):
        emotion = HEARD_EMOTIONS.index(clip.emotion)
        intensity, most = shown_of(encoder, layers[clip.actor], clip.samples.astype(np.float32))
        what = "neutral clips that show an emotion" if emotion == 0 else "acted emotions shown"
        counts[what].add(intensity > SHOWN)
        if emotion != 0:
            counts["shown correctly"].add(intensity > SHOWN and most == emotion)
    print("an actor left out:", ", ".join(f"{what} {count}" for what, count in counts.items()))
    for text in recordings(data, partial(shown_of, encoder, layer)):
        print(text, flush=True)


def shown_of(encoder: WhisperEncoder, layer: EmotionLayer, samples: np.ndarray) -> tuple[float, int]:
    """The largest intensity that a sound shows, and the index of its emotion."""
    rows = rows_over_time(encoder, samples)
    if not len(rows):
        return 0.0, 0
    return shown(probabilities(layer, rows, window_weights(voice_of(samples))))


def main(
    windows: Annotated[Path, "windows.pt of training.speech.emotion_windows"],
    whisper: Annotated[Path, "folder of training.speech.whisper"],
    models: Annotated[Path | None, "folder of models; none: the embedded ones"] = None,
    measure: Annotated[Path | None, "folder of data to measure on instead of writing the model"] = None,
) -> None:
    """Command line."""
    encoder = load(whisper)
    rows = Rows(windows, partial(last_row, encoder))
    folder = models / "emotion_of_whisper" if models else shipped("emotion_of_whisper")
    if measure is not None:
        layer = read_layer(folder)
        print("an actor left out", leave_one_out(rows))
        report_held_out(rows, layer)
        measure_over_time(encoder, rows, layer, measure)
        return
    left = np.isin(rows.speaker[rows.actor_rows], HELD_OUT)
    layer = fitted(rows, rows.actor_rows[~left])
    print(write(folder, layer, encoder))
    report_held_out(rows, layer)


def write(folder: Path, layer: EmotionLayer, encoder: WhisperEncoder) -> Path:
    """Writes the layer's arrays and the bias of Whisper's first convolution, which identifies the Whisper."""
    state = {name: torch.from_numpy(getattr(layer, name)).float() for name in ARRAYS}
    state["first_bias"] = encoder.first.bias.detach()
    config = {"channels": encoder.config.width, "layers": LAYERS, "emotions": HEARD_EMOTIONS}
    return write_model(folder, state, config, exact=EXACT)


if __name__ == "__main__":
    run_command(main)
