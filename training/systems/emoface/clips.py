"""The clips that EmoFace trains on, heard by both encoders; kept in the cache."""

from __future__ import annotations

import hashlib
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from training.corpus import arkit, bank
from training.corpus.facegood import read_facegood
from training.corpus.faces import load_ict
from training.corpus.grid import read_grid
from training.speech.compact import normalise
from training.systems.emoface.model import EmoFaceConfig, Template
from training.systems.emoface.rows import Spoken
from training.systems.emoface.template import ict_template
from training.train_ats import SHIPPED_ENCODER
from training.train_speech import load_encoder


def template_of(data: Path, vertices: int) -> tuple[Template, np.ndarray]:
    """ICT's template and the displacement of its vertices at weight 1 of each channel, [51, V, 3] metres."""
    template, chosen = ict_template(data, vertices)
    return template, load_ict(data, "face").mean.modes[:, chosen]


def load_clips(arguments, config: EmoFaceConfig) -> list[Spoken]:
    """All clips, from the cache where they were heard before by the same encoders."""
    weights = (arguments.feeling / "model.safetensors").read_bytes()
    key = hashlib.sha256(weights + repr((arguments.voices, arguments.limit)).encode()).hexdigest()[:12]
    path = arguments.cache / f"emoface-{key}.pt"
    if path.exists():
        return [Spoken(**fields) for fields in torch.load(path)]
    clips = heard_clips(arguments)
    arguments.cache.mkdir(parents=True, exist_ok=True)
    partial = path.with_suffix(".partial")
    torch.save([vars(clip) for clip in clips], partial)
    partial.rename(path)
    return clips


@torch.no_grad()
def heard_clips(arguments) -> list[Spoken]:
    """Recorded motion and felt speech."""
    encoder = load_encoder(SHIPPED_ENCODER).eval()
    entries = bank.load(arguments.data, arguments.cache, arguments.voices, limit=arguments.limit)
    samples = {c.name: c.samples for c in [*read_grid(arguments.data), *read_facegood(arguments.data)]}
    raise NotImplementedError(encoder, entries, samples, Tensor, arkit, normalise)
