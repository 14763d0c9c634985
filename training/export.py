"""Writes a finished ATS run as the two model folders that Rust reads.

    python -m training.export --run runs/ats/ats.pt --models weights

`compact_speech/` and `ats_<name>/` each get model.safetensors and config.json. Weights are stored
as f16, which changes the lip opening by less than 0.01 mm; the motion's mean and deviation stay
f32. The model card, README.md, is written by hand.
"""

import argparse
import json
from pathlib import Path

import torch
from safetensors.torch import load_file, save_file
from torch import Tensor

from training.speech.compact import CompactConfig, CompactEncoder
from training.systems.freetalk.ats import AtsConfig, AtsDenoiser, Sampling

EXACT = ("mean", "std", "vertices", "triangles", "spirals")


def export(run: Path, models: Path, sampling: Sampling | None, style: str | None) -> list[Path]:
    """Writes both folders, or the one of a user's own encoder, and returns them."""
    saved = torch.load(run, map_location="cpu")
    config = AtsConfig.from_json(saved["config"])
    config.sampling = sampling or config.sampling
    config.default_style = style or config.default_style
    folders = [write_model(model_folder(models, f"ats_{config.name}"), saved["state"], config.to_json())]
    if saved["encoder_config"] is not None:
        encoder = model_folder(models, "compact_speech")
        folders.append(write_model(encoder, saved["encoder"], saved["encoder_config"]))
    return folders


def model_folder(models: Path, name: str) -> Path:
    """The folder of a model: `models/name`, or that of the crate which has it, where `models` is `weights`."""
    return next(iter(models.glob(f"*/{name}")), models / name)


def write_model(folder: Path, state: dict[str, Tensor], config: dict, exact: bool = False) -> Path:
    """`model.safetensors` and `config.json` of one model; `exact` keeps f32 everywhere."""
    folder.mkdir(parents=True, exist_ok=True)
    stored = {k: v.contiguous() if exact or k in EXACT else v.half().contiguous() for k, v in state.items()}
    save_file(stored, folder / "model.safetensors")
    (folder / "model.safetensors").chmod(0o644)
    (folder / "config.json").write_text(json.dumps(config, indent=2) + "\n")
    return folder


def load_models(models: Path, name: str = "compact") -> tuple[CompactEncoder, AtsDenoiser]:
    """The shipped encoder and denoiser, ready for inference."""
    encoder_json = json.loads((model_folder(models, "compact_speech") / "config.json").read_text())
    encoder = CompactEncoder(CompactConfig(**encoder_json))
    ats_json = json.loads((model_folder(models, f"ats_{name}") / "config.json").read_text())
    denoiser = AtsDenoiser(AtsConfig.from_json(ats_json))
    for folder, model in ((f"ats_{name}", denoiser), ("compact_speech", encoder)):
        state = load_file(model_folder(models, folder) / "model.safetensors")
        model.load_state_dict({key: value.float() for key, value in state.items()})
    return encoder.eval(), denoiser.eval()


def load_run(run: Path) -> tuple[CompactEncoder, AtsDenoiser]:
    """Encoder and denoiser of a finished run, ready for inference."""
    saved = torch.load(run, map_location="cpu")
    encoder = CompactEncoder(CompactConfig(**saved["encoder_config"])).eval()
    encoder.load_state_dict(saved["encoder"])
    denoiser = AtsDenoiser(AtsConfig.from_json(saved["config"])).eval()
    denoiser.load_state_dict(saved["state"])
    return encoder, denoiser


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--run", type=Path, required=True, help="ats.pt of training.systems.freetalk.train")
    parser.add_argument("--models", type=Path, default=Path("weights"))
    parser.add_argument("--steps", type=int, help="default number of denoising steps")
    parser.add_argument("--spacing", choices=["leading", "trailing"], default="trailing")
    parser.add_argument("--temperature", type=float, default=0.0)
    parser.add_argument("--style", help="default speaking style")
    arguments = parser.parse_args()
    sampling = None
    if arguments.steps:
        sampling = Sampling(arguments.steps, arguments.spacing, arguments.temperature)
    for folder in export(arguments.run, arguments.models, sampling, arguments.style):
        print(folder)


if __name__ == "__main__":
    main()
