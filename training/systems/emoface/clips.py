"""EmoFace's training clips with the features of both encoders, kept in the cache."""

import hashlib
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from training.corpus import arkit, bank, ear
from training.corpus.cache import cached
from training.corpus.clip import FPS
from training.corpus.conditions import EMOTIONS
from training.corpus.emodb import SOURCE as EMODB
from training.corpus.emodb import read_acted
from training.corpus.faces import load_ict
from training.corpus.folder import CorpusFolder
from training.corpus.teacher import Teacher
from training.nn.checkpoint import read_bytes, read_model
from training.speech.ear import SHIPPED_EAR, Ear, ear_mel, load_ear
from training.systems.emoface import folder_clips
from training.systems.emoface.emotion_encoder import EmotionEncoder, EmotionEncoderConfig
from training.systems.emoface.encoders import (
    Checkpoint,
    CheckpointEmotion,
    EarContent,
    EmotionNumbers,
    Encoders,
)
from training.systems.emoface.model import ANY_STYLE, EmoFaceConfig, Template
from training.systems.emoface.recipes import EMOFACE
from training.systems.emoface.rows import NEUTRAL, Spoken
from training.systems.emoface.template import ict_template

TEMPLATE = EmoFaceConfig.template
"""Template of the default configuration. The project's own clips train only on this one."""


def template_of(data: Path, vertices: int) -> tuple[Template, np.ndarray]:
    """ICT's template and the displacement of its vertices at weight 1 of each channel, [51, V, 3] metres."""
    template, chosen = ict_template(data, vertices)
    return template, load_ict(data, "face").mean.modes[:, chosen]


def load_emotion(folder: Path) -> EmotionEncoder:
    """The emotion encoder of a model folder."""
    config, state = read_model(folder)
    arrays = {name: value.double().numpy() for name, value in state.items()}
    return EmotionEncoder(EmotionEncoderConfig(**config), **arrays)


def load_clips(arguments, config: EmoFaceConfig) -> list[Spoken]:
    """The project's own clips, from the cache if the same emotion encoder already heard them."""
    for_folders = {
        "--hubert": arguments.hubert, "--emotion-hubert": arguments.emotion_hubert,
        "--tune-encoders": arguments.tune_encoders, "--recipe paper": arguments.recipe == "paper",
        "--speech": arguments.speech != SHIPPED_EAR,
    }  # fmt: skip
    wrong = [flag for flag, is_there in for_folders.items() if is_there]
    if wrong:
        raise ValueError(
            f"{', '.join(wrong)}: expected --corpus with that, got the project's own clips; "
            "name a corpus folder with vertices (docs/training.md)"
        )
    if config.template != TEMPLATE:
        raise ValueError(
            f"--config {config.name}: expected --corpus, since template, encoders and its {config.fps:g} fps "
            f"are those of a folder with vertices, got the project's own clips of {FPS:g} fps; name a corpus "
            "folder, or take --config compact"
        )
    weights = read_bytes(arguments.emotion_encoder) + read_bytes(SHIPPED_EAR)
    key = hashlib.sha256(weights + repr(arguments.limit).encode()).hexdigest()[:12]
    path = arguments.cache / f"emoface-{key}.pt"
    clips = cached(path, Spoken, lambda: [*recorded(arguments), *acted(arguments)])
    config.emotion_ear = True
    config.speech.channels = clips[0].content[0].shape[1]
    config.emotion_channels = clips[0].emotion.shape[1]
    return clips


def of_corpus(arguments, config: EmoFaceConfig) -> tuple[list[Spoken], Encoders]:
    """Reads the clips of a corpus folder and loads their encoders.

    Sets the encoders, the speakers and the emotions in `config`.
    """
    folder = CorpusFolder(arguments.corpus)
    present = {row.emotion for row in folder.rows if not row.held_out}
    config.emotions = [f for f in EMOTIONS if f == NEUTRAL or f in present]
    learn = arguments.tune_encoders
    learn = EMOFACE[arguments.recipe].tunes_encoders if learn is None else learn
    encoders = encoders_of(arguments, config, config.speech.transformer_fps is not None, learn)
    config.speech, config.emotion = encoders.speech.about, encoders.emotion.about
    config.emotion_channels = encoders.emotion_channels
    clips = folder_clips.spoken(folder, encoders, config.fps)
    config.styles = [*sorted({c.source for c in clips}), ANY_STYLE]
    return clips, encoders


def encoders_of(arguments, config: EmoFaceConfig, before_transformer: bool, learn: bool = False) -> Encoders:
    """The encoders that the command line names, at the model's frame rate. They train too if they `learn`.

    With `before_transformer`, a checkpoint resamples before its transformer, as FaceFormer does. Callers set
    it if the size of the model asks for this or if the model was trained so.
    """
    if arguments.hubert is not None:
        speech = Checkpoint(arguments.hubert, config.fps, before_transformer)
    else:
        speech = EarContent(arguments.speech, config.fps)
    if arguments.emotion_hubert is not None:
        folder = arguments.emotion_hubert
        emotion = CheckpointEmotion(folder, config.fps, before_transformer, config.emotions)
    else:
        emotion = EmotionNumbers(arguments.emotion_encoder, config.fps)
    return Encoders(speech, emotion, learn)


@torch.no_grad()
def recorded(arguments) -> list[Spoken]:
    """Clips of `bank.READERS`, with recorded neutral motion."""
    body, emotion = load_ear(SHIPPED_EAR), load_emotion(arguments.emotion_encoder)
    heard = arkit.as_weights(list(ear.recorded(arguments, body.config.taps)), arguments.data)
    samples = {c.name: c.samples for read in bank.READERS.values() for c in read(arguments.data)}
    clips = []
    for clip in heard:
        content = [body(voice[None])[0].half() for voice in clip.heard]
        felt = _emotion_of(emotion, samples[clip.name], len(clip.motion))
        clips.append(Spoken(clip.name, clip.source, clip.held_out, content, felt, clip.motion.float()))
    return clips


@torch.no_grad()
def acted(arguments) -> list[Spoken]:
    """Clips of emodb_de. The teacher makes their faces from phones; drawing a row adds the emotion."""
    listen, emotion = Ear(), load_emotion(arguments.emotion_encoder)
    teacher, clips = Teacher.load(), []
    for clip in read_acted(arguments.data, arguments.limit):
        frames = max(int(len(clip.samples) * FPS / 16000), 2)
        motion = torch.from_numpy(teacher.motion(clip.phones, frames)).flatten(1)
        weights = arkit.weights_of(motion, torch.ones(204))
        content = [listen(ear_mel(torch.from_numpy(clip.samples)), frames).half()]
        heard = _emotion_of(emotion, clip.samples, frames)
        label = (clip.emotion, clip.share)
        clips.append(Spoken(clip.name, EMODB, clip.held_out, content, heard, weights.float(), *label))
    return clips


def _emotion_of(emotion: EmotionEncoder, samples: np.ndarray, frames: int) -> Tensor:
    """Features of the emotion encoder, [T, E]."""
    return torch.from_numpy(emotion.track(samples, frames)).float()
