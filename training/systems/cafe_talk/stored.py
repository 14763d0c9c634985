"""Loads a finished Cafe-Talk model from a run or from an exported folder."""

from dataclasses import dataclass
from pathlib import Path

import torch
from torch import Tensor

from training.nn.checkpoint import read_model
from training.speech.ear import SHIPPED_EAR, EarBody, load_ear
from training.systems.cafe_talk.denoiser import CafeTalkConfig

EMOTIONS = "emotions"
ADAPTER = "adapter."


@dataclass
class Stored:
    """The denoiser's `state` in f32, `emotions` [15, E] in the text space, and the body of the ear.

    `encoder` is `None` if the speech features come from a checkpoint (HuBERT, wav2vec2, XLSR).
    """

    config: CafeTalkConfig
    state: dict[str, Tensor]
    emotions: Tensor
    encoder: EarBody | None

    @property
    def base(self) -> dict[str, Tensor]:
        """The state without the adapter."""
        return {name: value for name, value in self.state.items() if not name.startswith(ADAPTER)}


def load(path: Path) -> Stored:
    """Loads a `cafe_talk.pt`, or a folder of `training.export` with its encoder or the shipped one.

    A folder stores 16-bit weights. They are returned as f32.
    """
    if path.is_dir():
        return _exported(path)
    if not path.is_file():
        raise FileNotFoundError(f"{path}: expected a cafe_talk.pt or a model folder, got nothing")
    saved = torch.load(path, map_location="cpu")
    config = CafeTalkConfig.from_json(saved["config"])
    return Stored(config, saved["state"], saved[EMOTIONS].float(), ear_of(config))


def _exported(folder: Path) -> Stored:
    written, state = read_model(folder)
    if written.get("system") != "cafe_talk":
        raise ValueError(f"{folder}: expected a model of cafe_talk, got one of {written.get('system')!r}")
    if EMOTIONS not in state:
        raise ValueError(f"{folder}: expected a tensor {EMOTIONS!r}, got none")
    config, emotions = CafeTalkConfig.from_json(written), state.pop(EMOTIONS)
    return Stored(config, state, emotions, ear_of(config, folder.parent / "ear"))


def ear_of(config: CafeTalkConfig, beside: Path = SHIPPED_EAR) -> EarBody | None:
    """The ear in `beside`, or else the shipped one; `None` for a model that listens by another encoder."""
    if config.speech.encoder != "ear":
        return None
    return load_ear(beside if beside.is_dir() else SHIPPED_EAR)
