"""Writes a finished Cafe-Talk run as the model folder that Rust reads.

    python -m training.export_cafe_talk --run runs/cafe_fine/cafe_talk.pt --models weights

`cafe_talk_<name>/` gets model.safetensors and config.json, with the places of the emotions in the text space,
so that the engine needs no text for them. Weights are stored as f16; mean and deviation stay f32. The random
encoder of a debug run is written beside it.
"""

import argparse
from pathlib import Path

import torch

from training.export import model_folder, write_model
from training.systems.cafe_talk.denoiser import CafeTalkConfig, Sampling


def export(run: Path, models: Path, sampling: Sampling | None = None, style: str | None = None) -> Path:
    """Writes the folder of a `cafe_talk.pt` and returns it."""
    saved = torch.load(run, map_location="cpu")
    config = CafeTalkConfig.from_json(saved["config"])
    config.sampling = sampling or config.sampling
    config.default_style = style or config.default_style
    state = saved["state"] | {"emotions": saved["emotions"].float()}
    if config.name == "debug" and saved["encoder_config"] is not None:
        write_model(model_folder(models, "compact_speech"), saved["encoder"], saved["encoder_config"])
    return write_model(model_folder(models, f"cafe_talk_{config.name}"), state, config.to_json())


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        "--run", type=Path, required=True, help="cafe_talk.pt of training.systems.cafe_talk.train"
    )
    parser.add_argument("--models", type=Path, default=Path("weights"))
    parser.add_argument("--steps", type=int, default=Sampling.steps, help="default number of denoising steps")
    parser.add_argument("--alpha", type=float, default=Sampling.alpha, help="guidance of speech and emotion")
    parser.add_argument("--beta", type=float, default=Sampling.beta, help="guidance of events at strength 1")
    parser.add_argument("--style", help="default speaking style")
    arguments = parser.parse_args()
    sampling = Sampling(steps=arguments.steps, alpha=arguments.alpha, beta=arguments.beta)
    print(export(arguments.run, arguments.models, sampling, arguments.style))


if __name__ == "__main__":
    main()
