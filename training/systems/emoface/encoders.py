"""EmoFace's encoders as networks, frozen or trained: E_c for content and E_e for emotion (§3.3.2).

`prepare` turns a sound into the encoder's input. A clip stores this input if the encoder is trained. The
encoder turns it into features at motion frames, [T, C]. E_e also returns class logits for eq. 10. `write`
writes a folder that the engine can read.
"""

import json
import math
from dataclasses import replace
from pathlib import Path

import torch
from torch import Tensor, nn

from training.corpus.clip import FPS, MEL_PER_FRAME
from training.corpus.windows import interpolate
from training.nn.checkpoint import read_model, write_model
from training.nn.config import SpeechInput
from training.speech.ear import ear_mel, load_ear, taps
from training.speech.hubert import MODELS, HubertFeatures, at_motion_frames
from training.speech.whisper import load_trunk
from training.systems.emoface.emotion_encoder import LEAST, STEP, EmotionEncoderConfig, numbers, voice_of
from training.systems.emoface.rows import Spoken

MEL_HZ = MEL_PER_FRAME * FPS
UNTAUGHT = -1
"""Label of a clip whose emotion is not a class of the emotion encoder."""


class EarContent(nn.Module):
    """E_c: the ear. Its input is what Whisper's frozen layers heard. Only the ear's body can learn."""

    name = "ear"

    def __init__(self, path: Path, fps: float):
        super().__init__()
        self.body, self.fps = load_ear(path).eval(), fps
        self.trunk = load_trunk().requires_grad_(False)
        self.about = SpeechInput(self.name, self.body.config.channels)

    def prepare(self, samples: Tensor, frames: int) -> Tensor:
        """Samples [S] at 16 kHz → outputs of Whisper's layers [K, 2 N, 512], N counts frames at 25 fps."""
        count = math.ceil(frames * FPS / self.fps - 1e-6)
        return taps(self.trunk, ear_mel(samples), self.body.config.taps, count)

    def forward(self, heard: Tensor, frames: int) -> Tensor:
        """What `prepare` returned → features [frames, C]."""
        features = self.body(heard[None])[0]
        return (
            features[:frames] if self.fps == FPS else at_motion_frames(features, FPS, 0.0, frames, self.fps)
        )

    def write(self, folder: Path) -> None:
        """Writes a model folder."""
        exact = ("mean", "deviation")
        write_model(folder / self.name, self.body.state_dict(), self.body.config.to_json(), exact)


class Checkpoint(nn.Module):
    """A user's HuBERT or wav2vec2. Its input is samples. `role` prefixes the name of its folder."""

    def __init__(self, folder: Path, fps: float, before_transformer: bool, role: str = ""):
        super().__init__()
        self.features = HubertFeatures(folder, fps if before_transformer else None, fps)
        if self.features.kind not in MODELS:
            expected, got = " or ".join(MODELS), self.features.kind
            raise ValueError(f"{folder}/config.json: model_type: expected {expected} for EmoFace, got {got}")
        self.model = self.features.model
        self.name = role + self.features.kind
        self.about = SpeechInput(self.features.kind, self.features.channels, self.features.transformer_fps)

    def prepare(self, samples: Tensor, frames: int) -> Tensor:
        """Returns the samples unchanged."""
        return samples

    def forward(self, samples: Tensor, frames: int) -> Tensor:
        """Samples [S] → features [frames, C]."""
        return self.features.hear(samples, frames)

    def write(self, folder: Path) -> None:
        """Writes a folder in Hugging Face's format."""
        at = write_model(folder / self.name, self.model.state_dict(), self.features.config, ("",))
        about = {"do_normalize": self.features.normalise}
        (at / "preprocessor_config.json").write_text(json.dumps(about) + "\n")


