"""HuBERT features for the `paper` configuration, from a checkpoint folder of the user's.

Nothing is downloaded. Needs `transformers` (not in requirements.txt: only this configuration
uses it) and a folder with config.json and model.safetensors.
"""

from pathlib import Path

import torch
from torch import Tensor


class HubertFeatures:
    """Last hidden state at 50 Hz, brought to the motion's frames."""

    def __init__(self, folder: Path | None):
        if folder is None:
            raise ValueError("--hubert: expected a folder with a HuBERT checkpoint, got nothing")
        try:
            from transformers import HubertModel
        except ImportError as error:
            raise ImportError("the paper configuration needs `pip install transformers`") from error
        self.model = HubertModel.from_pretrained(folder, local_files_only=True).eval()
        self.channels = self.model.config.hidden_size

    @torch.no_grad()
    def __call__(self, samples: Tensor, frames: int) -> Tensor:
        """`samples` [S] at 16 kHz → [frames, C], linear between hidden states.

        The samples are brought to mean 0 and deviation 1 first. Motion frame i is second i / 25;
        hidden state k covers 25 ms from second k / 50 on and stands for its middle.
        """
        samples = (samples - samples.mean()) / (samples.std() + 1e-7)
        hidden = self.model(samples[None]).last_hidden_state[0]
        position = (torch.arange(frames) / 25.0 - 0.0125) * 50.0
        position = position.clamp(0, len(hidden) - 1)
        below = position.floor().long().clamp_max(max(len(hidden) - 2, 0))
        share = (position - below)[:, None]
        above = (below + 1).clamp_max(len(hidden) - 1)
        return hidden[below] * (1 - share) + hidden[above] * share
