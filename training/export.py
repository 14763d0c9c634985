"""Writes finished runs as the model folders that the library embeds.

    python -m training.export NAME [--models DIR] …

NAME is one of `MODELS`; `python -m training.export NAME --help` lists its flags. Each folder gets
weights and config.json. Without `--models` the folder is that of the embedded model, and the weights are
packed. Weights are stored as f16, which changes the lip opening by less than 0.01 mm; statistics stay f32.
The model card, README.md, is written by hand.
"""

import argparse
from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
import torch
from torch import Tensor, nn

from training import DATA, shipped
from training.corpus.emotions import expressions
from training.corpus.faces import CHANNELS
from training.corpus.ict import IctLandmarks
from training.corpus.manner import manners_config
from training.flags import add_flags
from training.landmarks import prior
from training.landmarks.network import Config, LandmarkNetwork, start_from
from training.landmarks.pose_network import PoseConfig, PoseNetwork
from training.nn.checkpoint import EXACT, write_model
from training.rig.network import CONFIGS as RIG
from training.rig.visemes import solve
from training.speech.whisper import BANDS
from training.speech.whisper import load as load_whisper
from training.systems.cafe_talk.denoiser import CafeTalkConfig
from training.systems.facetalk import stored as facetalk_files
from training.systems.freetalk.ats import AtsConfig, Sampling
from training.text.stored import arrays, config_of, load_tower

Run = Annotated[Path, "what the model's trainer wrote"]
HEAD = shipped("facetalk_compact")


@dataclass
class Model:
    """One folder: its name, weights, config.json, and the names of the arrays that stay f32."""

    name: str
    state: dict[str, Tensor]
    config: dict
    exact: tuple[str, ...] = EXACT


def ats(
    run: Run,
    steps: Annotated[int | None, "default number of denoising steps"] = None,
    spacing: Literal["leading", "trailing"] = "trailing",
    temperature: Annotated[float, "scale of the starting noise"] = 0.0,
    noise_s: Annotated[float, "over how many seconds that noise stays alike"] = 0.0,
    style: Annotated[str | None, "default speaking style"] = None,
) -> Iterator[Model]:
    """An ats.pt of training.systems.freetalk.train."""
    saved = torch.load(run, map_location="cpu")
    config = AtsConfig.from_json(saved["config"])
    config.sampling = Sampling(steps, spacing, temperature, noise_s) if steps else config.sampling
    config.default_style = style or config.default_style
    yield Model(f"ats_{config.name}", saved["state"], config.to_json())


def ear(run: Run) -> Iterator[Model]:
    """The body of an ear.pt of training.speech.train_ear, without the read-outs that only training needs."""
    saved = torch.load(run, map_location="cpu")
    state = {k.removeprefix("encoder."): v for k, v in saved["state"].items() if k.startswith("encoder.")}
    yield Model("ear", state, saved["config"], ("mean", "deviation"))


def stm(runs: Path = Path("runs/stm"), trained: Literal["both", "corpus"] = "both") -> Iterator[Model]:
    """Every decoder that training.systems.freetalk.stm.train has left in the folder."""
    for name, kind in (("static_weights", "static"), ("stm_paper", "paper")):
        path = runs / f"{kind}_{trained}.pt"
        if path.exists():
            saved = torch.load(path, map_location="cpu")
            yield Model(name, saved["state"], saved["config"])


def stream(run: Run) -> Iterator[Model]:
    """A stream.pt of training.systems.freetalk.train_stream, training.speech.train_causal or
    training.speech.train_live_closures."""
    saved = torch.load(run, map_location="cpu")
    yield Model(saved["config"]["model"], saved["state"], saved["config"])


def cafe_talk(
    run: Run,
    steps: Annotated[int | None, "default number of denoising steps; none: as in training"] = None,
    alpha: Annotated[float | None, "guidance of speech and emotion"] = None,
    beta: Annotated[float | None, "guidance of events at strength 1"] = None,
    temperature: Annotated[float | None, "scale of the starting noise"] = None,
    noise_s: Annotated[float | None, "over how many seconds that noise stays alike"] = None,
    style: Annotated[str | None, "default speaking style"] = None,
) -> Iterator[Model]:
    """A cafe_talk.pt with the places of the emotions."""
    saved = torch.load(run, map_location="cpu")
    config = CafeTalkConfig.from_json(saved["config"])
    changed = {"steps": steps, "alpha": alpha, "beta": beta, "temperature": temperature, "noise_s": noise_s}
    config.sampling = replace(config.sampling, **{k: v for k, v in changed.items() if v is not None})
    config.default_style = style or config.default_style
    state = saved["state"] | {"emotions": saved["emotions"].float()}
    yield Model(f"cafe_talk_{config.name}", state, config.to_json())


def emoface(run: Run) -> Iterator[Model]:
    """An emoface.pt; the template and its spirals are part of it."""
    saved = torch.load(run, map_location="cpu")
    state = {key: value for key, value in saved["state"].items() if not key.endswith("spirals")}
    state |= {key: saved[key].float() for key in ("vertices", "triangles", "spirals")}
    config = saved["config"] | {"triangles": len(saved["triangles"])}
    yield Model(f"emoface_{config['name']}", state, config)


