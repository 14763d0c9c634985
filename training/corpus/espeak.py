"""Speech of espeak-ng with its own phone times, through its C library (GPL program, used as a tool).

Debian: `apt-get install espeak-ng`. No part of it is distributed with the weights.
"""

import ctypes
from ctypes import CFUNCTYPE, POINTER, Structure, Union, c_char, c_char_p, c_int, c_short, c_uint, c_void_p

import numpy as np
from scipy.signal import resample_poly

from training.corpus.phones import Phone

RATE_HZ = 16000
SYNCHRONOUS = 2
PHONE_EVENTS = 1
IPA_EVENTS = 2
PHONE = 7
UTF8 = 1
TIE = "^"
IPA_WITH_TIES = 2 | 128 | ord(TIE) << 8
"""Mode for `espeak_TextToPhonemes`: it writes IPA, with `TIE` between the letters of one sound."""
RATE, PITCH, RANGE = 1, 3, 4


class _Id(Union):
    _fields_ = [("number", c_int), ("name", c_char_p), ("string", c_char * 8)]


class _Event(Structure):
    _fields_ = [
        ("type", c_int),
        ("unique_identifier", c_uint),
        ("text_position", c_int),
        ("length", c_int),
        ("audio_position_ms", c_int),
        ("sample", c_int),
        ("user_data", c_void_p),
        ("id", _Id),
    ]


class Espeak:
    """The synthesiser. The library allows only one per process."""

    def __init__(self):
        try:
            self.library = ctypes.CDLL("libespeak-ng.so.1")
        except OSError as error:
            raise RuntimeError("espeak-ng: expected libespeak-ng.so.1 (apt-get install espeak-ng)") from error
        flags = PHONE_EVENTS | IPA_EVENTS
        self.rate_hz = self.library.espeak_Initialize(SYNCHRONOUS, 500, None, flags)
        if self.rate_hz <= 0:
            raise RuntimeError("espeak-ng: its voice data could not be read")
        self.sound, self.events = [], []
        self.callback = CFUNCTYPE(c_int, POINTER(c_short), c_int, POINTER(_Event))(self._receive)
        self.library.espeak_SetSynthCallback(self.callback)
        self.library.espeak_TextToPhonemes.restype = c_char_p

    def speak(self, text: str, voice: str, rate_wpm: int = 160, pitch: int = 50, melody: int = 50):
        """Samples [S] f32 at 16 kHz and phones. `voice` is a name such as `fr+f3`."""
        self.sound, self.events = [], []
        self._take_voice(voice)
        for parameter, value in ((RATE, rate_wpm), (PITCH, pitch), (RANGE, melody)):
            self.library.espeak_SetParameter(parameter, value, 0)
        data = text.encode() + b"\0"
        self.library.espeak_Synth(data, len(data), 0, 0, 0, 1, None, None)
        self.library.espeak_Synchronize()
        raw = np.frombuffer(b"".join(self.sound), np.int16).astype(np.float32) / 32768.0
        samples = resample_poly(raw, RATE_HZ, self.rate_hz).astype(np.float32)
        return samples, _phones(self.events, len(raw) / self.rate_hz)

    def ipa(self, text: str, voice: str) -> str:
        """How `voice` says a text, in IPA with stress. `TIE` joins the letters of one sound."""
        self._take_voice(voice)
        rest, clauses = c_char_p(text.encode()), []
        while rest.value is not None:
            clause = self.library.espeak_TextToPhonemes(ctypes.byref(rest), UTF8, IPA_WITH_TIES)
            clauses.append(clause.decode())
        return " ".join(clauses)

    def _take_voice(self, voice: str) -> None:
        if self.library.espeak_SetVoiceByName(voice.encode()) != 0:
            raise ValueError(f"espeak-ng voice: expected one of `espeak-ng --voices`, got {voice!r}")

    def _receive(self, wave, count, events) -> int:
        if wave and count:
            self.sound.append(ctypes.string_at(wave, 2 * count))
        index = 0
        while events[index].type != 0:
            if events[index].type == PHONE:
                label = events[index].id.string.decode("utf-8", "ignore")
                self.events.append((events[index].audio_position_ms / 1000.0, label))
            index += 1
        return 0


def _phones(events: list[tuple[float, str]], end_s: float) -> list[Phone]:
    """Phones from events, which mark where phones begin. Labels such as `(en)` mark a change of language."""
    marks = [(time, label) for time, label in events if not label.startswith("(")]
    ends = [time for time, _ in marks[1:]] + [end_s]
    return [Phone(t, max(e - t, 0.0), label) for (t, label), e in zip(marks, ends, strict=True)]
