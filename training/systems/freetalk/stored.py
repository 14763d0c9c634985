"""Loads finished models of FreeTalk, from a run or from the folders that they were exported to."""

from pathlib import Path

import torch

from training import shipped
from training.nn.checkpoint import load_model, restored
from training.speech.ear import SHIPPED_EAR, EarBody, load_ear
from training.systems.freetalk.ats import AtsConfig, AtsDenoiser


def load_models(models: Path | None = None, name: str = "compact") -> tuple[EarBody, AtsDenoiser]:
    """Body of the ear and denoiser of a folder of models, or the embedded ones, ready for inference."""
    folder = models / f"ats_{name}" if models else shipped(f"ats_{name}")
    denoiser = load_model(folder, lambda config: AtsDenoiser(AtsConfig.from_json(config)))
    own = models is not None and (models / "ear").is_dir()
    return load_ear(models / "ear" if own else SHIPPED_EAR), denoiser


def load_run(run: Path) -> AtsDenoiser:
    """The denoiser of a finished run, ready for inference."""
    saved = torch.load(run, map_location="cpu")
    return restored(AtsDenoiser(AtsConfig.from_json(saved["config"])), saved["state"])
