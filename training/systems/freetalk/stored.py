"""Loads finished models of FreeTalk, from a run or from the folders that they were exported to."""

from pathlib import Path

import torch

from training import shipped
from training.nn.checkpoint import load_model, restored
from training.speech.compact import CompactConfig, CompactEncoder, load_encoder
from training.systems.freetalk.ats import AtsConfig, AtsDenoiser


def load_models(models: Path | None = None, name: str = "compact") -> tuple[CompactEncoder, AtsDenoiser]:
    """Encoder and denoiser of a folder of models, or the embedded ones, ready for inference."""
    folders = [models / x if models else shipped(x) for x in ("compact_speech", f"ats_{name}")]
    denoiser = load_model(folders[1], lambda config: AtsDenoiser(AtsConfig.from_json(config)))
    return load_encoder(folders[0]), denoiser


def load_run(run: Path) -> tuple[CompactEncoder, AtsDenoiser]:
    """Encoder and denoiser of a finished run, ready for inference."""
    saved = torch.load(run, map_location="cpu")
    encoder = restored(CompactEncoder(CompactConfig(**saved["encoder_config"])), saved["encoder"])
    return encoder, restored(AtsDenoiser(AtsConfig.from_json(saved["config"])), saved["state"])
