"""Adapts a trained denoiser to another compact encoder, as a start for training both together.

    python -m training.speech.fold --speech runs/speech/speech.pt --out runs/ats_folded.pt
    python -m training.systems.freetalk.train --init runs/ats_folded.pt --speech runs/speech/speech.pt …

Least squares fit a linear map from the new features to the old ones, over the training clips with recorded
motion in two voices. The map is folded into the denoiser's input layer and into the read-out of closed lips.
"""

from pathlib import Path
from typing import Annotated

import torch
from torch import Tensor, nn

from training import DATA
from training.corpus import bank
from training.flags import run_command
from training.nn.checkpoint import save
from training.speech.compact import CompactEncoder, load_encoder, normalise
from training.systems.freetalk.stored import load_models, load_run

RIDGE = 1e-4
VOICES = 2


@torch.no_grad()
def feature_map(old: CompactEncoder, new: CompactEncoder, mels: list[Tensor]) -> tuple[Tensor, Tensor, float]:
    """`matrix` [C, C'] and `shift` [C] with old ≈ matrix · new + shift, and the share of variance explained.

    `mels` are normalised, [4 T, 64] each.
    """
    rows, targets = (torch.cat([x(mel[None])[0] for mel in mels]).double() for x in (new, old))
    means = rows.mean(0), targets.mean(0)
    rows, targets = rows - means[0], targets - means[1]
    square = rows.T @ rows / len(rows) + RIDGE * torch.eye(rows.shape[1], dtype=torch.float64)
    matrix = torch.linalg.solve(square, rows.T @ targets / len(rows))
    met = 1.0 - (targets - rows @ matrix).square().sum() / targets.square().sum()
    return matrix.T.float(), (means[1] - means[0] @ matrix).float(), float(met)


@torch.no_grad()
def folded(layer: nn.Linear, matrix: Tensor, shift: Tensor) -> nn.Linear:
    """A layer whose output for the new features matches that of `layer` for the old ones."""
    out = nn.Linear(matrix.shape[1], layer.out_features)
    out.weight.copy_(layer.weight @ matrix)
    out.bias.copy_(layer.bias + layer.weight @ shift)
    return out


def main(
    speech: Annotated[Path, "speech.pt of the new encoder"],
    out: Annotated[Path, "ats.pt to write"],
    run: Annotated[Path | None, "ats.pt to start from, else the shipped models"] = None,
    data: Path = DATA,
    cache: Path = Path("runs/cache"),
) -> None:
    """Command line."""
    old, denoiser = load_models() if run is None else load_run(run)
    new = load_encoder(speech)
    entries = [e for e in bank.load(data, cache, 7) if not e.held_out]
    mels = [normalise(mel.float()) for e in entries for mel in e.mels[:VOICES]]
    matrix, shift, met = feature_map(old, new, mels)
    denoiser.mem_proj = folded(denoiser.mem_proj, matrix, shift)
    denoiser.config.speech.channels = new.config.channels
    new.closure = folded(old.closure, matrix, shift)
    out.parent.mkdir(parents=True, exist_ok=True)
    save(out, denoiser, encoder=new.state_dict(), encoder_config=new.config.to_json())
    print(f"{out}: {100 * met:.1f} % of the variance of the old features are met")


if __name__ == "__main__":
    run_command(main)
