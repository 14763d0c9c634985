"""Adapts a trained model to another encoder, as a start for its training.

    python -m training.speech.fold --model weights/emoface/emoface_compact --out runs/emoface_start.pt

Least squares fit a linear map from the ear's features to those of the encoder on which the model was trained,
over the training clips with recorded motion. The map goes into the layer of the model that reads the
features. Sources of motion that the model does not know get a style like that of grid_s1. Of FaceTalk only
the model that follows speech is written. FreeTalk's and Cafe-Talk's trainers take the file as `--init`,
EmoFace's as `--base`.
"""

from collections.abc import Iterable
from pathlib import Path
from typing import Annotated

import torch
from torch import Tensor, nn

from training import DATA
from training.corpus import bank, ear
from training.corpus.ear import EarClip
from training.flags import run_command
from training.nn.checkpoint import read_model
from training.speech.compact import SHIPPED_ENCODER, CompactEncoder, load_encoder, normalise
from training.speech.ear import SHIPPED_EAR, EarBody, load_ear

RIDGE = 1e-4
INPUTS = ("mem_proj", "content_in", "motion.mem_proj")
"""Layers that read speech features, in FreeTalk and Cafe-Talk, EmoFace, FaceTalk."""
STYLES = ("style.weight", "coarse.style.weight")
LIKE = "grid_s1"


def features_of(encoder: CompactEncoder | EarBody, clip: EarClip) -> Tensor:
    """Features [T, C] of a clip in its own voice."""
    if isinstance(encoder, EarBody):
        return encoder(clip.heard[:1])[0]
    return encoder(normalise(clip.mels[0].float())[None])[0]


@torch.no_grad()
def feature_map(old: nn.Module, new: nn.Module, clips: Iterable[EarClip]) -> tuple[Tensor, Tensor, float]:
    """`matrix` [C, C'] and `shift` [C] with old ≈ matrix · new + shift, and the explained variance."""
    pairs = [(features_of(new, clip), features_of(old, clip)) for clip in clips]
    rows, targets = (torch.cat(of).double() for of in zip(*pairs, strict=True))
    means = rows.mean(0), targets.mean(0)
    rows, targets = rows - means[0], targets - means[1]
    square = rows.T @ rows / len(rows) + RIDGE * torch.eye(rows.shape[1], dtype=torch.float64)
    matrix = torch.linalg.solve(square, rows.T @ targets / len(rows))
    met = 1.0 - (targets - rows @ matrix).square().sum() / targets.square().sum()
    return matrix.T.float(), (means[1] - means[0] @ matrix).float(), float(met)


def folded(state: dict[str, Tensor], layer: str, matrix: Tensor, shift: Tensor) -> dict[str, Tensor]:
    """The state with a layer whose output for the new features matches its present one for the old ones."""
    weight, bias = state[f"{layer}.weight"], state[f"{layer}.bias"]
    return state | {f"{layer}.weight": weight @ matrix, f"{layer}.bias": bias + weight @ shift}


def with_styles(state: dict[str, Tensor], config: dict) -> tuple[dict[str, Tensor], dict]:
    """Adds a style for each source of recorded motion that the model lacks."""
    known = config.get("styles", [])
    table = next((name for name in STYLES if name in state), None)
    lacking = [source for source in bank.READERS if source not in known]
    if table is None or not lacking:
        return state, config
    order = [source for source in bank.READERS if source in known or source in lacking]
    order += [style for style in known if style not in order]
    rows = [known.index(style if style in known else LIKE) for style in order]
    return state | {table: state[table][rows]}, config | {"styles": order}


def main(
    model: Annotated[Path, "folder of the trained model"],
    out: Annotated[Path, "file to write"],
    old: Annotated[Path, "folder of the encoder on which it was trained"] = SHIPPED_ENCODER,
    speech: Annotated[Path, "ear.pt or folder of the ear"] = SHIPPED_EAR,
    data: Path = DATA,
    cache: Path = Path("runs/cache"),
) -> None:
    """Command line."""
    config, state = read_model(model)
    body = load_ear(speech)
    encoder = load_ear(old) if old.name == body.config.model else load_encoder(old)
    clips = (c for c in ear.load(data, cache, [*bank.READERS], body.config.taps) if not c.held_out)
    matrix, shift, met = feature_map(encoder, body, clips)
    state = folded(state, next(x for x in INPUTS if f"{x}.weight" in state), matrix, shift)
    state, config = with_styles(state, config)
    if "motion" in config:
        state = {k.removeprefix("motion."): v for k, v in state.items() if k.startswith("motion.")}
        config = config["motion"]
    out.parent.mkdir(parents=True, exist_ok=True)
    torch.save({"state": state, "config": config}, out)
    print(f"{out}: {100 * met:.1f} % of the variance of the old features are met")


if __name__ == "__main__":
    run_command(main)
