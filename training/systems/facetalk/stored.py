"""Loads FaceTalk's head and the models that move it, from checkpoints or from one exported folder."""

from pathlib import Path

import torch
from torch import Tensor

from training.nn.checkpoint import read_model, restored
from training.systems.facetalk.config import HeadConfig
from training.systems.facetalk.head import Head
from training.systems.facetalk.motion import Denoiser, MotionConfig
from training.systems.facetalk.network import widened

MOTIONS = ("motion", "landmark_motion")
"""Names of the models that move a head: one follows speech, the other the motion of landmarks."""
EXACT = ("identity_code.", "expression_code.", "identity.landmarks.", "identity.mirror", "principal.",
         "motion.mean", "motion.std", "landmark_motion.mean", "landmark_motion.std")  # fmt: skip


def load_head(path: Path, octaves: int | None = None) -> Head:
    """Loads a head.pt. If `octaves` is given, its deformations encode points with that many octaves."""
    saved = torch.load(path, map_location="cpu", weights_only=True)
    config = HeadConfig.from_json(saved["config"])
    config.expression_octaves = octaves or config.expression_octaves
    head = Head(config)
    head.load_state_dict(widened(saved["state"], config.expression_octaves))
    return head


def load_motion(path: Path) -> Denoiser:
    """Loads a motion.pt."""
    saved = torch.load(path, map_location="cpu", weights_only=True)
    return restored(Denoiser(MotionConfig.from_json(saved["config"])), saved["state"])


def joined(head: Head, motions: dict[str, Denoiser]) -> tuple[dict[str, Tensor], dict]:
    """Joins the states and configurations of a head and `motions`, whose keys are names of `MOTIONS`."""
    state, config = dict(head.state_dict()), head.config.to_json()
    for name, motion in motions.items():
        state |= {f"{name}.{key}": value for key, value in motion.state_dict().items()}
        config[name] = motion.config.to_json()
    return state, config


def load_folder(folder: Path) -> tuple[Head, dict[str, Denoiser]]:
    """Loads an exported folder, in f32."""
    config, state = read_model(folder)

    def of(name: str) -> dict[str, Tensor]:
        return {
            key.removeprefix(f"{name}."): state.pop(key) for key in list(state) if key.startswith(f"{name}.")
        }

    motions = {
        name: restored(Denoiser(MotionConfig.from_json(config[name])), of(name))
        for name in MOTIONS
        if name in config
    }
    return restored(Head(HeadConfig.from_json(config)), state), motions


def load_head_and_motions(path: Path) -> tuple[Head, dict[str, Denoiser]]:
    """Loads a head.pt, which no model moves, or an exported folder, in f32."""
    return load_folder(path) if path.is_dir() else (load_head(path), {})


def check_fit(path: Path, motion: Denoiser, head: Head) -> None:
    """Raises `ValueError` if the model of `path` moves another head, with other codes of expressions."""
    expected, found = head.config.expression_code, motion.config.codes
    if expected != found:
        raise ValueError(f"{path}: expected {expected} expression codes, as its head has, found {found}")
