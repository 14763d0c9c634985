"""Animates a face while somebody is speaking."""

import os

from .core.emotion import parse
from .core.errors import AnyfaceError
from .core.native import Engine
from .core.weight_stream import WeightStream
from .talking import built_in


class Stream(WeightStream):
    """Weights of ARKit's shapes and of visemes in real time, with blinks, eyes and head.

        with anyface.Stream(emotion="happy:0.5") as stream, anyface.Microphone() as microphone:
            while True:
                stream.push(microphone.read())
                for frame in stream.frames():
                    ...                             # frame.shapes[52], frame.visemes[15], frame.head[3]
                time.sleep(0.01)

    Speech moves the face. Under music and noise it rests, unless `any_sound` is set. A frame waits
    until `look_ahead` seconds of sound after it have arrived. FreeTalk supports 0.19, 0.07 and 0 s;
    the shorter, the less accurate the motion. `performer` is a file of `learn_performer`.
    Threads may share a stream. Raises `AnyfaceError` for an engine whose system needs
    the whole sound.
    """

    def __init__(
        self,
        *,
        emotion: str = "neutral",
        any_sound: bool = False,
        look_ahead: float | None = None,
        performer: str | os.PathLike[str] | None = None,
        performer_strength: float = 1.0,
        engine: Engine | None = None,
    ):
        if not isinstance(engine, Engine | None):
            raise AnyfaceError("input", f"engine: expected an Engine, got {type(engine).__name__}")
        super().__init__(built_in() if engine is None else engine)
        if look_ahead is not None:
            self.look_ahead(look_ahead)
        if performer is not None:
            self.set_performer(performer, performer_strength)
        if any_sound:
            self.hear_all()
        self.emotion = emotion

    @property
    def emotion(self) -> str:
        """The emotion of the face, such as `happy:0.5,surprised:0.2`. Set it at any time.

        `auto` shows the emotion heard in the voice.
        """
        return self._emotion

    @emotion.setter
    def emotion(self, emotion: str) -> None:
        if isinstance(emotion, str) and emotion == "auto":
            self.hear_emotion()
        else:
            self.set_emotion(parse(emotion))
        self._emotion = emotion
