"""The clips that EmoFace trains on, heard by both encoders; kept in the cache."""

import hashlib
from functools import partial
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from training.corpus import arkit, bank
from training.corpus.cache import cached
from training.corpus.clip import FPS, MEL_PER_FRAME, fit_frames
from training.corpus.facegood import read_facegood
from training.corpus.faces import load_ict
from training.corpus.feelings import SOURCE as EMODB
from training.corpus.feelings import read_felt
from training.corpus.folder import CorpusFolder
from training.corpus.grid import read_grid
from training.corpus.teacher import Teacher
from training.nn.checkpoint import read_bytes, read_model
from training.speech.compact import SHIPPED_ENCODER, load_encoder, normalise
from training.speech.hubert import HubertFeatures
from training.speech.log_mel import log_mel
from training.systems.emoface import folder_clips
from training.systems.emoface.feeling import FeelingConfig, FeelingEncoder
from training.systems.emoface.model import ANY_STYLE, EmoFaceConfig, SpeechInput, Template
from training.systems.emoface.rows import Spoken
from training.systems.emoface.template import ict_template


def template_of(data: Path, vertices: int) -> tuple[Template, np.ndarray]:
    """ICT's template and the displacement of its vertices at weight 1 of each channel, [51, V, 3] metres."""
    template, chosen = ict_template(data, vertices)
    return template, load_ict(data, "face").mean.modes[:, chosen]


def load_feeling(folder: Path) -> FeelingEncoder:
    """The emotion encoder of a model folder."""
    config, state = read_model(folder)
    arrays = {name: value.double().numpy() for name, value in state.items()}
    return FeelingEncoder(FeelingConfig(**config), **arrays)


def load_clips(arguments, config: EmoFaceConfig) -> list[Spoken]:
    """All clips; the project's own from the cache where they were heard before by the same encoders."""
    if arguments.corpus:
        return of_corpus(arguments, config)
    if arguments.hubert is not None or arguments.feeling_hubert is not None:
        raise ValueError(
            "--hubert, --feeling-hubert: expected --corpus with them, got the project's own clips"
        )
    weights = read_bytes(arguments.feeling)
    key = hashlib.sha256(weights + repr((arguments.voices, arguments.limit)).encode()).hexdigest()[:12]
    path = arguments.cache / f"emoface-{key}.pt"
    return cached(path, Spoken, lambda: [*recorded(arguments), *felt(arguments)])


@torch.no_grad()
def of_corpus(arguments, config: EmoFaceConfig) -> list[Spoken]:
    """Clips of a corpus folder; tells `config` their speakers and how they are heard."""
    transformer_fps = config.speech.transformer_fps
    if arguments.feeling_hubert is not None:
        config.feeling, feels = _checkpoint(arguments.feeling_hubert, transformer_fps)
        config.feeling_channels = config.feeling.channels
    else:
        feeling = load_feeling(arguments.feeling)
        config.feeling_channels = feeling.config.coordinates + len(feeling.config.feelings)
        feels = partial(_felt_as, feeling)
    if arguments.hubert is not None:
        config.speech, hears = _checkpoint(arguments.hubert, transformer_fps)
    else:
        encoder = load_encoder(SHIPPED_ENCODER).eval()
        config.speech = SpeechInput("compact_speech", encoder.config.channels)
        hears = partial(_said, encoder)
    clips = folder_clips.spoken(CorpusFolder(arguments.corpus), hears, feels)
    config.fps = FPS
    config.styles = [*sorted({c.source for c in clips}), ANY_STYLE]
    return clips


def _checkpoint(folder: Path, transformer_fps: float | None) -> tuple[SpeechInput, folder_clips.Hears]:
    """A user's encoder, in FaceFormer's order of steps where the size asks for it, at our frame rate."""
    features = HubertFeatures(folder, FPS if transformer_fps else None)
    about = SpeechInput(features.kind, features.channels, features.transformer_fps)
    return about, lambda samples, frames: features(torch.from_numpy(samples), frames)


def _said(encoder, samples: np.ndarray, frames: int) -> Tensor:
    """What the compact encoder hears, [frames, C]."""
    mel = fit_frames(log_mel(torch.from_numpy(samples)), MEL_PER_FRAME * frames)
    return encoder(normalise(mel)[None])[0]


@torch.no_grad()
def recorded(arguments) -> list[Spoken]:
    """grid_s1 and facegood_zh: recorded motion, neutral."""
    encoder, feeling = load_encoder(SHIPPED_ENCODER).eval(), load_feeling(arguments.feeling)
    entries = bank.load(arguments.data, arguments.cache, arguments.voices, limit=arguments.limit)
    entries = arkit.as_weights(entries, arguments.data)
    samples = {c.name: c.samples for c in [*read_grid(arguments.data), *read_facegood(arguments.data)]}
    found = []
    for entry in entries:
        content = [encoder(normalise(mel.float())[None])[0].half() for mel in entry.mels]
        heard = _felt_as(feeling, samples[entry.name], len(entry.motion))
        found.append(Spoken(entry.name, entry.source, entry.held_out, content, heard, entry.motion.float()))
    return found


@torch.no_grad()
def felt(arguments) -> list[Spoken]:
    """emodb_de: faces made from its phones by the teacher; the feeling is added when rows are drawn."""
    encoder, feeling = load_encoder(SHIPPED_ENCODER).eval(), load_feeling(arguments.feeling)
    teacher, found = Teacher.load(), []
    for clip in read_felt(arguments.data, arguments.limit):
        frames = max(int(len(clip.samples) * FPS / 16000), 2)
        motion = torch.from_numpy(teacher.motion(clip.phones, frames)).flatten(1)
        weights = arkit.weights_of(motion, torch.ones(204))
        content = [_said(encoder, clip.samples, frames).half()]
        heard = _felt_as(feeling, clip.samples, frames)
        label = (clip.feeling, clip.share)
        found.append(Spoken(clip.name, EMODB, clip.held_out, content, heard, weights.float(), *label))
    return found


def _felt_as(feeling: FeelingEncoder, samples: np.ndarray, frames: int) -> Tensor:
    """What the emotion encoder hears, [T, E]."""
    return torch.from_numpy(feeling.track(samples, frames)).float()
