"""Fits and measures the layer of the live ear, which reads emotions from its network and the 118 numbers.

    python -m training.speech.train_emotion_ear --data ../shared/data --kokoro runs/kokoro-82m \
        --net runs/ear/net.pt --rows runs/emotion/live_rows.pt

`--measure-only` writes no model: it leaves out whole corpora and actors in turn.
"""

from functools import partial
from pathlib import Path
from typing import Annotated

import numpy as np
import torch

from training import shipped
from training.flags import run_command
from training.nn.checkpoint import restored, write_model
from training.speech.emotion_ear import ARRAYS, EmotionEarConfig, EmotionEarNet, read_ear, row_of
from training.speech.emotion_rows import Rows, Sound, kept_rows, make_rows
from training.speech.fit_emotion import calibrated, doubts_of_readers, fitted, measure
from training.systems.emoface.emotion_encoder import WINDOW, voice_of


def heard_row(net: EmotionEarNet, sound: Sound, _copy: int) -> np.ndarray:
    """The row [told + 118] of two seconds of sound."""
    voice = voice_of(sound.samples.astype(np.float32))
    end = len(voice.mel)
    return row_of(net, voice, max(end - WINDOW, 0), end)


def rows_of_net(net: EmotionEarNet, data: Path, kokoro: Path | None) -> Rows:
    """Rows of all sounds as they are."""
    return make_rows(data, kokoro, partial(heard_row, net), lambda _: 0)


def main(
    data: Path,
    kokoro: Annotated[Path | None, "folder of Kokoro's model; none: without its voices"] = None,
    net: Annotated[Path | None, "net.pt of training.speech.distil_emotion; none: the model's own"] = None,
    rows: Annotated[Path, "rows of all sounds, kept from run to run"] = Path("runs/emotion/live_rows.pt"),
    models: Annotated[Path | None, "folder of models; none: the embedded ones"] = None,
    measure_only: Annotated[bool, "measure instead of writing the model"] = False,
) -> None:
    """Command line."""
    folder = models / "emotion_ear" if models else shipped("emotion_ear")
    network = read_ear(shipped("emotion_ear")).net if net is None else read_net(net)
    every = kept_rows(rows, lambda: rows_of_net(network, data, kokoro))
    if measure_only:
        for line in measure(every):
            print(line, flush=True)
        return
    use = ~every.held_out
    layer = calibrated(fitted(every, use), doubts_of_readers(every, use))
    state = {name: torch.from_numpy(x).float() for name, x in layer.arrays().items()} | network.state_dict()
    print(write_model(folder, state, network.config.to_json(), exact=ARRAYS))


def read_net(path: Path) -> EmotionEarNet:
    """The network of a `net.pt`."""
    saved = torch.load(path)
    return restored(EmotionEarNet(EmotionEarConfig.from_json(saved["config"])), saved["state"])


if __name__ == "__main__":
    run_command(main)
