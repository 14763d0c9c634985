"""Loads finished models of FreeTalk, from a run or from the folders that they were exported to."""

from pathlib import Path

import torch
from torch import nn

from training import shipped
from training.nn.checkpoint import load_model, restored
from training.speech.compact import CompactConfig, CompactEncoder, load_encoder
from training.speech.ear import SHIPPED_EAR, load_ear
from training.systems.freetalk.ats import AtsConfig, AtsDenoiser


def load_models(models: Path | None = None, name: str = "compact") -> tuple[nn.Module, AtsDenoiser]:
    """Encoder and denoiser of a folder of models, or the embedded ones, ready for inference.

    The encoder is the compact one or the body of the ear, whichever the denoiser reads.
    """
    folder = models / f"ats_{name}" if models else shipped(f"ats_{name}")
    denoiser = load_model(folder, lambda config: AtsDenoiser(AtsConfig.from_json(config)))
    encoder = denoiser.config.speech.encoder
    beside = models / encoder if models and (models / encoder).is_dir() else shipped(encoder)
    return load_ear(beside) if encoder == "ear" else load_encoder(beside), denoiser


def load_run(run: Path) -> tuple[nn.Module, AtsDenoiser]:
    """Encoder and denoiser of a finished run, ready for inference. The ear is the shipped one."""
    saved = torch.load(run, map_location="cpu")
    denoiser = restored(AtsDenoiser(AtsConfig.from_json(saved["config"])), saved["state"])
    if saved["encoder"] is None:
        return load_ear(SHIPPED_EAR), denoiser
    return restored(CompactEncoder(CompactConfig(**saved["encoder_config"])), saved["encoder"]), denoiser
