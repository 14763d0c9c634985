"""The ICT face at its 68 landmarks: neutral and expression modes by ARKit name."""

import json
from pathlib import Path

import numpy as np
from safetensors import safe_open

from training.corpus.faces import channel_of_ict


class IctLandmarks:
    """`neutral` [68, 3] and `modes[name]` [68, 3], metres, canonical axes, ICT's own origin."""

    def __init__(self, data: Path):
        with safe_open(data / "faces/ict_facekit.safetensors", "np") as file:
            rows = file.get_tensor("landmarks68")
            names = json.loads(file.metadata()["expression_names"])
            expression = file.get_tensor("expression")[:, rows].astype(np.float32) * 0.01
            self.neutral = file.get_tensor("neutral")[rows].astype(np.float32) * 0.01
        self.modes = dict(zip(names, expression, strict=True))

    def displace(self, weights: dict[str, np.ndarray]) -> np.ndarray:
        """The displacement [T, 68, 3] in metres under ARKit weights: the sum of weight × mode.

        `weights` are by name (`jawOpen`, `mouthSmileLeft` or `mouthSmile_L`), each [T].
        """
        total = 0.0
        for name, weight in weights.items():
            total = total + np.asarray(weight, np.float32)[:, None, None] * self.mode(name)
        return total

    def mode(self, name: str) -> np.ndarray:
        """One mode [68, 3]. For ARKit's `browInnerUp` and `cheekPuff` it is the sum of both sides."""
        return channel_of_ict(self.modes, name)