def facetalk(
    head: Annotated[Path, "head.pt, or a model folder, whose models stay where none is named"] = HEAD,
    motion: Annotated[Path | None, "motion.pt of training.systems.facetalk.train_motion"] = None,
    landmark_motion: Annotated[Path | None, "motion.pt of `--memory landmarks`"] = None,
) -> Iterator[Model]:
    """A head, and the models that move it: by speech, and by the motion of landmarks."""
    head, motions = facetalk_files.load_head_and_motions(head)
    for kind, path in zip(facetalk_files.MOTIONS, (motion, landmark_motion), strict=True):
        if path is not None:
            motions[kind] = facetalk_files.load_motion(path)
            facetalk_files.check_fit(path, motions[kind], head)
    name, exact = f"facetalk_{head.config.name}", facetalk_files.EXACT
    yield Model(name, *facetalk_files.joined(head, motions), exact)


def rig(data: Path = DATA, runs: Path = Path("runs/rig")) -> Iterator[Model]:
    """The network that training.rig.train learned on both faces, and visemes as mixtures of shapes."""
    mixtures, errors = solve(data)
    for viseme, (error, motion) in errors.items():
        print(f"{viseme}: mixture is {error:.2f} mm from the true viseme, which moves {motion:.2f} mm")
    config = asdict(RIG["rig"]) | {"shapes": CHANNELS, "visemes": mixtures}
    yield Model("rig", torch.load(runs / "rig_both.pt", map_location="cpu"), config)


def text(
    text: Path = Path("runs/text"),
    clip: Annotated[Path | None, "CLIP's folder as in training; relative to the model's folder"] = None,
) -> Iterator[Model]:
    """The text space and its tower. A tower on top of CLIP names CLIP's folder, which is not copied."""
    words, tower = load_tower(text, clip is not None)
    yield Model("text_units", arrays(tower, words), config_of(tower, words, clip))


def landmarks(
    data: Path = DATA, views: Path = Path("runs/landmarks"), pose: Path = Path("runs/pose")
) -> Iterator[Model]:
    """Both networks that find a face, with their normalisation folded, and the prior of its shape."""
    sizes, pose_sizes = Config(), PoseConfig()

    def folded(name: str, network: nn.Module, run: Path) -> dict[str, Tensor]:
        start_from(run / "network.pt", network, "")
        network.fold()
        return {f"{name}.{key}": value for key, value in network.state_dict().items()}

    state = folded("views", LandmarkNetwork(sizes), views) | folded("pose", PoseNetwork(pose_sizes), pose)
    state["prior.modes"] = torch.from_numpy(prior.modes(data))
    config = {"widths": sizes.widths, "pose_widths": pose_sizes.widths, "prior_modes": prior.MODES}
    yield Model("landmarks", state, config)


def expression_table(data: Path = DATA) -> Iterator[Model]:
    """How an emotion moves the landmarks and changes articulation. Nothing is trained.

    `lasting` and `opening` [15, 68, 3] are displacements at intensity 1, in canonical metres.
    """
    state = zip(("lasting", "opening"), map(torch.from_numpy, expressions(data)), strict=True)
    yield Model("expressions", dict(state), manners_config(), ("",))


def face_modes(data: Path = DATA) -> Iterator[Model]:
    """ICT FaceKit's expression modes at the landmarks, [M, 68, 3] canonical metres. Nothing is trained."""
    modes = IctLandmarks(data).modes
    state = {"modes": torch.from_numpy(np.stack(list(modes.values())).astype(np.float32))}
    yield Model("face_modes", state, {"name": "face_modes", "modes": list(modes)}, ("",))


def trunk(
    whisper: Annotated[Path, "folder of Whisper base, as training.speech.whisper fetches it"],
    layers: Annotated[int, "number of transformer layers"] = 3,
) -> Iterator[Model]:
    """Whisper's convolutions and first layers, on which the ear builds. Nothing is trained.

    Left out are Whisper's positions, which are sinusoids, and its final norm.
    """
    encoder = load_whisper(whisper)
    parts = ("first.", "second.", *(f"layers.{number}." for number in range(layers)))
    state = {name: value for name, value in encoder.state_dict().items() if name.startswith(parts)}
    sizes = {"width": encoder.config.width, "heads": encoder.config.heads}
    sizes |= {"feedforward": 4 * encoder.config.width, "layers": layers}
    yield Model("whisper_trunk", state, {"model": "whisper_trunk", "bands": BANDS} | sizes)


MODELS = {
    "ear": ear, "ats": ats, "stm": stm, "stream": stream, "cafe_talk": cafe_talk, "emoface": emoface,
    "facetalk": facetalk, "rig": rig, "text": text, "landmarks": landmarks,
    "expressions": expression_table, "face_modes": face_modes, "trunk": trunk,
}  # fmt: skip


def export(name: str, models: Path | None = None, **options) -> list[Path]:
    """Writes the folders of one of `MODELS` below `models`, or over the embedded ones, and returns them."""
    written = []
    for model in MODELS[name](**options):
        folder = models / model.name if models else shipped(model.name)
        written.append(write_model(folder, model.state, model.config, model.exact))
    return written


def main(line: list[str] | None = None) -> None:
    """Entry of the command."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    names = parser.add_subparsers(dest="name", required=True)
    for name, function in MODELS.items():
        of_model = names.add_parser(name, help=function.__doc__.splitlines()[0], description=function.__doc__)
        of_model.add_argument("--models", type=Path, help="folder of model folders")
        add_flags(of_model, function)
    for folder in export(**vars(parser.parse_args(line))):
        print(folder)


if __name__ == "__main__":
    main()
