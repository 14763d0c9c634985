"""Scores a model on held-out clips of a corpus folder against recorded vertices.

LVE and EVE are those of `training.paper.metrics`, in mm² and averaged over clips. LVE covers vertices within
8 mm of the lips' landmarks, EVE those above the middle of the nose. Clips start from rest. After the paper's
recipe they start from their own first frame. Recordings with a partner are also crossed: the model performs
the content of one with the emotion of the other, and the truth is the other's motion at the matching times.
`nearer` is how often the crossed motion is nearer to this truth than to the motion with the replaced emotion,
in the mean over vertices and frames.
"""

from argparse import Namespace
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from training.corpus.folder import CorpusFolder
from training.nn.checkpoint import read_model, restored
from training.paper.metrics import worst_point
from training.systems.emoface import folder_clips
from training.systems.emoface.clips import encoders_of
from training.systems.emoface.encoders import Encoders
from training.systems.emoface.model import EmoFace, EmoFaceConfig
from training.systems.emoface.pairs import Pairs
from training.systems.emoface.rows import Spoken
from training.systems.emoface.train import MODELS, performed

LIP_REACH_M = 8e-3


@dataclass
class Scores:
    """Scores of one kind of performance. `nearer` is set only if the emotion came from another recording."""

    name: str
    clips: int
    lve_mm2: float
    eve_mm2: float
    nearer: float | None = None

    def __str__(self) -> str:
        more = "" if self.nearer is None else f", nearer to that emotion {100 * self.nearer:.0f} %"
        errors = f"LVE {self.lve_mm2:.3f} mm², EVE {self.eve_mm2:.3f} mm²"
        return f"{self.name:12s} {self.clips} clips, {errors}{more}"


def face_of(run: Path) -> tuple[EmoFace, dict]:
    """The model of an emoface.pt or a model folder, and everything that was saved with it."""
    if run.is_dir():
        config, state = read_model(run)
        del config["triangles"]
        template = {name: state.pop(name) for name in ("vertices", "triangles", "spirals")}
        saved = template | {"config": config, "state": state}
    else:
        saved = torch.load(run, map_location="cpu")
    config = EmoFaceConfig.from_json(saved["config"])
    return restored(EmoFace(config, saved["spirals"].numpy()), saved["state"]), saved


def regions(points: np.ndarray, landmarks: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Numbers of the vertices around the lips, and of those above the middle of the nose."""
    lips = points[landmarks[48:]]
    near = np.linalg.norm(points[:, None] - lips, axis=-1).min(axis=1) < LIP_REACH_M
    return np.flatnonzero(near), np.flatnonzero(points[:, 1] > points[landmarks[29], 1])


def lines(run: Path, arguments) -> Iterator[Scores]:
    """Scores without motion, with each clip's own emotion, and with crossed emotions if there are pairs."""
    model, saved = face_of(run)
    clips = read_held_out(run, model.config, saved, arguments)
    about = regions(saved["vertices"].numpy(), np.array(model.config.landmarks))
    starts = bool(saved.get("recipe", {}).get("whole"))
    yield score("no motion", [(c.weights, torch.zeros_like(c.weights)) for c in clips], about)
    yield score("own emotion", [(c.weights, perform_clip(model, c, starts)) for c in clips], about)
    pairs = Pairs(clips)
    crossed = [(c, pairs.cross(c, other)) for c in clips for other in pairs.of(c)]
    if crossed:
        motions = [perform_clip(model, mixed, starts) for _, mixed in crossed]
        crossed_score = score(
            "crossed", [(c.weights, x) for (_, c), x in zip(crossed, motions, strict=True)], about
        )
        apart = [[_mean_apart(x, c.weights) for c in pair] for pair, x in zip(crossed, motions, strict=True)]
        crossed_score.nearer = float(np.mean([there < here for here, there in apart]))
        yield crossed_score


def read_held_out(run: Path, config: EmoFaceConfig, saved: dict, arguments) -> list[Spoken]:
    """The held-out clips of the folder, with features of the run's encoders."""
    encoders = encoders_of_run(run, config, saved, arguments)
    folder = CorpusFolder(arguments.corpus)
    folder.rows = [row for row in folder.rows if row.held_out]
    if not folder.rows:
        raise ValueError(f"{folder.path}/clips.tsv: expected clips of split val or test, got none")
    clips = folder_clips.spoken(folder, encoders, config.fps)
    size = clips[0].weights.shape[1] // 3
    if size != config.vertices:
        raise ValueError(
            f"{folder.path}: expected the {config.vertices} vertices of {run}, got {size}; name the folder "
            "that the run was trained on, or one of its topology"
        )
    return clips


def encoders_of_run(run: Path, config: EmoFaceConfig, saved: dict, arguments) -> Encoders:
    """The encoders that the command line names, or those that the run trained.

    Raises ValueError if they are not of the kinds used in training.
    """
    arguments = Namespace(**vars(arguments))
    if saved.get("tuned"):
        models, hears, feels = run.parent / MODELS, config.speech.encoder, config.emotion
        names = {"speech": None, "hubert": None, "emotion_encoder": None, "emotion_hubert": None}
        names["speech" if hears == "ear" else "hubert"] = models / hears
        names["emotion_hubert" if feels else "emotion_encoder"] = (
            models / f"emotion_{feels.encoder}" if feels else models / "emotion_encoder"
        )
        for name, folder in names.items():
            setattr(arguments, name, folder)
    inputs = [x.transformer_fps for x in (config.speech, config.emotion) if x is not None]
    encoders = encoders_of(arguments, config, any(x is not None for x in inputs))
    for flag, expected, got in (
        ("--speech or --hubert", config.speech, encoders.speech.about),
        ("--emotion-encoder or --emotion-hubert", config.emotion, encoders.emotion.about),
    ):
        one, two = (
            f"{x.encoder} of {x.channels} channels" if x else "emotion_encoder" for x in (expected, got)
        )
        if one != two:
            raise ValueError(f"{flag}: expected {one} as in training, got {two}; name that encoder")
    return encoders


def perform_clip(model: EmoFace, clip: Spoken, starts: bool) -> Tensor:
    """The model's motion for a clip, [T, 3 V] metres.

    If `starts`, it begins at the clip's first frame, otherwise at rest.
    """
    scale = model.config.scale_m
    return performed(model, clip, first=clip.weights[:1] / scale if starts else None).motion[0] * scale


def score(name: str, pairs: list[tuple[Tensor, Tensor]], about: tuple[np.ndarray, np.ndarray]) -> Scores:
    """Scores pairs of true and predicted motion, each [T, 3 V] in metres."""
    errors = []
    for truth, predicted in pairs:
        g, p = (1e3 * x.unflatten(1, (-1, 3)).double().numpy() for x in (truth, predicted))
        errors.append([worst_point(p[:, among], g[:, among]) for among in about])
    return Scores(name, len(pairs), *np.mean(errors, axis=0).tolist())


def _mean_apart(x: Tensor, y: Tensor) -> float:
    return float((x - y).unflatten(1, (-1, 3)).norm(dim=-1).mean())
