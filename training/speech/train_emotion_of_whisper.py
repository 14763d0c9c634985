"""Fits and measures the layer that reads emotions from the first layers of Whisper that the library carries.

    python -m training.speech.train_emotion_of_whisper --data ../shared/data --kokoro runs/kokoro-82m \
        --rows runs/emotion/rows.pt

`--measure-only` writes no model: it leaves out whole corpora and actors in turn.
"""

from pathlib import Path
from typing import Annotated

import numpy as np
import torch
from torch import Tensor

from training import shipped
from training.corpus import crema_d, emodb
from training.corpus.revoice import other_room
from training.flags import run_command
from training.nn.checkpoint import write_model
from training.speech.ear import ear_mel, ear_mel_of_power
from training.speech.emotion_ear import ARRAYS, EVERY, EmotionLayer
from training.speech.emotion_rows import Rows, Sound, kept_rows, make_rows
from training.speech.fit_emotion import calibrated, doubts_of_readers, fitted, measure
from training.speech.log_mel import power_spectrum
from training.speech.whisper import WhisperEncoder, load_trunk
from training.systems.emoface.emotion_encoder import (
    HEARD_EMOTIONS,
    NUMBERS,
    WINDOW,
    cepstral_basis,
    instants,
    of_window,
    voice_of,
)

LAYERS, CHANNELS = [3], 512
EXACT = ("mean", "scale", "bias", "readers")
"""Arrays that are stored in f32. Only `weight`, the layer's matrix, is stored in fewer bits."""
FRAMES = 2
"""Number of 10 ms frames that one feature of Whisper covers."""
LEAST_FEATURES = 2
COPIES = {crema_d.SOURCE: 1, emodb.SOURCE: 2}
"""Copies of each acted sound in other rooms. A neutral one has one copy."""
TRACT_OCTAVES = 0.12
PITCH = 13
"""Of the 118 numbers those of pitch and voicing. The others tell rooms and noise more than emotions."""


def statistics(outputs: list[Tensor]) -> np.ndarray:
    """Mean, deviation and mean change over time of outputs [T, C], [3 C layers]."""
    parts = [p for x in outputs for p in (x.mean(0), x.std(0), x.diff(dim=0).abs().mean(0))]
    return torch.cat(parts).double().numpy()


def rows_over_time(trunk: WhisperEncoder, samples: np.ndarray, layers: list[int]) -> np.ndarray:
    """Rows [I, R] of a sound [S] at instants 320 ms apart. Whisper hears the sound as a whole."""
    outputs = trunk.hear(ear_mel(torch.from_numpy(samples).float()), layers)
    voice, total = voice_of(samples), len(outputs[0])
    cepstra = voice.mel @ cepstral_basis()
    rows = []
    for frame in instants(len(voice.mel))[::EVERY]:
        start = max(frame - WINDOW, 0)
        end = min(max(frame // FRAMES, min(LEAST_FEATURES, total)), total)
        first = min(start // FRAMES, max(end - LEAST_FEATURES, 0))
        said = statistics([output[first:end].float() for output in outputs])
        rows.append(np.concatenate([said, of_window(voice, cepstra, start, frame)]))
    return np.array(rows)


def rows_in_rooms(data: Path, kokoro: Path | None) -> Rows:
    """Rows of all sounds and of their copies in other rooms. A copy keeps the 118 numbers of the sound."""
    trunk, random = load_trunk(), np.random.default_rng(0)

    def hear(sound: Sound, copy: int) -> np.ndarray:
        samples = sound.samples.astype(np.float32)
        voice = voice_of(samples)
        end = len(voice.mel)
        numbers = of_window(voice, voice.mel @ cepstral_basis(), max(end - WINDOW, 0), end)
        outputs = trunk.hear(
            mel_in_room(samples, random) if copy else ear_mel(torch.from_numpy(samples)), LAYERS
        )
        return np.concatenate([statistics([output.float() for output in outputs]), numbers])

    return make_rows(data, kokoro, hear, lambda sound: COPIES.get(sound.source, 1))


def mel_in_room(samples: np.ndarray, random: np.random.Generator) -> Tensor:
    """The ear's log-mel of a sound [S] in another room, and of a voice with another tract."""
    power = power_spectrum(torch.from_numpy(samples)).numpy().astype(np.float64)
    warp = 2.0 ** random.uniform(-TRACT_OCTAVES, TRACT_OCTAVES)
    return ear_mel_of_power(torch.from_numpy(other_room(power, random)), warp)


def main(
    data: Path,
    kokoro: Annotated[Path | None, "folder of Kokoro's model; none: without its voices"] = None,
    rows: Annotated[Path, "rows of all sounds, kept from run to run"] = Path("runs/emotion/rows.pt"),
    models: Annotated[Path | None, "folder of models; none: the embedded ones"] = None,
    measure_only: Annotated[bool, "measure instead of writing the model"] = False,
) -> None:
    """Command line."""
    every = kept_rows(rows, lambda: rows_in_rooms(data, kokoro))
    every.x[:, PITCH - NUMBERS :] = 0.0
    if measure_only:
        for line in measure(every):
            print(line, flush=True)
        return
    use = ~every.held_out
    layer = calibrated(fitted(every, use), doubts_of_readers(every, use))
    print(write(models / "emotion_of_whisper" if models else shipped("emotion_of_whisper"), layer))


def write(folder: Path, layer: EmotionLayer) -> Path:
    """Writes the layer's arrays."""
    state = {name: torch.from_numpy(getattr(layer, name)).float() for name in ARRAYS}
    config = {"channels": CHANNELS, "layers": LAYERS, "emotions": HEARD_EMOTIONS}
    return write_model(folder, state, config, exact=EXACT)


if __name__ == "__main__":
    run_command(main)