class CheckpointEmotion(Checkpoint):
    """E_e as in the paper. A linear layer classifies the mean features of a recording into `classes`."""

    def __init__(self, folder: Path, fps: float, before_transformer: bool, classes: list[str]):
        super().__init__(folder, fps, before_transformer, "emotion_")
        self.classes = classes
        self.classifier = nn.Linear(self.about.channels, len(classes))

    def classify(self, samples: Tensor, frames: int) -> tuple[Tensor, Tensor]:
        """Features [frames, C], and logits of the classes."""
        heard = self(samples, frames)
        return heard, self.classifier(heard.mean(dim=0))


class EmotionNumbers(nn.Module):
    """E_e: the shipped `EmotionEncoder`. Its input is the 118 numbers of each instant, [I, 118]."""

    name, about = "emotion_encoder", None

    def __init__(self, folder: Path, fps: float):
        super().__init__()
        config, state = read_model(folder)
        self.config, self.fps = EmotionEncoderConfig(**config), fps
        self.classes = self.config.emotions
        self.channels = self.config.coordinates + len(self.classes)
        for name in ("mean", "scale"):
            self.register_buffer(name, state[name])
        self.coordinates, self.weight, self.bias = (
            nn.Parameter(state[name]) for name in ("coordinates", "weight", "bias")
        )

    def prepare(self, samples: Tensor, frames: int) -> Tensor:
        """Samples [S] at 16 kHz → numbers [I, 118].

        If the sound is too short for an instant, they are the training's mean.
        """
        measured = torch.from_numpy(numbers(voice_of(samples.numpy()))).float()
        return measured if len(measured) else self.mean[None].clone()

    def classify(self, measured: Tensor, frames: int) -> tuple[Tensor, Tensor]:
        """F_e [frames, 13] as in `EmotionEncoder.track`, and class logits averaged over instants."""
        x = (measured - self.mean) / self.scale
        logits = x @ self.weight + self.bias
        heard = torch.cat([x @ self.coordinates, logits.softmax(dim=1)], dim=1)
        at = (torch.arange(frames) * (MEL_HZ / self.fps) - LEAST) / STEP
        return interpolate(heard, at), logits.mean(dim=0)

    def forward(self, measured: Tensor, frames: int) -> Tensor:
        """F_e at motion frames, [frames, 13]."""
        return self.classify(measured, frames)[0]

    def write(self, folder: Path) -> None:
        """Writes a model folder."""
        write_model(folder / self.name, self.state_dict(), self.config.to_json(), ("",))


class Encoders(nn.Module):
    """E_c and E_e of one model. `learn` says whether they are trained with it."""

    def __init__(self, speech: EarContent | Checkpoint, emotion: EmotionNumbers | CheckpointEmotion,
                 learn: bool = False):  # fmt: skip
        super().__init__()
        self.speech, self.emotion, self.learn = speech, emotion, learn

    @property
    def emotion_channels(self) -> int:
        """Number of channels of F_e."""
        return self.emotion.about.channels if self.emotion.about else self.emotion.channels

    def content(self, clip: Spoken) -> Tensor:
        """F_c of a clip, [T, C]."""
        return self.speech(clip.sound, len(clip)) if self.learn else clip.content[0].float()

    def feel(self, clip: Spoken) -> tuple[Tensor, Tensor | None]:
        """F_e of a clip, [T, E], and the logits of its class if the encoders learn."""
        return self.emotion.classify(clip.voice, len(clip)) if self.learn else (clip.emotion, None)

    def label(self, clip: Spoken) -> int:
        """Number of the clip's class, or `UNTAUGHT` if the emotion encoder has no such class."""
        classes = self.emotion.classes
        return classes.index(clip.label) if clip.label in classes else UNTAUGHT

    @torch.no_grad()
    def hear(self, clips: list[Spoken]) -> list[Spoken]:
        """The clips with features from the encoders' current weights."""
        if not self.learn:
            return clips
        return [replace(c, content=[self.content(c)], emotion=self.feel(c)[0]) for c in clips]

    def write(self, folder: Path) -> None:
        """Writes each encoder as a folder inside a folder of models."""
        for part in (self.speech, self.emotion):
            part.write(folder)
